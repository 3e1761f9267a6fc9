"""Patches: how large they are, how far they differ, and what they leave as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from reference import patches as reference
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.painted_maps import Controls
from rhytid.domain.patch_noise import (
    CELLS_OF_WAVE,
    LEAST,
    MOST_DEVIATION,
    STRENGTH_SALT,
    placement,
    table,
)
from rhytid.domain.skin import REGIONS
from rhytid.pipeline.grain import MOST_UNDULATION
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.painted_fields import PaintedFields
from rhytid.synthesis.patches import Patches
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.painted import painted, right

Floats = NDArray[np.float64]
# Of a sheet that is seen at points, millimetres.
SIDE, STEP = 240.0, 0.5
SETTINGS = GraphSettings(spacing=0.5)
NAMES = ("strength", "beside_lines", "density", "pores", "pore_radius")
EVEN = replace(SETTINGS, patches=0.0)


def surface(side: float = SIDE) -> Surface:
    return Surface.of(sheets.sheet(scale=side))


def patches(unit: str | None = "mm", seed: int = 1, side: float = SIDE) -> Patches:
    found = Patches.of(surface(side), replace(SETTINGS, seed=seed), unit)
    assert found is not None
    return found


def points(steps: int = 240) -> tuple[NDArray[np.int64], Floats]:
    """Triangles and uv of a grid of points, which is off the edges of triangles."""
    return located((np.indices((steps, steps)).reshape(2, -1).T[:, ::-1] + 0.37) / steps)


def located(uv: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Triangles and uv of points, shares (N, 2) of the sides of a sheet."""
    n = 24
    cell = (uv * n).astype(int)
    upper = (uv * n - cell)[:, 1] > (uv * n - cell)[:, 0]
    return 2 * (cell[:, 1] * n + cell[:, 0]) + upper, 0.1 + 0.8 * uv


def ones(count: int) -> NDArray[np.float32]:
    return np.ones(count, np.float32)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("amount", [0.5, 1.0, 2.3])
def test_factors_are_1_in_the_mean_and_bounded(name: str, amount: float) -> None:
    triangle, uv = points()
    found = patches().factor(name, amount * ones(len(uv)), triangle, uv)
    low, high = patches().bounds(name, amount)
    # Lines have a little more, which is lost where weights end at 1.
    more = 1.05 if name == "strength" else 1.0
    assert found.mean() == pytest.approx(more, abs=0.06 if name == "strength" else 0.03)
    assert low <= found.min() < found.max() <= high
    assert high < 6.0


def test_deviation_is_in_proportion_to_patchiness() -> None:
    triangle, uv = points()
    logs = [
        np.log(patches().factor("strength", amount * ones(len(uv)), triangle, uv)).std()
        for amount in (0.0, 0.5, 1.0)
    ]
    assert logs[0] == 0.0
    assert logs[1:] == pytest.approx([0.119, 0.236], rel=0.06)


def test_lines_vary_farther_than_swells() -> None:
    """Swells end at MOST_DEVIATION; what is more than that, as with `graph.patches` 2 in the
    patchiest region, lines have to show, up to the deviation at which they end."""
    most, end = 2.0 * max(region.patchiness for region in REGIONS.values()), 1.35
    triangle, uv = points()
    logs = [
        np.log(patches().factor("strength", amount * ones(len(uv)), triangle, uv) - LEAST).std()
        for amount in (1.0, most)
    ]
    assert logs[1] == pytest.approx(min(most * logs[0], end), rel=0.01)
    assert logs[1] > 1.2 * MOST_DEVIATION


def test_swells_of_the_patchiest_region_are_higher_in_lively_patches() -> None:
    """They end at MOST_UNDULATION: were they near it everywhere, patches would only be quieter."""
    patchiest = max(REGIONS.values(), key=lambda region: region.patchiness)
    assert 1.5 * patchiest.undulation < MOST_UNDULATION


def test_the_liveliest_patch_of_a_forehead_has_no_pits() -> None:
    """Pores are at most twice as deep as elsewhere; at three times they look punched."""
    forehead = REGIONS["forehead"].patchiness
    most = [patches().bounds(name, forehead)[1] for name in ("beside_lines", "pores")]
    assert 1.5 < most[0] * most[1] < 2.0


def curvature(step: float) -> float:
    """Root mean square of second differences over steps of so many millimetres, over their square,
    along three lines across a sheet."""
    u, found = np.arange(0.02, 0.98, step / SIDE), []
    for v in (0.23, 0.52, 0.81):
        triangle, uv = located(np.column_stack([u, np.full(len(u), v) + 0.1 * u]))
        turn = patches().turn(ones(len(u)), triangle, uv).astype(np.float64)
        found.append(np.diff(turn, 2) / step**2)
    return float(np.sqrt(np.mean(np.square(found))))


def test_fields_have_no_kinks() -> None:
    """Of a kink second differences grow as steps get shorter; linear between the nodes of a table
    fields had one at the side of every cell, where patches ended along straight lines."""
    assert curvature(0.125) < 1.4 * curvature(0.5)


@pytest.mark.parametrize(("unit", "side"), [("mm", SIDE), ("cm", SIDE / 10), (None, SIDE)])
def test_patches_are_millimetres_wide(unit: str | None, side: float) -> None:
    """Half way down the correlation, and where there is none left; without a unit the spacing says
    the scale, here half a millimetre to the unit of the mesh."""
    triangle, uv = points(480)
    found = np.log(patches(unit, side=side).factor("strength", ones(len(uv)), triangle, uv))
    grid = (found - found.mean()).reshape(480, 480)
    power = np.abs(np.fft.fft2(grid)) ** 2
    wave = np.fft.fftfreq(480, STEP)
    waves = np.hypot(wave[:, None], wave)
    correlation = np.fft.ifft2(power).real[0, :60] / np.fft.ifft2(power).real[0, 0]
    half = STEP * np.argmax(correlation < 0.5)
    assert 2.0 <= half <= 4.5
    assert np.abs(correlation[int(15 / STEP) :]).max() < 0.25
    # A slice of waves is made of longer ones, but hardly of shorter ones.
    assert power[waves > 1 / 3.5].sum() < 0.02 * power.sum()
    assert power[waves < 1 / 12].sum() > 0.2 * power.sum()
    assert power[waves > 1 / 12].sum() > 0.2 * power.sum()


@pytest.mark.parametrize(
    ("name", "deviation", "most", "salt"),
    [("density", 0.18, 0.3, 12), ("events", 0.6, 0.9, STRENGTH_SALT)],
)
def test_factors_are_those_of_the_reference(
    name: str, deviation: float, most: float, salt: int
) -> None:
    """In double, at more places than are looked at together, over 190 cells and their edges."""
    triangle, uv = points(360)
    ground, amount = surface(), np.linspace(0.0, 2.0, len(uv), dtype=np.float32)
    found = patches().factor(name, amount, triangle, uv)
    places, cell = ground.place(triangle, uv) * ground.scale, patches().size / CELLS_OF_WAVE
    wanted = reference.factor(
        places, cell, table(), np.array(placement(1, salt)), amount, deviation, most, 0.0
    )
    assert np.ptp(places / cell, axis=0).max() > 150
    np.testing.assert_allclose(found, wanted, rtol=2e-4)


def test_values_are_of_the_place_alone() -> None:
    triangle, uv = points(120)
    all_at_once = patches().factor("pores", ones(len(uv)), triangle, uv)
    order = np.random.default_rng(1).permutation(len(uv))
    shuffled = patches().factor("pores", ones(len(uv)), triangle[order], uv[order])
    np.testing.assert_array_equal(shuffled, all_at_once[order])
    one = [patches().factor("pores", ones(1), triangle[i : i + 1], uv[i : i + 1]) for i in (0, 77)]
    np.testing.assert_array_equal(np.concatenate(one), all_at_once[[0, 77]])


def test_both_sides_of_a_seam_have_the_same_values() -> None:
    mesh = sheets.tube()
    tube = Surface.of(mesh)
    field = Patches(tube, 1, 0.05)
    left = np.flatnonzero((np.isclose(tube.uv[..., 0], 0.1)).sum(axis=1) == 2)
    right_side = np.flatnonzero((np.isclose(tube.uv[..., 0], 0.9)).sum(axis=1) == 2)
    v = np.linspace(0.12, 0.88, 40)
    values = []
    for side, u in ((left, 0.1), (right_side, 0.9)):
        low, high = (getattr(tube.uv[side, :, 1], way)(axis=1) for way in ("min", "max"))
        at = np.array([side[(low <= y) & (y <= high)][0] for y in v])
        uv = np.stack([np.full(len(v), u), v], axis=1)
        values.append(field.factor("strength", ones(len(v)), at, uv))
    np.testing.assert_allclose(*values, rtol=1e-5)
    assert values[0].std() > 0.05


def test_properties_and_seeds_have_fields_of_their_own_and_sides_differ() -> None:
    triangle, uv = points()
    even = ones(len(uv))
    fields = [
        np.log(patches().factor(name, even, triangle, uv))
        for name in ("strength", "density", "pores")
    ]
    fields.append(patches().turn(even, triangle, uv))
    fields.append(np.log(patches(seed=2).factor("strength", even, triangle, uv)))
    fields.append(fields[0].reshape(240, 240)[:, ::-1].ravel())
    apart = np.abs(np.corrcoef(fields) - np.eye(len(fields)))
    assert apart.max() < 0.15
    # Pores are as lively as the lines beside them.
    beside = np.log(patches().factor("beside_lines", even, triangle, uv))
    assert np.corrcoef(beside, fields[0])[0, 1] > 0.99


def test_0_is_even_skin() -> None:
    assert Patches.of(surface(), EVEN, "mm") is None
    triangle, uv = points(20)
    even = fields().unpatched
    for name in ("spacing", "strength", "pore_strength", "pore_radius", "turn", "patchiness"):
        wanted = getattr(Fields(), name)(triangle, uv)
        np.testing.assert_array_equal(getattr(even, name)(triangle, uv), wanted)


def fields(settings: GraphSettings = SETTINGS, controls: Controls | None = None) -> PaintedFields:
    ground = surface()
    return PaintedFields(ground, settings, controls or Controls({}), None, patches())


def test_bumps_are_highest_where_lines_are_strong() -> None:
    triangle, uv = points()
    patchy = fields(replace(SETTINGS, region="neck"))
    lively, bumps = patchy.strength(triangle, uv), patchy.event_patches(triangle, uv)
    assert (np.diff(bumps[np.argsort(lively)]) > -1e-4).all()
    more = fields(replace(SETTINGS, region="neck", patches=1.5)).event_patches(triangle, uv)
    assert more.min() < 0.8 * bumps.min()


@pytest.mark.parametrize("region", ["face", "forehead", "neck"])
def test_regions_say_how_patchy_they_are(region: str) -> None:
    triangle, uv = points()
    patchy = fields(replace(SETTINGS, region=region, patches=0.5))
    amount = np.float32(0.5 * REGIONS[region].patchiness) * ones(len(uv))
    np.testing.assert_allclose(patchy.patchiness(triangle, uv), amount, rtol=1e-6)
    found = patchy.strength(triangle, uv) / patchy.unpatched.strength(triangle, uv)
    wanted = patches().factor("strength", amount, triangle, uv)
    np.testing.assert_allclose(found, wanted, rtol=1e-5)


def test_patches_multiply_what_is_set_and_painted() -> None:
    triangle, uv = points(60)
    controls = painted(strength=right(0.8), density=right(0.7), scale=right(0.4))
    patchy = fields(replace(SETTINGS, strength=0.5), controls)
    even = patchy.unpatched
    amount = ones(len(uv))
    for name, factors in (("strength", ["strength"]), ("pore_strength", ["beside_lines", "pores"])):
        both = [getattr(field, name)(triangle, uv) for field in (patchy, even)]
        for factor in factors:
            both[1] = both[1] * patches().factor(factor, amount, triangle, uv)
        np.testing.assert_allclose(*both, rtol=1e-5)
    density = patches().factor("density", amount, triangle, uv)
    for name in ("spacing", "width"):
        both = [getattr(field, name)(triangle, uv) for field in (patchy, even)]
        np.testing.assert_allclose(both[0], both[1] * density**-0.5, rtol=1e-5)
    assert patchy.least_spacing <= patchy.spacing(triangle, uv).min()
    assert patchy.spacing(triangle, uv).max() <= patchy.most_spacing


def test_painted_directions_do_not_sway() -> None:
    triangle, uv = points(60)
    controls = Controls({"direction": {1001: right(0.3, left=0.0)}})
    sway = fields(SETTINGS, controls).turn(triangle, uv)
    straight = fields(SETTINGS, controls).unpatched.turn(triangle, uv)
    there = uv[:, 0] > 0.55
    np.testing.assert_array_equal(sway[there], straight[there])
    away = sway[uv[:, 0] < 0.45] - straight[uv[:, 0] < 0.45]
    assert away.std() == pytest.approx(0.22, rel=0.2)


@pytest.fixture(scope="module")
def grown(device: Device) -> dict[float, WrinkleGraph]:
    """100 mm of skin by patchiness."""
    return {amount: skin(device, amount) for amount in (0.0, 1.0, 2.0)}


def skin(device: Device, amount: float, controls: Controls | None = None) -> WrinkleGraph:
    settings = GraphSettings(wrinkles=20_000, patches=amount)
    mesh = sheets.sheet(scale=100.0)
    return synthesize(mesh, settings, device, controls=controls, unit="mm").graph


def local(graph: WrinkleGraph, values: NDArray[np.float32], side: int = 25) -> Floats:
    """Means of the pores in squares of 4 mm."""
    cell = np.floor((graph.node_uv.astype(float) - 0.1) / 0.8 * side).astype(int).clip(0, side - 1)
    at = cell[:, 0] * side + cell[:, 1]
    found: Floats = np.bincount(at, values, side * side) / np.bincount(at, None, side * side)
    return found


def test_the_count_is_exact_and_the_mean_is_kept(grown: dict[float, WrinkleGraph]) -> None:
    even = grown[0.0]
    for amount, graph in grown.items():
        assert graph.wrinkles == 20_000
        for name in ("edge_weight", "node_weight"):
            means = [getattr(one, name).mean() for one in (graph, even)]
            assert means[0] == pytest.approx(means[1], rel=0.03 if amount <= 1.0 else 0.08)
        assert len(graph.node_uv) == pytest.approx(len(even.node_uv), rel=0.01)


def test_skin_is_as_patchy_as_is_asked_for(grown: dict[float, WrinkleGraph]) -> None:
    spread = {
        amount: [
            float(np.std(np.log(local(graph, getattr(graph, name)))))
            for name in ("node_weight", "node_radius")
        ]
        for amount, graph in grown.items()
    }
    for even, one, two in zip(spread[0.0], spread[1.0], spread[2.0], strict=True):
        assert even < 0.8 * one
        assert one < 0.8 * two


def test_even_skin_has_no_relief_of_its_own(grown: dict[float, WrinkleGraph]) -> None:
    assert grown[0.0].node_patchiness is None
    for amount in (1.0, 2.0):
        np.testing.assert_array_equal(grown[amount].node_patchiness, amount)


def test_what_is_painted_black_has_no_strength(device: Device) -> None:
    graph = skin(device, 1.0, painted(strength=right(0.0)))
    there = graph.node_uv[:, 0] > 0.6
    assert graph.node_weight[there].max() < 0.001
