"""What the engine warns of, when it refuses, and what of it survives a restart."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from api.live import serving
from engine.engines import built, finish, new_asset, running, settle
from meshes import deform
from pipeline.scenes import random_graph, sheet
from rhytid.domain import warnings as codes
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import TileAddress
from rhytid.engine.assets import stored as stored_assets
from rhytid.engine.messages import MapQuery
from rhytid.errors import QueryError, StrictError
from rhytid.formats.graphs import write_graph
from rhytid.storage.records import BuildFacts
from rhytid_client import Client, Notice, RequestError, RhytidWarning

pytestmark = pytest.mark.usefixtures("no_maps_ahead")

# The sheet is 2 units wide: in feet it could be a face.
BENT = deform(sheet().positions, 1, 0.1)
SMALL = (codes.MESH_SIZE,)


def told(found):
    return tuple(warning.code for warning in found)


def test_a_mesh_that_is_right_is_not_warned_of(engine):
    assert engine.assets.create(new_asset(unit="ft"), strict=True).warnings == ()


def test_warnings_of_an_asset_survive_a_restart(tmp_path, monkeypatch):
    with running(tmp_path) as engine:
        first = engine.assets.create(new_asset(unit="cm"))
        asset = built(engine, new_asset(unit="cm"))
        assert told(first.warnings) == SMALL
        assert engine.assets.info(asset).warnings == first.warnings
    # They come from the store.
    monkeypatch.setattr(stored_assets, "mesh_warnings", None)
    with running(tmp_path) as engine:
        assert engine.assets.info(asset).warnings == first.warnings
        settle(engine, asset)
        assert engine.assets.create(new_asset(unit="cm")).warnings == first.warnings
        assert engine.assets.change(asset, {"depth": 0.01}).warnings == first.warnings


def test_an_asset_of_a_store_without_warnings_is_looked_at(tmp_path, monkeypatch):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset(unit="cm"))
        stored = engine._store.asset(asset)
    del stored.extra["warnings"]
    assert told(stored_assets._kept_warnings(stored, BuildFacts.of(stored))) == SMALL


def test_a_strict_asset_leaves_nothing(engine):
    with pytest.raises(StrictError, match="mesh-size: mesh: ") as refused:
        engine.assets.create(new_asset(unit="cm"), strict=True)
    assert told(refused.value.warnings) == SMALL
    assert engine.assets.all() == []
    assert engine._store.pending() == engine._store.ids() == []


def test_what_is_allowed_is_kept_and_warned_of(engine):
    for allow in ((), ("frame-scaled",)):
        with pytest.raises(StrictError, match="mesh-size: mesh: "):
            engine.assets.create(new_asset(unit="cm"), strict=True, allow=allow)
    info = engine.assets.create(new_asset(unit="cm"), strict=True, allow=SMALL)
    assert told(info.warnings) == SMALL
    settle(engine, info.id)
    metres = BENT * np.float32(0.01)
    scaled = (codes.FRAME_SCALED,)
    for allow in (SMALL, scaled):
        options = {"strict": True, "allow": allow}
        calls = {
            "put": lambda options=options: engine.frames.put(info.id, "a", metres, **options),
            "calibrate": lambda options=options: engine.assets.calibrate(
                info.id, metres, **options
            ),
        }
        for call in calls.values():
            if allow == scaled:
                assert told(call().warnings) == scaled
            else:
                with pytest.raises(StrictError, match="frame-scaled"):
                    call()
        if allow == scaled:
            assert told(engine.frames.warnings(info.id, metres, **options)) == scaled


def test_an_unknown_code_is_refused_with_the_known(engine):
    asset = built(engine, new_asset(unit="ft"))
    for call in (
        lambda: engine.assets.create(new_asset(unit="ft"), allow=["no"]),
        lambda: engine.frames.put(asset, "a", BENT, allow=["no"]),
        lambda: engine.assets.calibrate(asset, BENT, allow=["no"]),
        lambda: engine.frames.warnings(asset, BENT, allow=["no"]),
    ):
        with pytest.raises(QueryError, match=f"'no'.*{', '.join(codes.CODES)}"):
            call()


def test_frames_that_come_with_a_mesh(engine):
    frames = np.stack([BENT, BENT * np.float32(0.1)])
    new = replace(new_asset(unit="ft"), frames=frames)
    with pytest.raises(StrictError, match="frame-scaled: frame 0002"):
        engine.assets.create(new, strict=True)
    info = engine.assets.create(new)
    assert [(w.code, w.where) for w in info.warnings] == [(codes.FRAME_SCALED, "frame 0002")]
    finish(engine, info.job)
    assert told(engine.frames.info(info.id, "0002").warnings) == (codes.FRAME_SCALED,)
    assert (
        engine.frames.info(info.id, "0001").warnings == engine.assets.info(info.id).warnings == ()
    )


def test_frames_calibrations_and_tiles(engine):
    asset = built(engine, new_asset(unit="ft"))
    shuffled = BENT[np.random.default_rng(1).permutation(len(BENT))]
    clamp = (codes.STRETCH_AT_CLAMP,)
    calls = {
        "put": lambda **strict: engine.frames.put(asset, "a", shuffled, **strict).warnings,
        "calibrate": lambda **strict: engine.assets.calibrate(asset, shuffled, **strict).warnings,
        "tiles": lambda **strict: engine.frames.warnings(asset, shuffled, **strict),
    }
    for call in calls.values():
        with pytest.raises(StrictError, match="stretch-at-clamp"):
            call(strict=True)
    assert [info.name for info in engine.frames.all(asset)] == ["neutral"]
    assert [told(call()) for call in calls.values()] == [clamp] * 3
    assert told(engine.frames.info(asset, "a").warnings) == clamp
    assert engine.frames.info(asset, "neutral").warnings == ()
    assert engine.frames.put(asset, "b", BENT, strict=True).warnings == ()


def test_a_frame_that_hardly_moves_is_told_of_where_it_calibrates_and_nowhere_else(engine):
    asset = built(engine, new_asset(unit="ft"))
    still = sheet().positions
    with pytest.raises(StrictError, match="calibration-still: frame of the calibration"):
        engine.assets.calibrate(asset, still, strict=True)
    assert engine.assets.info(asset).settings["bins"]["r_max"] > 0.01
    info = engine.assets.calibrate(asset, still)
    assert told(info.warnings) == (codes.CALIBRATION_STILL,)
    finish(engine, info.id)
    assert told(engine.jobs.info(info.id).warnings) == (codes.CALIBRATION_STILL,)
    assert engine.frames.put(asset, "still", still, strict=True).warnings == ()
    assert engine.assets.calibrate(asset, BENT, strict=True).warnings == ()


def test_a_mesh_far_away_is_drawn_as_at_the_origin(tmp_path):
    """A million units away, as doubles."""
    near = sheet()
    far = Mesh.centred(
        near.positions.astype(float) * (1 + 1e-9) + 1e6, near.faces, near.uv, near.face_uv
    )
    query, address = MapQuery(), TileAddress(1001, 0, 0, 0)
    with running(tmp_path) as engine:
        assets = [built(engine, new_asset(mesh, unit="ft")) for mesh in (near, far)]
        tiles = []
        for asset in assets:
            engine.frames.put(asset, "bent", BENT)
            tiles.append(engine.tiles.plan(asset, "bent", query, address).draw())
        here, there = (engine.assets.curves(asset) for asset in assets)
    assert assets[0] != assets[1]
    np.testing.assert_allclose(tiles[0], tiles[1], atol=1e-5)
    np.testing.assert_allclose(there.points + there.centre, here.points + 1e6, atol=1e-6)
    with running(tmp_path) as engine:
        settle(engine, assets[1])
        assert engine.assets.info(assets[1]).centre == tuple(far.centre)
        np.testing.assert_array_equal(engine.frames.positions(assets[1], "neutral"), far.positions)


def test_content_of_an_asset_that_was_changed_since(tmp_path):
    new = new_asset(unit="ft")
    with running(tmp_path) as engine:
        asset = built(engine, new)
        assert engine.assets.create(new, strict=True).warnings == ()
        engine.assets.change(asset, {"shape": {"wrinkle_bulge": 1.0}})
        (warning,) = engine.assets.create(new).warnings
        assert (warning.code, warning.where) == (codes.SETTINGS_CHANGED, f"asset {asset}")
        assert "shape.wrinkle_bulge is 1.0, sent was 2.5" in warning.detail
        assert engine.assets.info(asset).warnings == ()
        with pytest.raises(StrictError, match="settings-changed"):
            engine.assets.create(new, strict=True)
        allowed = engine.assets.create(new, strict=True, allow=[codes.SETTINGS_CHANGED])
        assert told(allowed.warnings) == (codes.SETTINGS_CHANGED,)
    with running(tmp_path) as engine:
        assert told(engine.assets.create(new).warnings) == (codes.SETTINGS_CHANGED,)
        settle(engine, asset)
        engine.assets.change(asset, {"shape": {"wrinkle_bulge": 2.5}})
        finish(engine, engine.assets.calibrate(asset, BENT).id)
        assert engine.assets.create(new, strict=True).warnings == ()


def test_clients_are_told_of_changed_and_of_unused_settings(engine):
    obj = b"v 0 0 0\nv 9 0 0\nv 0 9 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    graph = write_graph(random_graph(1))
    settings = {"resolution": 256, "tile_size": 64, "graph": {"age": 65, "lines": "level"}}
    sent = {"name": "a.obj", "settings": settings, "graph": graph}
    with serving(engine) as http, Client(str(http.base_url)) as client:
        with pytest.warns(RhytidWarning, match=r"graph\.lines \(\"level\"\), graph\.age \(65\.0\)"):
            asset = client.wait(client.create_asset(obj, **sent))
        client.change_asset(asset, {"depth": 0.5})
        with pytest.warns(RhytidWarning):
            again = client.create_asset(obj, **sent)
    assert told(again.warnings) == (codes.SETTINGS_CHANGED, codes.SETTINGS_UNUSED)
    assert "depth is 0.5, sent was null" in again.warnings[0].detail


def test_clients_are_told_of_arrays_that_nothing_reads(engine):
    """In every answer to who sends them, and not of the asset, which has none of them."""
    corners = np.float32([[0, 0, 0], [9, 0, 0], [0, 9, 0]])
    arrays = {"positions": corners, "faces": [[0, 1, 2]], "uv": np.eye(3)[:, :2], "frame": corners}
    packed = io.BytesIO()
    np.savez(packed, face_uv=[[0, 1, 2]], **arrays, hair=corners)
    sent = {"name": "a.npz", "settings": {"resolution": 256, "tile_size": 64}}
    with serving(engine) as http, Client(str(http.base_url)) as client:
        for _ in range(2):
            with pytest.warns(RhytidWarning, match=r"not read: 'frame' \(did you mean frames\?\)"):
                made = client.create_asset(packed.getvalue(), **sent)
            left = {notice.code: notice.detail for notice in made.notices}["arrays-not-read"]
            assert left == "the mesh file has arrays that are not read: 'hair'"
            asset = client.wait(made)
        assert client.asset(asset).warnings == ()
        assert "arrays-not-read" not in {notice.code for notice in client.asset(asset).notices}
        with pytest.raises(RequestError, match="arrays-unused"):
            client.create_asset(packed.getvalue(), **sent, strict=True)


def test_grain_that_is_not_drawn_is_a_notice_and_strict_lets_it_be(engine):
    new = new_asset(unit="ft", preset="best")
    asset = built(engine, new)
    info = engine.assets.create(new, strict=True)
    assert [notice.code for notice in info.notices] == ["grain-not-drawn"]
    with serving(engine) as http, Client(str(http.base_url)) as client:
        assert client.asset(asset).notices == (Notice("grain-not-drawn", info.notices[0].detail),)
        assert client.change_asset(asset, {"shape": {"grain": 0}}).notices == ()
