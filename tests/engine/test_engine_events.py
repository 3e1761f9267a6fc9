"""Events in what is drawn: every method adds the same, level by level and tile by tile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from rhytid.domain.events import MOST_KIND
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets import additions
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery

SIDE, TILE = 256, 64
_PLAIN = random_graph(1, 60, half_width=(0.01, 0.08))
_KINDS = (np.arange(_PLAIN.pores) % (MOST_KIND + 1)).astype(np.int32)
EVENTFUL = replace(_PLAIN, node_kind=_KINDS)
WITHOUT = replace(_PLAIN, node_weight=_PLAIN.node_weight * (_KINDS == 0))


def asset_of(device, graph, stiffness=None, **changes):
    settings = settings_of(**changes).resolved(0.1)
    asset = DeviceAsset(device, sheet(), settings, stiffness)
    asset.mesh.locate(graph)
    asset.mesh.install(asset.mesh.prepare(graph, settings), settings)
    return asset


def drawn(asset, frame, method, sampling="nearest"):
    """Level 0, by tiles of 64²."""
    query = MapQuery(method, sampling=sampling)
    found = np.zeros((SIDE, SIDE), np.float32)
    for row in range(0, SIDE, TILE):
        for column in range(0, SIDE, TILE):
            place = (row, column, TILE)
            (out,) = asset.drawing.squares(frame, query, 1001, [place])
            part = asset.mesh.device.read(out, (TILE, TILE), np.float32)
            found[row : row + TILE, column : column + TILE] = part
    return found


def frame_of(asset):
    return Frame.of(deform(asset.mesh.neutral, 3))


def added(device, method, sampling="nearest", stiffness=None, posed=True, **changes):
    """What events add to a frame."""
    maps = []
    for graph in (EVENTFUL, WITHOUT):
        asset = asset_of(device, graph, stiffness, **changes)
        maps.append(drawn(asset, frame_of(asset) if posed else NEUTRAL_FRAME, method, sampling))
        asset.release()
    return maps[0] - maps[1]


@pytest.mark.parametrize("preset", ["paper", "best"])
@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
@pytest.mark.parametrize("method", ["binned", "convolved"])
def test_every_method_adds_what_redraw_adds(device, method, sampling, preset):
    expected = added(device, "redraw", sampling, preset=preset)
    assert expected.max() > 5 * DEPTH
    assert expected.min() < -2 * DEPTH
    np.testing.assert_allclose(
        added(device, method, sampling, preset=preset), expected, atol=1e-5 * DEPTH * 16
    )


def test_the_neutral_has_them_unstretched(device):
    still = added(device, "redraw", posed=False)
    np.testing.assert_allclose(added(device, "neutral"), still, atol=1e-5 * DEPTH * 16)
    assert np.abs(added(device, "redraw") - still).max() > 0.1 * DEPTH


def test_rigid_skin_leaves_them_as_they_are(device):
    rigid = Stiffness({1001: np.zeros((4, 4), np.float32)})
    still = added(device, "redraw", posed=False)
    for method in ("redraw", "binned"):
        found = added(device, method, stiffness=rigid)
        np.testing.assert_allclose(found, still, atol=1e-5 * DEPTH * 16)


def test_coarse_levels_are_means_of_what_is_drawn(device):
    asset = asset_of(device, EVENTFUL)
    frame = frame_of(asset)
    fine = asset.drawing.to_host(frame, MapQuery(), 1001, 0, 0, 0, SIDE).astype(np.float64)
    np.testing.assert_array_equal(fine.astype(np.float32), drawn(asset, frame, "redraw"))
    coarse = asset.drawing.to_host(frame, MapQuery(), 1001, 1, 0, 0, SIDE // 2)
    means = fine.reshape(SIDE // 2, 2, SIDE // 2, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse, means, atol=1e-6 * DEPTH * 16)


def test_a_layer_of_codes_has_the_neutral(device):
    asset = asset_of(device, EVENTFUL, preset="best")
    manifest, at = asset.bins.manifest(), TileAddress(1001, 0, 1, 2)
    assert manifest.layers["events"] == 1
    steps = manifest.steps["events"]
    codes = [asset.bins.layer_codes(at, "events", None, sample) for sample in (0, 1)]
    found = sum(step * code.astype(float) for step, code in zip(steps, codes, strict=True))
    bare = asset_of(device, WITHOUT, preset="best")
    square = (TILE, 2 * TILE, TILE)
    maps = [
        one.mesh.device.read(
            one.drawing.squares(NEUTRAL_FRAME, MapQuery("neutral"), 1001, [square])[0],
            (TILE, TILE),
            np.float32,
        ).astype(float)
        for one in (asset, bare)
    ]
    np.testing.assert_allclose(found, maps[0] - maps[1], atol=steps[1] + 1e-5 * DEPTH)
    assert "events" not in bare.bins.manifest().layers
    assert asset.bins.manifest().depth_exponents["events"] == pytest.approx(3.5)


def test_both_samples_of_codes_are_drawn_once(device, monkeypatch):
    """And those of the next square anew; no more than one square is kept."""
    asset, drawn = asset_of(device, EVENTFUL, preset="best"), []
    add = additions.add_events
    monkeypatch.setattr(additions, "add_events", lambda *a: drawn.append(a[4]) or add(*a))
    for column in (1, 2, 1):
        for sample in (0, 1):
            asset.bins.layer_codes(TileAddress(1001, 0, 1, column), "events", None, sample)
    assert [square[1] for square in drawn] == [TILE, 2 * TILE, TILE]
    assert asset.mesh.cache.find("event heights", 1001, TILE, TILE, TILE) is not None
    assert asset.mesh.cache.find("event heights", 1001, TILE, 2 * TILE, TILE) is None


def test_precomputed_maps_hold_no_events(device):
    at = TileAddress(1001, 0, 1, 1)
    one, other = (
        asset_of(device, g, preset="best").bins.codes(at, -1) for g in (EVENTFUL, WITHOUT)
    )
    np.testing.assert_array_equal(one, other)
