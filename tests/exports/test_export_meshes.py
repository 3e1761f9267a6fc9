"""Meshes as other programs read them, read again by this one and by trimesh."""

from __future__ import annotations

import io
import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from meshes import SmallMesh
from rhytid.domain.mesh import Mesh
from rhytid.errors import QueryError
from rhytid.exports.meshes import MESH_FORMATS, flat_mesh, mesh_format, normals, write_glb
from rhytid.formats.meshes import read_mesh


@pytest.mark.parametrize("format", MESH_FORMATS)
def test_vertices_come_first_and_in_their_order(small_mesh: SmallMesh, format: str) -> None:
    mesh = Mesh(*small_mesh)
    data = mesh_format(format).write(flat_mesh(mesh))
    found = read_mesh(data, f"mesh.{format}").mesh

    assert np.array_equal(found.positions[: len(mesh.positions)], mesh.positions)
    assert len(found.positions) == len(mesh.positions) + 11, "the seam of the sheet"
    assert np.array_equal(found.positions[found.faces], mesh.positions[mesh.faces])
    assert found.triangle_uv() == pytest.approx(mesh.triangle_uv(), abs=1e-6)
    theirs = trimesh.load_mesh(io.BytesIO(data), file_type=format, process=False)
    assert np.asarray(theirs.triangles) == pytest.approx(mesh.positions[mesh.faces], abs=1e-6)


def attribute(data: bytes, name: str) -> NDArray[np.float32]:
    """(W, 3) an attribute of a GLB with one mesh."""
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    number = document["meshes"][0]["primitives"][0]["attributes"][name]
    view = document["bufferViews"][document["accessors"][number]["bufferView"]]
    start = 28 + size + view["byteOffset"]
    return np.frombuffer(data[start : start + view["byteLength"]], "<f4").reshape(-1, 3)


def test_a_glb_has_normals_and_no_seam_in_them(small_mesh: SmallMesh) -> None:
    mesh = Mesh(*small_mesh)
    flat = flat_mesh(mesh)
    found = attribute(write_glb(flat), "NORMAL")
    assert found == pytest.approx(normals(mesh)[flat.source], abs=1e-6)

    corners = mesh.faces.reshape(-1)
    alone = Mesh(
        mesh.positions[corners], np.arange(len(corners)).reshape(-1, 3), mesh.uv, mesh.face_uv
    )
    split = flat_mesh(alone)
    found = attribute(write_glb(split), "NORMAL")
    assert found == pytest.approx(normals(mesh)[corners[split.source]], abs=1e-6)


def test_vertices_that_nothing_uses_stay(small_mesh: SmallMesh) -> None:
    mesh = Mesh(small_mesh.positions, small_mesh.faces[:9], small_mesh.uv, small_mesh.face_uv[:9])
    found = flat_mesh(mesh)

    assert np.array_equal(found.positions, mesh.positions)
    assert np.array_equal(found.faces, mesh.faces)


def test_the_centre_is_put_back_and_ply_keeps_the_digits(small_mesh: SmallMesh) -> None:
    centre = np.array([4096.0, 0, -512])
    mesh = replace(Mesh(*small_mesh), centre=centre)
    ply, glb = (
        read_mesh(mesh_format(kind).write(flat_mesh(mesh)), f"m.{kind}").mesh
        for kind in ("ply", "glb")
    )

    wanted = mesh.positions[mesh.faces] + centre
    assert ply.positions[ply.faces] + ply.centre == pytest.approx(wanted, abs=1e-6)
    assert glb.positions[glb.faces] + glb.centre == pytest.approx(wanted, abs=1e-3)


def test_other_formats_are_refused() -> None:
    with pytest.raises(QueryError, match="'obj': one of glb, ply"):
        mesh_format("obj")
