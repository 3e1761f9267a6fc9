"""Lines where skin folds: which way they run, how strong they are, and what overrides them."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import REGIONS
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.painted_fields import PaintedFields, fields_of
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.painted import halves, painted, right

MESH = sheets.sheet()
SURFACE = Surface.of(MESH)
COUNT = 12_000
# Log compression, root mean square, where a sheet is folded.
SIZE = 0.15


def folded(
    angle: float, where=lambda x, y: True, moving: int = ENOUGH, size: float = SIZE
) -> Folds:
    """Compressed along `angle` degrees to x, in the plane, where a rule says so."""
    axis = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    rows = size**2 * np.outer(axis, axis)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    x, y = MESH.positions[:, :2].T
    on = np.broadcast_to(where(x, y), x.shape)
    return Folds((on[:, None] * rows).astype(np.float32), moving)


def field(folds: Folds) -> FoldField:
    return FoldField(MESH, SURFACE, folds)


def places() -> tuple[np.ndarray, np.ndarray]:
    triangle = np.flatnonzero(SURFACE.carries)
    return triangle, SURFACE.uv[triangle].mean(axis=1)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 140.0])
def test_lines_run_across_what_is_compressed(angle: float) -> None:
    # Level on a sheet that faces +z is x: a turn is an angle to x.
    turn = field(folded(angle)).blended_with(np.full(len(places()[0]), 0.3, np.float32), *places())
    off = np.degrees(turn) - angle - 90.0
    assert np.abs((off + 90.0) % 180.0 - 90.0).max() < 0.01


def test_where_nothing_folds_the_other_direction_stays() -> None:
    other = np.linspace(-1.0, 1.0, len(places()[0])).astype(np.float32)
    turn = field(folded(0.0, size=0.0)).blended_with(other, *places())
    np.testing.assert_allclose(turn, other, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["strength", "anisotropy", "primary", "certainty"])
def test_factors_grow_with_the_size_without_a_step(name: str) -> None:
    sizes = np.linspace(0.0, 0.3, 301)
    one = tuple(part[:1] for part in places())
    found = np.array([field(folded(0.0, size=s)).factor(name, *one)[0] for s in sizes])
    assert (np.diff(found) >= 0).all()
    assert np.diff(found).max() < 0.1 * np.ptp(found)
    assert found[0] < 0.7
    assert found[-1] >= 1.0


def test_what_is_compressed_alike_in_all_directions_prefers_none() -> None:
    tensor = np.zeros((len(MESH.positions), 6), np.float32)
    tensor[:, :2] = SIZE**2
    found = field(Folds(tensor, ENOUGH))
    assert found.factor("certainty", *places()).max() < 1e-3
    assert found.factor("anisotropy", *places()).max() < 0.5
    assert found.factor("strength", *places()).min() > 1.0


def test_few_expressions_say_little_of_what_they_leave_alone() -> None:
    none, one, all = (
        field(folded(0.0, size=1e-6, moving=n)).factor("strength", *places())[0]
        for n in (0, 1, ENOUGH)
    )
    assert none == pytest.approx(1.0)
    assert all < one < none
    # What they fold is folded.
    strong = [field(folded(0.0, moving=n)).factor("strength", *places())[0] for n in (1, ENOUGH)]
    assert strong[0] == strong[1] > 1.2


def cautious(size: float, moving: int) -> dict[str, float]:
    """Factors of skin that expressions fold along x alone, so many of them."""
    found = FoldField(MESH, SURFACE, folded(0.0, moving=moving, size=size), cautious=True)
    names = ("anisotropy", "certainty", "strength", "primary")
    return {name: float(found.factor(name, *places())[0]) for name in names}


def test_few_expressions_say_little_of_directions() -> None:
    # What folds a cheek a little in one smile, and a forehead that is raised.
    little = {moving: cautious(0.04, moving) for moving in (3, 8, 15, 40, 53)}
    far = {moving: cautious(0.25, moving) for moving in (3, 8, 15, 40)}
    gathered = [found["anisotropy"] for found in little.values()]
    assert gathered == sorted(gathered)
    assert gathered[0] < 1.2
    assert little[3]["certainty"] < 0.9
    assert min(found["anisotropy"] for found in far.values()) > 1.9
    assert min(found["certainty"] for found in far.values()) > 0.99
    # Of many it makes no difference, nor of how strong lines are.
    plain = field(folded(0.0, moving=40, size=0.04))
    for name, found in little[40].items():
        assert found == pytest.approx(float(plain.factor(name, *places())[0]), rel=1e-5)
    assert little[40] == little[53]
    for name in ("strength", "primary"):
        few = field(folded(0.0, moving=3, size=0.04)).factor(name, *places())[0]
        assert little[3][name] == pytest.approx(float(few))


@pytest.mark.slow
def test_a_sheet_compressed_along_x_grows_lines_along_y(device: Device) -> None:
    folds = folded(0.0, where=lambda x, y: x > np.median(MESH.positions[:, 0]))
    # Beside leaders and patches fine lines cross each other, so that the mean says little.
    settings = GraphSettings(wrinkles=COUNT, rank=0.0, patches=0.0)
    made = synthesize(MESH, settings, device, folds=folds)
    left, right_half = halves(MESH, made.graph)
    assert made.graph.wrinkles == COUNT
    assert right_half.axis == pytest.approx(90.0, abs=9.0)
    assert abs(right_half.order) > 0.5 > 2 * abs(left.order)
    assert right_half.weight > 1.5 * left.weight
    # Pores stay as close and as large, and lead where nothing folds.
    assert right_half.spacing == pytest.approx(left.spacing, rel=0.02)
    assert right_half.radius == pytest.approx(left.radius, rel=0.05)


def test_a_painted_direction_goes_before(device: Device) -> None:
    folds = folded(0.0)
    controls = painted(direction=right(30.0 / 180.0, 0.0))
    # Beside leaders fine lines cross each other, so that the mean says little.
    plain = GraphSettings(wrinkles=COUNT, patches=0.0, rank=0.0)
    made = synthesize(MESH, plain, device, controls=controls, folds=folds)
    left, right_half = halves(MESH, made.graph)
    assert left.axis == pytest.approx(90.0, abs=9.0)
    assert right_half.axis == pytest.approx(30.0, abs=9.0)


def test_rhombi_lie_between_folds_and_the_level_direction() -> None:
    """By a mean that has no step where folds are upright; painted directions go before."""
    triangle, uv = places()
    found = []
    for lines in (0.0, 30.0, 60.0, 89.0, 91.0, 150.0):
        fields = region_fields(field(folded(lines + 90.0)), region="neck")
        found.append(np.degrees(fields.along_rhombi(triangle, uv)).mean())
    assert found == pytest.approx([0.0, 13.5, 25.6, 5.0, -5.0, -13.5], abs=0.5)
    controls = Controls({"direction": {1001: right(70.0 / 180.0, 70.0 / 180.0)}})
    fields = PaintedFields(SURFACE, GraphSettings(), controls, field(folded(90.0)))
    along = np.degrees(fields.along_rhombi(triangle, uv))
    np.testing.assert_allclose(along, 70.0, atol=1.0)
    np.testing.assert_allclose(fields.slant(triangle, uv), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["strength", "anisotropy"])
def test_what_is_painted_white_or_black_goes_before(name: str) -> None:
    folds = field(folded(0.0, size=0.02))
    painted_right = Controls({name: {1001: right(1.0, 0.5)}})
    with_folds = PaintedFields(SURFACE, GraphSettings(), painted_right, folds)
    without = PaintedFields(SURFACE, GraphSettings(), painted_right)
    triangle, uv = places()
    found, plain = (getattr(f, name)(triangle, uv) for f in (with_folds, without))
    left, white = uv[:, 0] < 0.45, uv[:, 0] > 0.55
    np.testing.assert_allclose(found[white], plain[white], rtol=1e-6)
    # Mid grey leaves the folds as they are.
    np.testing.assert_allclose(found[left], folds.factor(name, triangle, uv)[left], rtol=1e-6)
    assert np.abs(found[left] - plain[left]).min() > 0.1


def test_pores_do_not_fade_where_nothing_folds() -> None:
    found = fields_of(SURFACE, GraphSettings(), None, field(folded(0.0, size=0.0)))
    assert found.strength(*places()).max() < 0.7
    np.testing.assert_array_equal(found.pore_strength(*places()), 1.0)


def test_without_folds_skin_is_even() -> None:
    found = fields_of(SURFACE, GraphSettings(), None)
    assert type(found) is Fields
    np.testing.assert_array_equal(found.primary(*places()), np.float32(1.0))


def test_folds_far_away_change_nothing_here(device: Device) -> None:
    """Absolute scales: that one corner folds more leaves the other corner's factors."""
    low, high = MESH.positions[:, 0].min(), MESH.positions[:, 0].max()
    near = folded(40.0, size=0.05)
    beyond = folded(40.0, where=lambda x, y: x > low + 0.7 * (high - low), size=0.4)
    both = Folds(np.maximum(near.tensor, beyond.tensor), ENOUGH)
    triangle, uv = places()
    here = uv[:, 0] < 0.6
    for name in ("strength", "anisotropy", "primary", "certainty"):
        one, two = (field(f).factor(name, triangle, uv) for f in (near, both))
        np.testing.assert_array_equal(one[here], two[here])


def masked(**masks: float) -> FoldField:
    tensor = folded(0.0, size=0.0).tensor
    ones = np.ones(len(MESH.positions), np.float32)
    return field(Folds(tensor, 0, {name: value * ones for name, value in masks.items()}))


def region_fields(folds: FoldField | None, **settings: object) -> PaintedFields:
    return PaintedFields(SURFACE, GraphSettings(**settings), Controls({}), folds)


@pytest.mark.parametrize("name", ["spacing", "strength", "pore_radius", "width", "anisotropy"])
def test_a_mask_of_folds_makes_skin_of_that_region(name: str) -> None:
    own, set_by = region_fields(masked(lip=1.0)), region_fields(None, region="lip")
    triangle, uv = places()
    found, wanted = (getattr(fields, name)(triangle, uv) for fields in (own, set_by))
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    half = getattr(region_fields(masked(lip=0.5)), name)(triangle, uv)
    if name != "anisotropy":
        np.testing.assert_allclose(half, wanted**0.5, rtol=0.02)


def test_masks_that_overlap_share() -> None:
    found = region_fields(masked(lip=1.0, forehead=1.0)).spacing(*places())
    one, two = (
        region_fields(None, region=name).spacing(*places())[0] for name in ("lip", "forehead")
    )
    np.testing.assert_allclose(found, (one * two) ** 0.5, rtol=1e-5)


def test_a_painted_mask_goes_before_that_of_folds() -> None:
    folds = masked(lip=1.0)
    triangle, uv = places()
    white = uv[:, 0] > 0.55
    neck = Controls({"region_neck": {1001: right(1.0, 0.0)}})
    found = PaintedFields(SURFACE, GraphSettings(), neck, folds).spacing(triangle, uv)
    lip, painted_neck = (
        region_fields(None, region=name).spacing(triangle, uv)[0] for name in ("lip", "neck")
    )
    np.testing.assert_allclose(found[white], painted_neck, rtol=1e-5)
    np.testing.assert_allclose(found[uv[:, 0] < 0.45], lip, rtol=1e-5)
    # A painted mask of the same region takes its place altogether.
    none = Controls({"region_lip": {1001: right(1.0, 0.0)}})
    found = PaintedFields(SURFACE, GraphSettings(), none, folds).spacing(triangle, uv)
    np.testing.assert_allclose(found[white], lip, rtol=1e-5)
    np.testing.assert_allclose(found[uv[:, 0] < 0.45], 1.0, rtol=1e-5)


def test_regions_of_folds_change_how_many_wrinkles_there_are(device: Device) -> None:
    on = (MESH.positions[:, 0] > 0.5).astype(np.float32)
    folds = Folds(folded(0.0, size=0.0).tensor, 0, {"lip": on})
    # Without rank, as pores of creases stand closer along them.
    settings = GraphSettings(wrinkles=COUNT, patches=0.0, rank=0.0)
    made = synthesize(MESH, settings, device, folds=folds)
    left, right_half = halves(MESH, made.graph)
    density = REGIONS["lip"].density
    assert made.graph.wrinkles == pytest.approx(COUNT * (1.0 + density) / 2.0, rel=0.03)
    assert right_half.spacing == pytest.approx(left.spacing * density**-0.5, rel=0.04)
