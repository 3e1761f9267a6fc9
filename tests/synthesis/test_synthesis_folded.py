"""How much folds of a face show at rest, by region, and what coarse regions are grown by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import REGIONS, regions
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.painted_fields import PaintedFields
from rhytid.synthesis.patches import Patches
from rhytid.synthesis.surface import Surface
from synthesis import sheets

MESH = sheets.sheet()
SURFACE = Surface.of(MESH)
COUNT = 6000
MASKED = np.float32(0.6)


def folds(*regions: str, moving: int = ENOUGH) -> Folds:
    """Skin that is pressed along x everywhere, with masks of regions."""
    tensor = np.zeros((len(MESH.positions), 6), np.float32)
    tensor[:, 0] = 0.12**2
    masks = {name: np.full(len(MESH.positions), MASKED) for name in regions}
    return Folds(tensor, moving, masks)


def fields(anatomy: str, *regions: str) -> PaintedFields:
    field = FoldField(MESH, SURFACE, folds(*regions))
    return PaintedFields(SURFACE, GraphSettings(anatomy=anatomy), Controls({}), field)


def at(found: PaintedFields, name: str) -> np.ndarray:
    triangle = np.flatnonzero(SURFACE.carries)
    values = getattr(found, name)(triangle, SURFACE.uv[triangle].mean(axis=1))
    return np.asarray(values, np.float64)


def test_folds_count_to_the_power_of_the_region() -> None:
    mouth, plain = fields("fine", "mouth"), fields("fine")
    power = REGIONS["mouth"].folded ** float(MASKED)
    assert power < 0.7
    np.testing.assert_allclose(at(mouth, "primary"), at(plain, "primary") ** power, rtol=1e-5)
    # Pores have no folds; the region makes them as deep as lines, times a factor of their own.
    lines = at(mouth, "strength") / at(mouth, "pore_strength")
    lines *= REGIONS["mouth"].pore_strength ** float(MASKED)
    wanted = (at(plain, "strength") / at(plain, "pore_strength")) ** power
    np.testing.assert_allclose(lines, wanted, rtol=1e-5)


def test_coarse_regions_are_grown_by_their_own_figures() -> None:
    found, finer = fields("coarse", "lip", "cheek"), fields("fine", "lip", "cheek")
    coarse = regions("coarse")
    # The two masks leave nothing.
    wanted = np.sqrt(coarse["lip"].scale * coarse["cheek"].scale)
    wide = at(found, "width") / at(found, "spacing")
    np.testing.assert_allclose(wide, wanted, rtol=1e-5)
    assert (np.abs(at(finer, "width") / at(finer, "spacing") - wanted) > 0.05).all()
    assert (at(found, "undulation") == 1.0).all()
    assert (at(finer, "undulation") > 1.0).all()


def test_a_coarse_graph_has_no_undulation_of_its_own(device: Device) -> None:
    made = {
        anatomy: synthesize(
            MESH, GraphSettings(wrinkles=COUNT, anatomy=anatomy), device, folds=folds("neck")
        ).graph
        for anatomy in ("fine", "coarse")
    }
    assert made["coarse"].node_undulation is None
    assert made["coarse"].node_grain is not None
    assert made["fine"].node_undulation == pytest.approx(
        REGIONS["neck"].undulation ** float(MASKED), rel=1e-5
    )


@pytest.mark.parametrize(("moving", "alike"), [(2, False), (40, True)])
def test_few_expressions_say_less_of_directions_where_anatomy_is_fine(
    device: Device, moving: int, alike: bool
) -> None:
    """On even skin, too; of forty expressions, which show all, both make the same."""
    plain = GraphSettings(wrinkles=COUNT, rank=0.0, patches=0.0, events=0.0)
    shown = folds(moving=moving)
    fine, coarse = (
        synthesize(MESH, replace(plain, anatomy=anatomy), device, folds=shown).graph
        for anatomy in ("fine", "coarse")
    )
    assert np.array_equal(fine.edge_weight, coarse.edge_weight) == alike


@pytest.mark.parametrize("patches", [0.0, 1.0])
def test_no_spacing_of_a_triangle_is_below_what_is_known_of_it(patches: float) -> None:
    settings = GraphSettings(spacing=0.02, patches=patches)
    mask = np.linspace(0.0, 1.0, len(MESH.positions)).astype(np.float32)
    masked = replace(folds(), regions={"lip": mask, "neck": mask[::-1].copy()})
    known = PaintedFields(
        SURFACE, settings, Controls({}), FoldField(MESH, SURFACE, masked),
        Patches.of(SURFACE, settings, None),
    )  # fmt: skip
    triangle = np.repeat(np.flatnonzero(SURFACE.carries), 20)
    share = np.random.default_rng(1).dirichlet(np.full(3, 0.3), len(triangle))
    uv = np.einsum("nc,ncx->nx", share, SURFACE.uv[triangle]).astype(np.float32)
    spacing, closest = known.spacing(triangle, uv), known.closest(triangle)
    assert np.ptp(spacing) > 0.2
    assert (closest <= spacing).all()
    assert (closest >= np.float32(known.least_spacing)).all()
    tight = 1.0 if patches == 0.0 else 0.7
    assert np.mean(closest / spacing) > 0.95 * tight
