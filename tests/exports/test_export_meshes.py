"""Meshes as other programs read them, read again by this one and by trimesh."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from meshes import SmallMesh
from rhytid.domain.mesh import Mesh
from rhytid.errors import QueryError
from rhytid.exports.meshes import MESH_FORMATS, flat_mesh, mesh_format
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
