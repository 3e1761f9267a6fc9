"""The id follows the content: any change of it changes the id, nothing else does."""

from __future__ import annotations

import hashlib
import json
import re
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import GraphOrigin, WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.storage.asset_ids import asset_id
from rhytid.storage.records import read_mesh, write_mesh

ONE = np.ones((2, 3), np.float32)
MAPS = ({}, {1001: ONE}, {1002: ONE}, {1001: ONE.T}, {1001: ONE, 1002: ONE}, {1001: 0 * ONE})
STIFFNESS = [Stiffness(maps) for maps in MAPS]


def test_same_content_same_id(mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings) -> None:
    first = asset_id(mesh, settings, graph)
    again = Mesh(mesh.positions.astype(">f4"), mesh.faces.astype("i8"), mesh.uv, mesh.face_uv)
    assert re.fullmatch("[0-9a-f]{16}", first)
    assert asset_id(again, AssetSettings.parse(settings.as_json()), graph) == first


@pytest.mark.parametrize("preset", ["paper", "best"])
def test_id_is_this_hash_on_every_machine(preset: str) -> None:
    corners, faces = np.eye(3), [[0, 1, 2]]
    mesh = Mesh(corners, faces, corners[:, :2], faces)
    asked = AssetSettings.parse({"preset": preset, "graph": {"wrinkles": 300_000}})
    settings = {**asked.as_json(), "unit": "cm"}
    settings["graph"] = {"wrinkles": 300_000, "seed": 1, "neighbours": 8}
    del settings["name"]
    if preset == "paper":  # what came later is off, and not in the id
        del settings["response"]["folds"]
    else:
        settings["graph"] |= {"rank": 1.0, "patches": 1.0, "events": 1.0, "anatomy": "fine"}
    version = {"settings": settings, "version": 1}
    stream = json.dumps(version, sort_keys=True, separators=(",", ":")).encode()
    stream += b'["mesh",4]'
    stream += b'["face_uv","<i4",[1,3]]' + struct.pack("<3i", 0, 1, 2)
    stream += b'["faces","<i4",[1,3]]' + struct.pack("<3i", 0, 1, 2)
    stream += b'["positions","<f4",[3,3]]' + struct.pack("<9f", 1, 0, 0, 0, 1, 0, 0, 0, 1)
    stream += b'["uv","<f8",[3,2]]' + struct.pack("<6d", 1, 0, 0, 1, 0, 0)
    stream += b'["graph",0]'
    assert asset_id(mesh, asked, None) == hashlib.sha256(stream).hexdigest()[:16]


def test_a_tile_size_that_follows_the_resolution_is_the_one_given(mesh: Mesh) -> None:
    small = {"resolution": 256}
    given = AssetSettings.parse({**small, "tile_size": 256})
    assert asset_id(mesh, AssetSettings.parse(small), None) == asset_id(mesh, given, None)
    given = AssetSettings.parse({"tile_size": 512})
    assert asset_id(mesh, AssetSettings(), None) == asset_id(mesh, given, None)


def test_what_was_sent_before_is_the_same_asset(mesh: Mesh, graph: WrinkleGraph) -> None:
    """A number of wrinkles was the default and of no account beside a graph; so was the unit."""
    before = AssetSettings.parse({"unit": "cm", "graph": {"wrinkles": 300_000}})
    assert asset_id(mesh, AssetSettings(), graph) == asset_id(mesh, before, graph)
    assert asset_id(mesh, before, None) != asset_id(mesh, AssetSettings().for_synthesis(), None)


def test_how_skin_is_grown_is_of_no_account_beside_a_graph(mesh: Mesh, graph: WrinkleGraph) -> None:
    grown = AssetSettings.parse({"graph": {"rank": 0.5, "patches": 0.0, "events": 2.0}})
    assert asset_id(mesh, grown, graph) == asset_id(mesh, AssetSettings(), graph)
    assert asset_id(mesh, grown, None) != asset_id(mesh, AssetSettings(), None)


def test_a_name_is_of_no_account(mesh: Mesh, graph: WrinkleGraph) -> None:
    named = AssetSettings.parse({"name": "Ada"})
    assert asset_id(mesh, named, graph) == asset_id(mesh, AssetSettings(), graph)


def test_an_age_counts_but_for_the_usual_one(mesh: Mesh) -> None:
    """Assets of before there were ages keep their ids."""
    plain, usual, old = (AssetSettings.parse({"graph": g}) for g in ({}, {"age": 35}, {"age": 65}))
    assert asset_id(mesh, plain, None) == asset_id(mesh, usual, None)
    assert asset_id(mesh, plain, None) != asset_id(mesh, old, None)


def test_what_a_graph_was_made_with_counts(mesh: Mesh, graph: WrinkleGraph) -> None:
    origins = (None, GraphOrigin(depth=0.1), GraphOrigin(depth=0.2), GraphOrigin(unit="mm"))
    settings = AssetSettings()
    ids = {asset_id(mesh, settings, replace(graph, origin=origin)) for origin in origins}
    assert len(ids) == len(origins)


@pytest.mark.parametrize("name", ["positions", "faces", "uv", "face_uv"])
def test_every_mesh_array_counts(mesh: Mesh, settings: AssetSettings, name: str) -> None:
    changed = np.roll(getattr(mesh, name), 1, axis=1)
    other = replace(mesh, **{name: changed})
    assert asset_id(other, settings, None) != asset_id(mesh, settings, None)


def test_smallest_change_of_uv_counts(mesh: Mesh, settings: AssetSettings) -> None:
    other = replace(mesh, uv=np.nextafter(mesh.uv, 100.0))
    assert asset_id(other, settings, None) != asset_id(mesh, settings, None)


def test_graph_and_settings_count(mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings) -> None:
    without_triangles = replace(graph, edge_triangle=None)
    ids = {
        asset_id(mesh, settings, None),
        asset_id(mesh, settings, graph),
        asset_id(mesh, settings, without_triangles),
        asset_id(mesh, settings.with_r_max(0.15), None),
        *(asset_id(mesh, settings, graph, stiffness) for stiffness in STIFFNESS),
    }
    assert len(ids) == 4 + len(STIFFNESS)


_corner = arrays(np.float32, (3, 3), elements=st.floats(-1e6, 1e6, width=32))


@given(_corner, _corner)
def test_ids_differ_exactly_where_positions_do(a: np.ndarray, b: np.ndarray) -> None:
    base, faces = np.eye(3, dtype=np.float32), [[0, 1, 2], [3, 4, 5]]
    uv = np.tile(np.eye(3)[:, :2], (2, 1))
    meshes = [Mesh(np.concatenate([base, x]), faces, uv, faces) for x in (a, b)]
    ids = [asset_id(mesh, AssetSettings(), None) for mesh in meshes]
    assert (ids[0] == ids[1]) == (meshes[0].positions.tobytes() == meshes[1].positions.tobytes())


@given(_corner)
def test_mesh_bytes_roundtrip(a: np.ndarray) -> None:
    base, faces = np.eye(3, dtype=np.float32), [[0, 1, 2], [3, 4, 5]]
    uv = np.tile(np.eye(3)[:, :2], (2, 1)) / 3
    mesh = Mesh(np.concatenate([base, a]), faces, uv, faces)
    again = read_mesh(write_mesh(mesh))
    assert again.positions.tobytes() == mesh.positions.tobytes()
    assert again.uv.tobytes() == mesh.uv.tobytes()
    assert again.faces.dtype == mesh.faces.dtype


def test_a_centre_is_part_of_the_id_and_of_the_file(
    mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> None:
    """Curves come back where the mesh was sent; without a centre the id is what it was."""
    moved = [replace(mesh, centre=np.array([x, 0.0, 0.0])) for x in (0.0, 512.0, 1024.0)]
    ids = [asset_id(m, settings, graph) for m in moved]
    assert ids[0] == asset_id(mesh, settings, graph)
    assert len(set(ids)) == 3
    for one in moved:
        np.testing.assert_array_equal(read_mesh(write_mesh(one)).centre, one.centre)
    assert write_mesh(moved[0]) == write_mesh(mesh)
