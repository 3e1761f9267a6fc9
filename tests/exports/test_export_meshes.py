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
from PIL import Image

from meshes import SmallMesh
from rhytid.domain.mesh import Mesh
from rhytid.errors import QueryError
from rhytid.exports.look_gltf import ShineMaps, write_shining_glb
from rhytid.exports.meshes import (
    MESH_FORMATS,
    flat_mesh,
    mesh_format,
    normals,
    write_glb,
)
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


def attribute(data: bytes, name: str, width: int = 3) -> NDArray[np.float32]:
    """(W, width) an attribute of a GLB with one mesh."""
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    number = document["meshes"][0]["primitives"][0]["attributes"][name]
    view = document["bufferViews"][document["accessors"][number]["bufferView"]]
    start = 28 + size + view["byteOffset"]
    return np.frombuffer(data[start : start + view["byteLength"]], "<f4").reshape(-1, width)


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


def test_a_glb_may_shine(small_mesh: SmallMesh) -> None:
    """Fields of KHR_materials_anisotropy and of glTF 2.0, and the images as they were."""
    mesh = Mesh(*small_mesh)
    mesh = replace(mesh, uv=mesh.uv + np.array([1.0, 0.0]))
    files = {}
    for number, name in enumerate(("roughness", "anisotropy", "normal")):
        file = io.BytesIO()
        Image.new("RGB", (4 + number, 4), (20 * number, 90, 7)).save(file, "PNG")
        files[name] = file.getvalue()
    data = write_shining_glb(mesh, {1002: ShineMaps(**files)})

    size, kind = struct.unpack_from("<I4s", data, 12)
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    assert (kind, struct.unpack_from("<I", data, 8)[0]) == (b"JSON", len(data))
    assert document["extensionsUsed"] == ["KHR_materials_anisotropy"]
    (primitive,) = document["meshes"][0]["primitives"]
    material = document["materials"][primitive["material"]]
    extension = material["extensions"]["KHR_materials_anisotropy"]
    known = {"anisotropyStrength", "anisotropyRotation", "anisotropyTexture"}
    assert set(extension) <= known
    assert 0.0 <= extension["anisotropyStrength"] <= 1.0
    base = material["pbrMetallicRoughness"]
    assert (base["metallicFactor"], base["roughnessFactor"]) == (0.0, 1.0)
    textures = {
        "roughness": base["metallicRoughnessTexture"],
        "anisotropy": extension["anisotropyTexture"],
        "normal": material["normalTexture"],
    }
    for name, texture in textures.items():
        image = document["images"][document["textures"][texture["index"]]["source"]]
        view = document["bufferViews"][image["bufferView"]]
        assert image["mimeType"] == "image/png"
        assert view["byteOffset"] % 4 == 0
        assert "target" not in view
        assert binary[view["byteOffset"] :][: view["byteLength"]] == files[name]
    normal, tangent = attribute(data, "NORMAL"), attribute(data, "TANGENT", 4)
    assert np.linalg.norm(tangent[:, :3], axis=1) == pytest.approx(1.0, abs=1e-6)
    assert np.sum(tangent[:, :3] * normal, axis=1) == pytest.approx(0.0, abs=1e-6)
    bitangent = np.cross(normal, tangent[:, :3]) * tangent[:, 3:]
    flat = flat_mesh(mesh)
    corners, uv = (one[flat.faces] for one in (flat.positions, flat.uv))
    ways = np.linalg.solve(uv[:, 1:] - uv[:, :1], corners[:, 1:] - corners[:, :1])
    for axis, way in ((tangent[:, :3], ways[:, 0]), (bitangent, ways[:, 1])):
        ours = axis[flat.faces].sum(axis=1)
        lengths = np.linalg.norm(ours, axis=1) * np.linalg.norm(way, axis=1)
        assert np.median(np.sum(ours * way, axis=1) / lengths) > 0.9
    theirs = trimesh.load(io.BytesIO(data), file_type="glb", process=False).to_geometry()
    assert len(theirs.faces) == len(mesh.faces)
    read = theirs.visual.material
    assert read.metallicRoughnessTexture.size == (4, 4)
    assert read.normalTexture.size == (6, 4)


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
