"""A trimesh.Trimesh sent as a mesh: as it is, and only where it has UV."""

from __future__ import annotations

import io
import subprocess
import sys

import httpx
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from clients.shells import Script, Shell
from meshes import SmallMesh
from rhytid.formats.meshes import read_mesh

ASSET = {"id": "a" * 16, "state": "building", "job": "j", "udims": [1001]}


class OwnMesh(trimesh.Trimesh):
    """A class of somebody else."""


def split(small: SmallMesh, kind: type[trimesh.Trimesh] = trimesh.Trimesh) -> trimesh.Trimesh:
    """One vertex a corner, as trimesh has UV, in an order of its own; two vertices of no use."""
    rng = np.random.default_rng(0)
    count = small.faces.size + 2
    order = rng.permutation(count)
    positions, uv = np.zeros((count, 3)), np.zeros((count, 2))
    positions[order[:-2]] = small.positions[small.faces.reshape(-1)]
    uv[order[:-2]] = small.uv[small.face_uv.reshape(-1)]
    visual = trimesh.visual.TextureVisuals(uv=uv)
    faces = order[:-2].reshape(-1, 3)
    return kind(positions, faces, visual=visual, process=False, validate=False)


def sent(kind: str, mesh: object) -> dict[str, NDArray[np.generic]]:
    """The arrays in the body of the request."""
    script = Script(httpx.Response(200, json=ASSET))
    Shell(kind, script).create_asset(mesh)
    body = script.bodies[0]
    assert b'filename="mesh.npz"' in body
    start = body.index(b"PK\x03\x04")
    data = body[start : body.rindex(b"\r\n--")]
    read_mesh(data, "mesh.npz")  # the server takes it
    with np.load(io.BytesIO(data)) as arrays:
        return dict(arrays)


@pytest.mark.parametrize("kind", ["sync", "async"])
@pytest.mark.parametrize("of", [trimesh.Trimesh, OwnMesh])
def test_vertices_and_uv_are_sent_as_they_are(
    small_mesh: SmallMesh, kind: str, of: type[trimesh.Trimesh]
) -> None:
    mesh = split(small_mesh, of)
    arrays = sent(kind, mesh)

    assert np.array_equal(arrays["positions"], mesh.vertices)
    assert arrays["positions"].dtype == np.float64
    assert np.array_equal(arrays["faces"], mesh.faces)
    assert np.array_equal(arrays["face_uv"], mesh.faces)
    corners = small_mesh.uv[small_mesh.face_uv]
    assert np.array_equal(arrays["uv"][arrays["face_uv"]], corners)


def test_a_mesh_without_uv_is_refused(small_mesh: SmallMesh) -> None:
    bare = trimesh.Trimesh(small_mesh.positions, small_mesh.faces, process=False)
    client = Shell("sync", Script(httpx.Response(200, json=ASSET)))

    with pytest.raises(ValueError, match=r"no uv for its 121 vertices: .*TextureVisuals"):
        client.create_asset(bare)


def test_uv_of_another_mesh_are_refused(small_mesh: SmallMesh) -> None:
    short = trimesh.Trimesh(small_mesh.positions, small_mesh.faces, process=False)
    short.visual = trimesh.visual.TextureVisuals(uv=small_mesh.uv[:7])
    client = Shell("sync", Script(httpx.Response(200, json=ASSET)))

    with pytest.raises(ValueError, match=r"uv of shape \(7, 2\) for its 121 vertices"):
        client.create_asset(short)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (trimesh.Scene(), "scene.geometry"),
        (trimesh.PointCloud(np.zeros((3, 3))), "PointCloud"),
        (7, "int"),
    ],
)
def test_other_things_are_refused(given: object, said: str) -> None:
    client = Shell("sync", Script(httpx.Response(200, json=ASSET)))

    with pytest.raises(TypeError, match=said):
        client.create_asset(given)


def test_the_client_does_not_import_trimesh() -> None:
    code = "import sys, rhytid_client; print('trimesh' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
