"""What survives a restart, and what content keys promise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.engines import (
    BINNED,
    QUERIES,
    REDRAW,
    built,
    finish,
    maps,
    new_asset,
    running,
    same,
    settle,
)
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery
from rhytid.errors import ConflictError, NotFoundError, StorageError

ADDRESS = TileAddress(1001, 1, 0, 1)
BENT = deform(sheet().positions, 1, 0.15)
OTHER = deform(sheet().positions, 2, 0.15)


def keys(engine, asset, frame):
    tiles = [engine.tile_key(asset, frame, query, ADDRESS) for query in QUERIES]
    return tiles + [engine.map_key(asset, frame, query, 1001, 2) for query in QUERIES]


def test_a_restart_gives_the_same_bits_and_keys_and_no_frames(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        engine.put_frame(asset, "bent", BENT)
        before, named = maps(engine, asset, "bent"), keys(engine, asset, "bent")
        graph = engine.graph(asset)
        facts = engine.asset(asset)
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert [info.name for info in engine.frames(asset)] == ["neutral"]
        with pytest.raises(NotFoundError, match="bent"):
            engine.tile(asset, "bent", REDRAW, ADDRESS)
        engine.put_frame(asset, "bent", BENT)
        assert same(maps(engine, asset, "bent"), before)
        assert keys(engine, asset, "bent") == named
        again = engine.asset(asset)
        assert (again.settings, again.udims, again.pores) == (facts.settings, facts.udims, 160)
        assert same(list(engine.graph(asset).arrays().values()), list(graph.arrays().values()))


def test_changed_settings_survive_a_restart(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        engine.change_asset(asset, {"shape": {"wrinkle_bulge": 5.0}, "bins": {"samples": 5}})
        engine.put_frame(asset, "bent", BENT)
        before, named = maps(engine, asset, "bent"), keys(engine, asset, "bent")
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.asset(asset).settings["shape"]["wrinkle_bulge"] == 5.0
        engine.put_frame(asset, "bent", BENT)
        assert same(maps(engine, asset, "bent"), before)
        assert keys(engine, asset, "bent") == named


def test_the_same_content_is_the_same_asset_and_other_content_is_not(engine):
    asset = built(engine, new_asset())
    assert engine.create_asset(new_asset()).id == asset
    others = [new_asset(seed=2), new_asset(depth=0.04), new_asset(sheet(seed=2))]
    ids = {asset, *(built(engine, other) for other in others)}
    assert len(ids) == 4
    assert {info.id for info in engine.assets()} == ids


def test_keys_of_different_content_differ(engine):
    asset, other = built(engine, new_asset()), built(engine, new_asset(seed=2))
    engine.put_frame(asset, "bent", BENT)
    engine.put_frame(asset, "other", OTHER)
    engine.put_frame(other, "bent", BENT)
    found = [
        *keys(engine, asset, "bent"),
        *keys(engine, other, "bent"),
        *keys(engine, asset, "other")[1:4],
        engine.tile_key(asset, "bent", REDRAW, TileAddress(1001, 1, 1, 0)),
        engine.map_key(asset, "bent", REDRAW, 1001, 3),
    ]
    assert len(set(found)) == len(found)


def test_keys_change_with_a_frame_and_only_then(engine):
    asset = built(engine, new_asset())
    engine.put_frame(asset, "bent", BENT)
    first = keys(engine, asset, "bent")
    engine.put_frame(asset, "another", OTHER)
    engine.put_frame(asset, "copy", BENT)
    assert keys(engine, asset, "bent") == first
    assert keys(engine, asset, "copy") == first
    engine.put_frame(asset, "bent", OTHER)
    changed = [a != b for a, b in zip(keys(engine, asset, "bent"), first, strict=True)]
    assert (
        changed == [False, True, True, True] * 2
    )  # the neutral map has nothing to do with a frame
    engine.put_frame(asset, "bent", BENT)
    assert keys(engine, asset, "bent") == first
    engine.delete_frame(asset, "bent")
    with pytest.raises(NotFoundError):
        keys(engine, asset, "bent")


CHANGES = [
    {"depth": 0.05},
    {"response": {"alpha_w": 2.0}},
    {"response": {"beta_d": 3.0, "log_stretch_limit": 0.25}},
    {"shape": {"sharpness": 5.0, "slots": 4}},
    {"convolve": {"blur_gain": 1.0, "sharpen_gain": 9.0, "sigma": 0.05}},
    {"bins": {"count": 2, "samples": 5, "bits": 16, "r_max": 0.3}},
]


@pytest.mark.parametrize("changes", CHANGES)
def test_changing_an_asset_gives_the_bits_of_one_made_so(engine, changes):
    asset = built(engine, new_asset())
    engine.put_frame(asset, "bent", BENT)
    tiles = [engine.tile(asset, "bent", query, ADDRESS) for query in QUERIES]
    drawn = tiles + maps(engine, asset, "bent", 2)
    before = keys(engine, asset, "bent")
    engine.change_asset(asset, changes)
    tiles = [engine.tile(asset, "bent", query, ADDRESS) for query in QUERIES]
    now = zip(drawn, tiles + maps(engine, asset, "bent", 2), strict=True)
    kept = [a == b for a, b in zip(before, keys(engine, asset, "bent"), strict=True)]
    assert not all(kept)
    assert all(same([old], [new]) for key, (old, new) in zip(kept, now, strict=True) if key)
    made_so = built(engine, new_asset(**changes))
    engine.put_frame(made_so, "bent", BENT)
    for level in (0, 3):
        assert same(*(maps(engine, id, "bent", level) for id in (asset, made_so)))
    engine.change_asset(asset, {key: new_asset().settings.as_json()[key] for key in changes})
    assert keys(engine, asset, "bent") == before


def test_sigma_is_a_quarter_of_the_spacing_unless_it_is_set(engine):
    asset = built(engine, new_asset(depth=None))
    made = engine.asset(asset).settings
    sigma = made["convolve"]["sigma"]
    assert sigma == pytest.approx(0.25 / 0.15 * made["depth"])
    engine.change_asset(asset, {"convolve": {"sigma": 2 * sigma}})
    assert engine.asset(asset).settings["convolve"]["sigma"] == 2 * sigma
    engine.change_asset(asset, {"convolve": {"sigma": None}})
    assert engine.asset(asset).settings == made


def test_a_damaged_asset_fails_with_its_reason_and_the_others_live(tmp_path):
    with running(tmp_path) as engine:
        asset, other = built(engine, new_asset()), built(engine, new_asset(seed=2))
        before = maps(engine, other, "neutral")
    stored = tmp_path / "assets" / asset / "asset" / "graph.safetensors"
    data = bytearray(stored.read_bytes())
    data[len(data) // 2] ^= 1
    stored.write_bytes(data)
    with running(tmp_path) as engine:
        settle(engine, other)
        info = engine.asset(asset)
        assert info.state == "failed"
        assert info.reason is not None
        assert "damaged" in info.reason
        with pytest.raises(ConflictError, match="damaged"):
            engine.tile(asset, "neutral", REDRAW, ADDRESS)
        assert same(maps(engine, other, "neutral"), before)
        engine.delete_asset(asset)
        assert built(engine, new_asset()) == asset


@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_bytes(b"{}")])
def test_damaged_settings_are_noticed_and_healed_by_sending_again(tmp_path, damage):
    with running(tmp_path) as engine:
        asset, other = built(engine, new_asset()), built(engine, new_asset(seed=2))
        first = engine.asset(asset).settings
        engine.change_asset(asset, {"shape": {"wrinkle_bulge": 5.0}})
    damage(tmp_path / "assets" / asset / "overlay.json")
    with running(tmp_path) as engine:
        settle(engine, other)
        info = engine.asset(asset)
        assert (info.state, info.reason) == ("failed", "damaged in the store: send it again")
        assert built(engine, new_asset()) == asset
        assert engine.asset(asset).settings == first
        engine.change_asset(asset, {"shape": {"wrinkle_bulge": 4.0}})
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.asset(asset).settings["shape"]["wrinkle_bulge"] == 4.0


def test_two_engines_on_one_store_are_refused(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        with pytest.raises(StorageError, match="in use"), running(tmp_path):
            pass
        engine.tile(asset, "neutral", REDRAW, ADDRESS)
    with running(tmp_path) as engine:
        settle(engine, asset)


def test_a_build_that_a_shutdown_cut_short_is_taken_up_again(tmp_path, monkeypatch):
    with running(tmp_path) as engine, monkeypatch.context() as patch:
        patch.setattr("rhytid.engine.building.mean_spacing", interrupted(engine))
        info = engine.create_asset(new_asset())
        assert finish(engine, info.job).state == "cancelled"
    with running(tmp_path) as engine:
        settle(engine, info.id)
        assert engine.asset(info.id).state == "ready"
        engine.map(info.id, "neutral", BINNED, 1001, 0)


def interrupted(engine):
    """Stands in for a step of the build, in the middle of which the engine is closed."""

    def step(*arguments):
        for job in engine._jobs._jobs.values():
            job.cancel(resumes=True)
        return 0.1

    return step


def test_queries_stay_apart():
    assert len({*QUERIES, MapQuery("redraw", "uv")}) == len(QUERIES) + 1


def test_bins_are_those_that_a_blend_reads(engine):
    asset = built(engine, new_asset(bins={"count": 1, "samples": 3}))
    manifest = engine.bins(asset)
    assert manifest.layers == {"wrinkles": 1, "pores": 1}
    assert manifest.samples == pytest.approx((-0.2, 0.0, 0.2))
    codes = engine.bin_tile(asset, TileAddress(1001, 0, 1, 1), "wrinkles", 0, 2)
    assert (codes.dtype, codes.shape) == (np.int8, (64, 64))
    for layer, bin, sample in (("wrinkles", 1, 0), ("pores", 0, 3), ("other", 0, 0)):
        with pytest.raises(NotFoundError):
            engine.bin_tile(asset, TileAddress(1001, 0, 0, 0), layer, bin, sample)
