"""Cushions and grain in `binned`: beside `redraw`, in every variant of the blend, in any tiling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.test_engine_grain import GRAINY, GRAPH, asset_of, tile_of
from meshes import deform
from pipeline.scenes import DEPTH, random_graph, sheet
from pipeline.test_stage_merges import EVERYWHERE
from rhytid.domain.painted_maps import Stiffness
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.pipeline.bins import quantisation_steps
from rhytid.pipeline.cushion import cushion_steps

R_MAX = 0.15
LINES = random_graph(24, 200)
SWOLLEN = {"cushion": 0.7, "wrinkle_bulge": 1.0}
MELLOW = {"merge": "mellow", "r_max": R_MAX}
BEST = {"preset": "best", "bins": {"r_max": R_MAX}}


def codes_of_cushions(asset):
    """The largest code of a broad layer where it is as deep as in the neutral."""
    return cushion_steps(asset.mesh.settings).max()


@pytest.mark.slow
@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
@pytest.mark.parametrize("sample", [0, 1, 2])
def test_at_a_sample_it_is_redraw_up_to_quantisation(device, sample, sampling):
    asset = asset_of(device, EVERYWHERE, LINES, SWOLLEN, bins=MELLOW)
    scale = np.float32(np.exp((sample - 1) * R_MAX))
    frame = Frame.of(EVERYWHERE.positions * scale)
    found, wanted = (
        tile_of(asset, frame, method, 1, 2, sampling) for method in ("binned", "redraw")
    )
    step = quantisation_steps(asset.mesh.settings)[:, sample].sum()
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted).max() <= step + codes_of_cushions(asset) + 5e-4 * DEPTH
    bare = asset_of(device, EVERYWHERE, LINES, {"wrinkle_bulge": 1.0}, bins=MELLOW)
    assert np.abs(tile_of(bare, frame, "binned", 1, 2, sampling) - wanted).max() > 0.2 * DEPTH


@pytest.mark.slow
def test_a_stiffness_is_followed(device):
    """Half of the stretch where it is 1/2: what the sample in the middle of the two has."""
    half = Stiffness({1001: np.full((4, 4), 0.5)})
    stiff = asset_of(device, EVERYWHERE, LINES, SWOLLEN, half, bins=MELLOW)
    plain = asset_of(device, EVERYWHERE, LINES, SWOLLEN, bins=MELLOW)
    for sampling in ("nearest", "smooth"):
        frames = (Frame.of(EVERYWHERE.positions * np.float32(np.exp(r))) for r in (0.1, 0.05))
        found, wanted = (
            tile_of(asset, frame, "binned", 1, 2, sampling)
            for asset, frame in zip((stiff, plain), frames, strict=True)
        )
        np.testing.assert_allclose(found, wanted, atol=1e-3 * DEPTH)


@pytest.mark.parametrize(
    "choice",
    [BEST, pytest.param({"bins": MELLOW}, marks=pytest.mark.slow)],
    ids=["best", "mellow"],
)
@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
def test_tiles_equal_crops_bit_for_bit(device, sampling, choice):
    shape = {**GRAINY, **SWOLLEN}
    frame = Frame.of(deform(sheet().positions, 3, 0.15))
    small, large = (asset_of(device, shape=shape, tile_size=n, **choice) for n in (64, 256))
    whole = tile_of(large, frame, "binned", sampling=sampling)
    for row, column in ((0, 0), (1, 2), (3, 3)):
        tile = tile_of(small, frame, "binned", row, column, sampling)
        y, x = 64 * row, 64 * column
        np.testing.assert_array_equal(tile, whole[y : y + 64, x : x + 64])


@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
def test_frames_by_turns_are_as_each_alone(device, sampling):
    """More frames than have buffers of lines of their own."""
    shape = {**GRAINY, **SWOLLEN}
    frames = [Frame.of(deform(sheet().positions, seed, 0.15)) for seed in range(5)]
    turns = asset_of(device, shape=shape, **BEST)
    alone = [tile_of(asset_of(device, shape=shape, **BEST), f, "binned", 1, 1, sampling)
             for f in frames]  # fmt: skip
    assert not np.array_equal(alone[0], alone[1])
    for number in (0, 1, 0, 2, 3, 0, 4, 1, 2):
        found = tile_of(turns, frames[number], "binned", 1, 1, sampling)
        np.testing.assert_array_equal(found, alone[number])


@pytest.mark.parametrize("painted", [False, True])
@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
def test_grain_is_that_of_redraw(device, sampling, painted):
    stiffness = Stiffness({1001: np.full((4, 4), 0.5)}) if painted else None
    bare = replace(GRAPH, node_weight=0 * GRAPH.node_weight, edge_weight=0 * GRAPH.edge_weight)
    asset = asset_of(device, lines=bare, shape={**GRAINY, **SWOLLEN}, stiffness=stiffness, **BEST)
    frame = Frame.of(deform(sheet().positions, 3, 0.15))
    wanted = tile_of(asset, frame, "redraw", 1, 1, sampling)
    assert wanted.std() > 0.005 * DEPTH
    found = tile_of(asset, frame, "binned", 1, 1, sampling)
    np.testing.assert_allclose(found, wanted, atol=1e-6 * DEPTH)


@pytest.mark.parametrize("wrinkles", [600, 2000])
def test_it_comes_as_close_to_redraw_as_without(device, wrinkles):
    """Of lines as close together as those of skin."""
    lines = random_graph(24, wrinkles)
    frame = Frame.of(deform(sheet().positions, 3, 0.15))
    errors = []
    # Every method has the same undulation: it would hide errors.
    even = {"undulation": 0.0}
    flat = {**even, "cushion": 0.0, "grain": 0.0, "wrinkle_bulge": 2.5}
    for shape in (flat, {**even, **GRAINY, **SWOLLEN}):
        asset = asset_of(device, lines=lines, shape=shape, **BEST)
        found, wanted = (tile_of(asset, frame, m, 1, 1) for m in ("binned", "redraw"))
        errors.append(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))
    assert errors[1] <= errors[0]
    assert errors[1] < 0.2


def test_neutral_bins_are_the_neutral_map_up_to_codes(device):
    asset = asset_of(device, lines=LINES, shape={**GRAINY, **SWOLLEN}, bins=MELLOW)
    step = quantisation_steps(asset.mesh.settings)[:, 1].sum()
    found, wanted = (tile_of(asset, NEUTRAL_FRAME, m, 1, 2) for m in ("binned", "neutral"))
    assert np.abs(found - wanted).max() <= step + codes_of_cushions(asset) + 5e-4 * DEPTH
