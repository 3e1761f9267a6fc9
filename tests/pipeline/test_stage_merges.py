"""How the layers of the fast method meet: mellow and min, with the depth drawn in or factored."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from meshes import deform
from pairs import pairs
from pipeline.binned import BinnedScene
from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.bins import layers, map_count, quantisation_steps

AT = (64, 128)
GRAPH = random_graph(24, 200)
R_MAX = 0.15
MERGES = ("min", "soft", "signed", "mellow")
DEPTHS = [
    {"depth_factored": False},
    {"depth_factored": True},
    {"depth_factored": True, "tilt": True},
]
# Every merge and every way of the depth, each in a program of its own.
DIFFERENT = [{"merge": merge, **DEPTHS[i % 3]} for i, merge in enumerate(MERGES)]
ALL_MERGES = [{"merge": merge, **depth} for merge, depth in product(MERGES, DEPTHS)]


# One sheet under the whole map and all around it, so that everything stretches alike.
EVERYWHERE = Mesh(
    [[0, 0, 0], [3, 0, 0], [3, 3, 0.5], [0, 3, 0]],
    [[0, 1, 2], [0, 2, 3]],
    [[-1, -1], [2, -1], [2, 2], [-1, 2]],
    [[0, 1, 2], [0, 2, 3]],
)


def named(choice):
    return "-".join(map(str, choice.values())) if isinstance(choice, dict) else str(choice)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "samples", "pore_samples", "bits", "merge", "depth"),
    pairs([1, 4, 16], [3, 5, 7], [None, 3, 7], [8, 16], MERGES, DEPTHS),
    ids=named,
)
def test_blending_is_that_of_the_reference(
    device, count, samples, pore_samples, bits, merge, depth
):
    sizes = {"count": count, "samples": samples, "pore_samples": pore_samples or samples}
    settings = settings_of(bins={**sizes, "bits": bits, "merge": merge, **depth, "r_max": R_MAX})
    made = BinnedScene(device, sheet(), GRAPH, settings)
    positions = deform(made.mesh.positions, 5, 0.15)
    logs = made.reference_logs(positions)[0]
    assert (np.abs(logs) > R_MAX).mean() > 0.2
    wanted, sure = made.reference_blend(made.layers(), positions)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    # r is exact to 1e-5, and sigma_d of it, which a factored depth is multiplied by, to 1e-4.
    error = np.abs(made.blended(positions) - wanted)[sure].max()
    assert error <= (4e-4 if depth["depth_factored"] else 1e-4) * DEPTH


@pytest.mark.parametrize(
    ("sharpness", "merge"),
    [
        pytest.param(sharpness, merge, marks=() if (i + j) % 2 else pytest.mark.slow)
        for i, sharpness in enumerate([6.0, 0.5])
        for j, merge in enumerate(DIFFERENT)
    ],
    ids=named,
)
def test_a_softer_merge_is_that_of_the_reference(device, sharpness, merge):
    shape = {"sharpness": sharpness, "slots": 3, "pore_bulge": 4.0}
    made = BinnedScene(device, sheet(), GRAPH, settings_of(bins=merge, shape=shape))
    positions = deform(made.mesh.positions, 5, 0.15)
    wanted, sure = made.reference_blend(made.layers(), positions)
    error = np.abs(made.blended(positions) - wanted)[sure].max()
    assert error <= (4e-4 if merge["depth_factored"] else 1e-4) * DEPTH


@pytest.mark.parametrize(("sample", "bits", "slots"), pairs([0, 1, 2], [8, 16], [1, 4, 16]))
def test_mellow_at_a_sample_is_redraw_up_to_quantisation(device, sample, bits, slots):
    """Growing alike everywhere, wrinkles and pores stand at one sample, so nothing is interpolated.

    The layers merge as their elements did, x = log(1 + sum of (e^(beta x_l) - 1)) / beta, and each
    slope e^(beta x_l) / (1 + sum) is at most 1: x errs by no more than the layers together, each by
    half a step, once in the valleys and once in the bulges.
    """
    bins = {"merge": "mellow", "bits": bits, "r_max": R_MAX}
    settings = settings_of(bins=bins, shape={"slots": slots, "pore_bulge": 4.0})
    made = BinnedScene(device, EVERYWHERE, GRAPH, settings)
    scale = np.exp((sample - 1) * R_MAX)
    positions = (made.mesh.positions * scale).astype(np.float32)
    found = made.blended(positions).reshape(64, 64)
    wanted = made.redrawn(positions, at=AT, side=64)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert (wanted > 0.01 * DEPTH).any()
    bound = quantisation_steps(settings)[:, sample].sum()
    # Positions round, Alg. 1 holds an epsilon of 1e-6 beside 0.6, both are drawn within 1e-4.
    assert np.abs(found - wanted).max() <= bound + 3e-4 * DEPTH


@pytest.mark.slow
def test_merges_come_closer_to_redraw_in_their_order(device):
    """What mellow is there for: the minimum loses what meets and every bulge beside a bin."""
    errors = {}
    for merge in ("min", "soft", "signed", "mellow"):
        settings = settings_of(bins={"merge": merge, "bits": 16})
        made = BinnedScene(device, sheet(), GRAPH, settings)
        away = made.blended(None).reshape(64, 64) - made.redrawn(None, at=AT, side=64)
        errors[merge] = np.sqrt(np.square(away).mean())
    assert errors["mellow"] < 0.01 * errors["min"]
    assert errors["signed"] < errors["soft"] < 0.5 * errors["min"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("growth", "sharpness", "merge"), pairs([1e-3, 1e3], [0.1, 20.0], DIFFERENT), ids=named
)
def test_the_extremes_of_the_settings_stay_finite(device, growth, sharpness, merge):
    """Depth scales at their clamp, the sharpest and the softest merge, and a crowd of wrinkles."""
    settings = settings_of(
        bins={**merge, "r_max": 4.0, "count": 16},
        response={"alpha_d": 64.0, "beta_d": 64.0, "alpha_w": 64.0, "log_stretch_limit": 4.0},
        shape={"sharpness": sharpness, "wrinkle_bulge": 9.0, "pore_bulge": 9.0},
    )
    made = BinnedScene(device, sheet(), random_graph(25, 600, (0.05, 0.1)), settings)
    found = made.blended((made.mesh.positions * growth).astype(np.float32))
    assert np.isfinite(found).all()
    # 17 layers of 4.8 depths at most, each valleys or bulges, which soft merging adds up.
    assert np.abs(found).max() <= 17 * 4.8 * DEPTH
    assert growth > 1 or np.abs(found).max() > 2.0 * DEPTH


@pytest.mark.parametrize("merge", ALL_MERGES, ids=named)
def test_layers_name_every_map_once(merge):
    bins = settings_of(bins={**merge, "count": 8, "pore_samples": 5}).bins
    found = layers(bins)
    apart = merge["merge"] == "mellow"
    extra = {"wrinkle_bulges", "pore_bulges"} if apart else set()
    tilts = {"wrinkle_tilts"} if bins.tilt else set()
    assert set(found) == {"wrinkles", "pores"} | extra | tilts
    places = [
        first + sample
        for name, firsts in found.items()
        for first in firsts
        for sample in range(1 if name in tilts else 5 if name.startswith("pore") else 3)
    ]
    assert sorted(places) == list(range(map_count(bins)))
    assert {len(firsts) for name, firsts in found.items() if name.startswith("w")} == {8}


def test_each_part_of_a_map_has_its_sign(device):
    settings = settings_of(bins={"merge": "mellow"}, shape={"pore_bulge": 4.0})
    codes = BinnedScene(device, sheet(), GRAPH, settings).codes()
    assert codes.shape == (5, 3, 2, 64 * 64)
    assert codes.min() == 0  # the scene turns the stored, negative, valleys
    assert (codes.max(axis=(1, 3)) > 5).all()
