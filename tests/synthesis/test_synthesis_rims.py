"""Edges of painted maps: no crack goes round bare skin, and hard masks draw no seam."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.painted_maps import Controls
from rhytid.synthesis.assembly import beside_bare
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.surface import Surface
from synthesis import sheets

MESH = sheets.sheet()
RADIUS = 0.22  # of the painted disc, in UV
COUNT = 20_000
# A few dozen lines run along a rim: of one seed they say little.
SEEDS = range(6)


def disc(inside: float, outside: float) -> NDArray[np.float32]:
    row, column = (np.indices((512, 512)) + 0.5) / 512
    there = np.hypot(column - 0.5, row - 0.5) < RADIUS
    return np.where(there, np.float32(inside), np.float32(outside))


def along_the_rim(
    device: Device, name: str, inside: float, outside: float, seed: int = 1
) -> dict[str, float]:
    """Mean weight, by length, of lines along the rim of a painted disc: within a spacing and a half
    inside and outside of it, and away from it on both sides."""
    controls = Controls({name: {1001: disc(inside, outside)}})
    settings = GraphSettings(wrinkles=COUNT, anisotropy=0.0, patches=0.0, seed=seed)
    made = synthesize(MESH, settings, device, controls=controls)
    ends = made.graph.node_uv[made.graph.edge_nodes].astype(np.float64)
    step, middle = ends[:, 1] - ends[:, 0], ends.mean(axis=1) - 0.5
    length, far = np.hypot(*step.T), np.hypot(*middle.T)
    spacing = made.spacing / np.ptp(MESH.positions[:, 0])
    outwards = np.abs((middle * step).sum(axis=1)) / (far * length)
    away = (far - RADIUS) / spacing
    places = {"inside": (-9, -2.5), "rim in": (-1.5, 0), "rim out": (0, 1.5), "outside": (3, 12)}
    found = {}
    for place, (low, high) in places.items():
        chosen = (away >= low) & (away < high) & (outwards < 0.5)
        if chosen.any():
            found[place] = float(np.average(made.graph.edge_weight[chosen], weights=length[chosen]))
    return found


def test_bare_skin_has_no_ring_of_a_crack(device: Device) -> None:
    found = along_the_rim(device, "density", 0.0, 0.5)
    assert "inside" not in found
    assert 0.75 < found["rim out"] / found["outside"] < 1.15


@pytest.mark.slow
@pytest.mark.parametrize("name", ["region_nose", "region_lip", "region_neck"])
def test_a_hard_mask_draws_no_seam(device: Device, name: str) -> None:
    every = [along_the_rim(device, name, 1.0, 0.0, seed) for seed in SEEDS]
    found = {place: np.mean([one[place] for one in every]) for place in every[0]}
    most, least = (f(found["inside"], found["outside"]) for f in (max, min))
    for side in ("rim in", "rim out"):
        assert 0.8 * least < found[side] < 1.15 * most


class RightOf(Fields):
    """Bare right of u = 0.5."""

    some_bare = True

    def bare(self, triangle, uv):  # type: ignore[no-untyped-def]
        return uv[:, 0] > 0.5


class OutsideTheChart(Fields):
    """As a density map that is black around the charts."""

    some_bare = True

    def bare(self, triangle, uv):  # type: ignore[no-untyped-def]
        low, high = MESH.uv.min(axis=0), MESH.uv.max(axis=0)
        return ((uv < low) | (uv > high)).any(axis=1)


def test_what_is_painted_beyond_a_chart_does_not_count() -> None:
    surface = Surface.of(MESH)
    triangle = np.flatnonzero(surface.carries)
    uv = surface.uv[triangle].mean(axis=1)
    beyond = OutsideTheChart()
    found = beside_bare(surface, neighbours(MESH), beyond, triangle, uv, 0.1)
    assert beyond.bare(triangle, uv + np.float32([0.2, 0])).any()
    np.testing.assert_array_equal(found, 1.0)


def test_lines_fade_by_the_share_of_bare_skin_around_them() -> None:
    surface = Surface.of(MESH)
    triangle = np.flatnonzero(surface.carries)
    uv = surface.uv[triangle].mean(axis=1)
    spacing = 0.02
    found = beside_bare(surface, neighbours(MESH), RightOf(), triangle, uv, spacing)
    # In double, and on the surface: the sheet is a plane, as its axes are.
    to_edge = (0.5 - uv[:, 0]) * np.linalg.norm(surface.jacobian[triangle][..., 0], axis=-1)
    turns = 2.0 * np.pi * np.arange(8) / 8
    looked = to_edge[:, None] - 2.0 * spacing * np.cos(turns)
    sure = (np.abs(looked) > 1e-3 * spacing).all(axis=1)
    # Near the end of the sheet some looks leave it, and do not count.
    to_end = (MESH.uv.max(axis=0) - uv) * np.linalg.norm(surface.jacobian[triangle], axis=1)
    from_end = (uv - MESH.uv.min(axis=0)) * np.linalg.norm(surface.jacobian[triangle], axis=1)
    sure &= (np.minimum(to_end, from_end) > 2.01 * spacing).all(axis=1)
    wanted = (1.0 - (looked < 0).mean(axis=1)) ** 1.25
    assert sure.sum() > 0.5 * len(sure)
    np.testing.assert_allclose(found[sure], wanted[sure], atol=1e-6)
    assert (found[to_edge > 2.01 * spacing] == 1.0).all()
    assert set(np.round(wanted[sure], 3)) > {0.0, 1.0}
