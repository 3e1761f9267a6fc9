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
    tiles = [engine.tiles.plan(asset, frame, query, ADDRESS).key for query in QUERIES]
    return tiles + [engine.tiles.plan_map(asset, frame, query, 1001, 2).key for query in QUERIES]


def test_a_restart_gives_the_same_bits_and_keys_and_no_frames(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        engine.frames.put(asset, "bent", BENT)
        before, named = maps(engine, asset, "bent"), keys(engine, asset, "bent")
        graph = engine.assets.graph(asset)
        facts = engine.assets.info(asset)
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert [info.name for info in engine.frames.all(asset)] == ["neutral"]
        with pytest.raises(NotFoundError, match="bent"):
            engine.tiles.plan(asset, "bent", REDRAW, ADDRESS).draw()
        engine.frames.put(asset, "bent", BENT)
        assert same(maps(engine, asset, "bent"), before)
        assert keys(engine, asset, "bent") == named
        again = engine.assets.info(asset)
        assert (again.settings, again.udims, again.pores) == (facts.settings, facts.udims, 160)
        assert same(
            list(engine.assets.graph(asset).arrays().values()), list(graph.arrays().values())
        )


@pytest.mark.slow
def test_changed_settings_survive_a_restart(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        engine.assets.change(asset, {"shape": {"wrinkle_bulge": 5.0}, "bins": {"samples": 5}})
        engine.frames.put(asset, "bent", BENT)
        before, named = maps(engine, asset, "bent"), keys(engine, asset, "bent")
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.assets.info(asset).settings["shape"]["wrinkle_bulge"] == 5.0
        engine.frames.put(asset, "bent", BENT)
        assert same(maps(engine, asset, "bent"), before)
        assert keys(engine, asset, "bent") == named


def test_the_same_content_is_the_same_asset_and_other_content_is_not(engine):
    asset = built(engine, new_asset())
    assert engine.assets.create(new_asset()).id == asset
    others = [new_asset(seed=2), new_asset(depth=0.04), new_asset(sheet(seed=2))]
    ids = {asset, *(built(engine, other) for other in others)}
    assert len(ids) == 4
    assert {info.id for info in engine.assets.all()} == ids


def test_keys_of_different_content_differ(engine):
    asset, other = built(engine, new_asset()), built(engine, new_asset(seed=2))
    engine.frames.put(asset, "bent", BENT)
    engine.frames.put(asset, "other", OTHER)
    engine.frames.put(other, "bent", BENT)
    found = [
        *keys(engine, asset, "bent"),
        *keys(engine, other, "bent"),
        *keys(engine, asset, "other")[1:4],
        engine.tiles.plan(asset, "bent", REDRAW, TileAddress(1001, 1, 1, 0)).key,
        engine.tiles.plan_map(asset, "bent", REDRAW, 1001, 3).key,
    ]
    assert len(set(found)) == len(found)


def test_keys_change_with_a_frame_and_only_then(engine):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    first = keys(engine, asset, "bent")
    engine.frames.put(asset, "another", OTHER)
    engine.frames.put(asset, "copy", BENT)
    assert keys(engine, asset, "bent") == first
    assert keys(engine, asset, "copy") == first
    engine.frames.put(asset, "bent", OTHER)
    changed = [a != b for a, b in zip(keys(engine, asset, "bent"), first, strict=True)]
    assert (
        changed == [False, True, True, True] * 2
    )  # the neutral map has nothing to do with a frame
    engine.frames.put(asset, "bent", BENT)
    assert keys(engine, asset, "bent") == first
    engine.frames.delete(asset, "bent")
    with pytest.raises(NotFoundError):
        keys(engine, asset, "bent")


CHANGES = [
    {"depth": 0.05},
    pytest.param({"response": {"alpha_w": 2.0}}, marks=pytest.mark.slow),
    {"response": {"beta_d": 3.0, "log_stretch_limit": 0.25}},
    pytest.param({"shape": {"sharpness": 5.0, "slots": 4}}, marks=pytest.mark.slow),
    pytest.param(
        {"convolve": {"blur_gain": 1.0, "sharpen_gain": 9.0, "sigma": 0.05}}, marks=pytest.mark.slow
    ),
    {"bins": {"count": 2, "samples": 5, "bits": 16, "r_max": 0.3}},
]


@pytest.mark.parametrize("changes", CHANGES)
def test_changing_an_asset_gives_the_bits_of_one_made_so(engine, changes):
    asset = built(engine, new_asset())
    engine.frames.put(asset, "bent", BENT)
    tiles = [engine.tiles.plan(asset, "bent", query, ADDRESS).draw() for query in QUERIES]
    drawn = tiles + maps(engine, asset, "bent", 2)
    before = keys(engine, asset, "bent")
    engine.assets.change(asset, changes)
    tiles = [engine.tiles.plan(asset, "bent", query, ADDRESS).draw() for query in QUERIES]
    now = zip(drawn, tiles + maps(engine, asset, "bent", 2), strict=True)
    kept = [a == b for a, b in zip(before, keys(engine, asset, "bent"), strict=True)]
    assert not all(kept)
    assert all(same([old], [new]) for key, (old, new) in zip(kept, now, strict=True) if key)
    made_so = built(engine, new_asset(**changes))
    engine.frames.put(made_so, "bent", BENT)
    for level in (0, 3):
        assert same(*(maps(engine, id, "bent", level) for id in (asset, made_so)))
    engine.assets.change(asset, {key: new_asset().settings.as_json()[key] for key in changes})
    assert keys(engine, asset, "bent") == before


def test_sigma_is_a_quarter_of_the_spacing_unless_it_is_set(engine):
    asset = built(engine, new_asset(depth=None))
    made = engine.assets.info(asset).settings
    sigma = made["convolve"]["sigma"]
    assert sigma == pytest.approx(0.25 / 0.15 * made["depth"])
    engine.assets.change(asset, {"convolve": {"sigma": 2 * sigma}})
    assert engine.assets.info(asset).settings["convolve"]["sigma"] == 2 * sigma
    engine.assets.change(asset, {"convolve": {"sigma": None}})
    assert engine.assets.info(asset).settings == made


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
        info = engine.assets.info(asset)
        assert info.state == "failed"
        assert info.reason is not None
        assert "damaged" in info.reason
        with pytest.raises(ConflictError, match="damaged"):
            engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()
        assert same(maps(engine, other, "neutral"), before)
        engine.assets.delete(asset)
        assert built(engine, new_asset()) == asset


@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_bytes(b"{}")])
def test_damaged_settings_are_noticed_and_healed_by_sending_again(tmp_path, damage):
    with running(tmp_path) as engine:
        asset, other = built(engine, new_asset()), built(engine, new_asset(seed=2))
        first = engine.assets.info(asset).settings
        engine.assets.change(asset, {"shape": {"wrinkle_bulge": 5.0}})
    damage(tmp_path / "assets" / asset / "overlay.json")
    with running(tmp_path) as engine:
        settle(engine, other)
        info = engine.assets.info(asset)
        assert (info.state, info.reason) == ("failed", "damaged in the store: send it again")
        assert built(engine, new_asset()) == asset
        assert engine.assets.info(asset).settings == first
        engine.assets.change(asset, {"shape": {"wrinkle_bulge": 4.0}})
    with running(tmp_path) as engine:
        settle(engine, asset)
        assert engine.assets.info(asset).settings["shape"]["wrinkle_bulge"] == 4.0


def test_two_engines_on_one_store_are_refused(tmp_path):
    with running(tmp_path) as engine:
        asset = built(engine, new_asset())
        with pytest.raises(StorageError, match="in use"), running(tmp_path):
            pass
        engine.tiles.plan(asset, "neutral", REDRAW, ADDRESS).draw()
    with running(tmp_path) as engine:
        settle(engine, asset)


def test_a_build_that_a_shutdown_cut_short_is_taken_up_again(tmp_path, monkeypatch):
    with running(tmp_path) as engine, monkeypatch.context() as patch:
        patch.setattr("rhytid.engine.assets.builder.mean_spacing", interrupted(engine))
        info = engine.assets.create(new_asset())
        assert finish(engine, info.job).state == "cancelled"
    with running(tmp_path) as engine:
        settle(engine, info.id)
        assert engine.assets.info(info.id).state == "ready"
        engine.tiles.plan_map(info.id, "neutral", BINNED, 1001, 0).draw()


def interrupted(engine):
    """Stands in for a step of the build, in the middle of which the engine is closed."""

    def step(*arguments):
        for job in engine.jobs._jobs.values():
            job.cancel(resumes=True)
        return 0.1

    return step


def test_queries_stay_apart():
    assert len({*QUERIES, MapQuery("redraw", "uv")}) == len(QUERIES) + 1


def test_bins_are_those_that_a_blend_reads(engine):
    asset = built(engine, new_asset(bins={"count": 1, "samples": 3}))
    manifest = engine.tiles.bins(asset)
    assert manifest.layers == {"wrinkles": 1, "pores": 1}
    assert manifest.samples == pytest.approx((-0.2, 0.0, 0.2))
    codes = engine.tiles.bin_tile(asset, TileAddress(1001, 0, 1, 1), "wrinkles", 0, 2)
    assert (codes.dtype, codes.shape) == (np.int8, (64, 64))
    for layer, bin, sample in (("wrinkles", 1, 0), ("pores", 0, 3), ("other", 0, 0)):
        with pytest.raises(NotFoundError):
            engine.tiles.bin_tile(asset, TileAddress(1001, 0, 0, 0), layer, bin, sample)
