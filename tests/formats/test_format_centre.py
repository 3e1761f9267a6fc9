"""Neutrals and frames far from the origin, in every format that holds doubles."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes import SmallMesh, deform
from rhytid.formats.frames import NPY, RAW, read_frame_file, read_positions
from rhytid.formats.meshes import read_mesh

WHERE = np.array([1e6, 2e5, -3e6])


def far(positions: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    return positions.astype(np.float64) * (1 + 1e-8) + WHERE


def npz(mesh: SmallMesh, **more: Any) -> tuple[bytes, str]:
    file = io.BytesIO()
    np.savez(file, **{**mesh._asdict(), "positions": far(mesh.positions), **more})
    return file.getvalue(), "a.npz"


def obj(mesh: SmallMesh) -> tuple[bytes, str]:
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in far(mesh.positions)]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in mesh.uv]
    pairs = zip(mesh.faces + 1, mesh.face_uv + 1, strict=True)
    lines += ["f " + " ".join(f"{i}/{j}" for i, j in zip(f, t, strict=True)) for f, t in pairs]
    return "\n".join(lines).encode(), "a.obj"


def ply(mesh: SmallMesh) -> tuple[bytes, str]:
    """Vertices of their own for every corner: PLY keeps one uv a vertex."""
    at = far(mesh.positions)[mesh.faces].reshape(-1, 3)
    rows = np.concatenate([at, mesh.uv[mesh.face_uv].reshape(-1, 2)], axis=1)
    names = "".join(f"property double {name}\n" for name in "xyzuv")
    head = f"ply\nformat ascii 1.0\nelement vertex {len(at)}\n{names}"
    head += f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = "\n".join(" ".join(f"{x:.9f}" for x in row) for row in rows)
    faces = "\n".join(f"3 {i} {i + 1} {i + 2}" for i in range(0, len(at), 3))
    return f"{head}{body}\n{faces}\n".encode(), "a.ply"


@pytest.mark.parametrize("write", [npz, obj, ply])
def test_neutrals_keep_their_digits(
    small_mesh: SmallMesh, write: Callable[[SmallMesh], tuple[bytes, str]]
) -> None:
    mesh = read_mesh(*write(small_mesh)).mesh
    sent = far(small_mesh.positions)[small_mesh.faces]
    assert np.abs(mesh.centre - WHERE).max() < 2
    assert np.abs(mesh.positions[mesh.faces] + mesh.centre - sent).max() < 3e-7


def test_frames_keep_their_digits(small_mesh: SmallMesh) -> None:
    frames = np.stack([far(deform(small_mesh.positions, seed)) for seed in range(2)])
    found = read_mesh(*npz(small_mesh, frames=frames))
    centre, count = found.mesh.centre, len(frames[0])
    assert found.frames is not None
    single = io.BytesIO()
    np.save(single, frames[0])
    several = io.BytesIO()
    np.save(several, frames)
    text = "\n".join(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in frames[0]).encode()
    read = {
        "npz": found.frames[0],
        "npz alone": read_frame_file(*npz(small_mesh, frames=frames), count, centre)[0],
        "npy": read_frame_file(single.getvalue(), "a.npy", count, centre)[0],
        "npy of several": read_frame_file(several.getvalue(), "a.npy", count, centre)[0],
        "obj": read_frame_file(text, "a.obj", count, centre)[0],
        "body": read_positions(single.getvalue(), NPY, count, centre),
    }
    for name, positions in read.items():
        assert positions.dtype == np.float32, name
        assert np.abs(positions + centre - frames[0]).max() < 3e-7, name
    np.testing.assert_array_equal(found.frames[1], (frames[1] - centre).astype(np.float32))
    rounded = read_positions(frames[0].astype("<f4").tobytes(), RAW, count, centre)
    np.testing.assert_array_equal(rounded + centre, frames[0].astype(np.float32))
