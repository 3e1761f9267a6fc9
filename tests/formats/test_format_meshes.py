"""Reading a mesh by its extension; the real faces."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import face_data
from face_data import Face
from formats.writers import (
    SQUARE,
    SQUARE_ARRAYS,
    SQUARE_FACES,
    SQUARE_UV,
    glb,
    gltf,
    npz,
    obj,
    ply,
    same_mesh,
)
from rhytid.errors import MeshError
from rhytid.formats.frames import read_frame_file
from rhytid.formats.meshes import read_mesh

DOCUMENT = gltf(
    {
        "POSITION": SQUARE,
        "TEXCOORD_0": (SQUARE_UV * (1, -1) + (0, 1)).astype(np.float32),
        "indices": SQUARE_FACES.reshape(-1, 1).astype(np.uint8),
    }
)
NPZ = dict(zip(("positions", "faces", "uv", "face_uv"), SQUARE_ARRAYS, strict=True))


@pytest.mark.parametrize(
    ("data", "name"),
    [
        (obj(*SQUARE_ARRAYS), "face.obj"),
        (obj(*SQUARE_ARRAYS), "../FACE.v2.OBJ"),
        (ply(SQUARE, SQUARE_UV, SQUARE_FACES.tolist()), "face.Ply"),
        (json.dumps(DOCUMENT).encode(), "face.gltf"),
        (glb(DOCUMENT), "face.glb"),
        (npz(**NPZ), "face.npz"),
    ],
)
def test_the_extension_names_the_reader(data: bytes, name: str) -> None:
    read = read_mesh(data, name)
    np.testing.assert_array_equal(read.mesh.positions, SQUARE)
    np.testing.assert_array_equal(read.mesh.faces, SQUARE_FACES)
    np.testing.assert_allclose(read.mesh.uv, SQUARE_UV, atol=1e-7)
    assert read.frames is None


def test_frames_come_with_an_npz() -> None:
    frames = np.stack([SQUARE, SQUARE * 2])
    read = read_mesh(npz(**NPZ, frames=frames), "face.npz").frames
    np.testing.assert_array_equal(read, frames)


@pytest.mark.parametrize(("name", "shown"), [("a.fbx", ".fbx"), ("obj", ""), ("", "")])
def test_an_unknown_extension_names_the_known_ones(name: str, shown: str) -> None:
    known = "must be one of .obj, .ply, .gltf, .glb, .npz"
    with pytest.raises(MeshError, match=f"extension '{shown}': {known}"):
        read_mesh(b"", name)


def test_scale_changes_nothing_but_the_positions() -> None:
    for scale in (1e-9, 1e9):
        mesh = read_mesh(npz(**{**NPZ, "positions": SQUARE * np.float32(scale)}), "a.npz").mesh
        assert mesh.usable_triangles().all()


@pytest.mark.face
def test_the_real_face_in_two_formats(face: Face) -> None:
    folder = Path(os.environ[face_data.VARIABLE]) / "ict_face"
    read = read_mesh((folder / "face.npz").read_bytes(), "face.npz")
    same_mesh(read.mesh, face.positions, face.faces, face.uv, face.face_uv)
    text = read_mesh((folder / "obj" / "neutral.obj").read_bytes(), "neutral.obj").mesh
    np.testing.assert_array_equal(text.faces, face.faces)
    np.testing.assert_array_equal(text.face_uv, face.face_uv)
    np.testing.assert_allclose(text.positions, face.positions, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(text.uv, face.uv, rtol=1e-6)


@pytest.mark.face
def test_the_real_frames_follow_the_real_face(face: Face) -> None:
    folder = Path(os.environ[face_data.VARIABLE]) / "ict_face" / "obj"
    frame = read_frame_file((folder / "smile.obj").read_bytes(), "smile.obj", len(face.positions))
    np.testing.assert_allclose(frame[0], face.composite("smile"), rtol=1e-5, atol=1e-5)


@pytest.mark.face
def test_the_tiny_real_face() -> None:
    path = Path(os.environ[face_data.VARIABLE]) / "mediapipe_tiny" / "canonical_face_model.obj"
    mesh = read_mesh(path.read_bytes(), path.name).mesh
    assert (len(mesh.positions), len(mesh.uv), len(mesh.faces)) == (468, 468, 898)
    assert mesh.positions[0].tolist() == np.float32([0, -3.406404, 5.979507]).tolist()
    assert mesh.usable_triangles().all()
