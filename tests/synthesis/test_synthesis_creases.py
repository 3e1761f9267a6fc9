"""Creases of a lip that is painted on a mesh without expressions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import COARSE
from rhytid.synthesis.generate import synthesize
from synthesis import sheets
from synthesis.painted import painted

MESH, COUNT = sheets.sheet(), 15_000
# The lip is a band as wide as the sheet: shares of its height at which it is white.
LOW, HIGH = 0.42, 0.58


def band() -> NDArray[np.float32]:
    """A mask of the lip with borders of a texel."""
    v = 1.0 - (np.arange(64) + 0.5) / 64
    inside = (v > LOW) & (v < HIGH)
    return np.repeat(inside.astype(np.float32)[:, None], 64, axis=1)


def direction(degrees: float) -> NDArray[np.float32]:
    return np.full((8, 8), degrees / 180.0, np.float32)


def grown(device: Device, controls: Controls | None = None, **settings: Any) -> WrinkleGraph:
    chosen = GraphSettings(wrinkles=COUNT, patches=0.0, events=0.0, **settings)
    return synthesize(MESH, chosen, device, controls=controls or painted(region_lip=band())).graph


def creases(graph: WrinkleGraph) -> NDArray[np.float64]:
    """(K, 2, 2) ends in UV of lines that take more of the shortening than by themselves."""
    assert graph.edge_share is not None
    return graph.node_uv[graph.edge_nodes[graph.edge_share > 1.0]].astype(np.float64)


def axis(lines: NDArray[np.float64]) -> tuple[float, float]:
    """Degrees from level, 0 to 180, of lines (K, 2, 2), and how far these agree, 0 to 1."""
    step = lines[:, 1] - lines[:, 0]
    length = np.linalg.norm(step, axis=1)
    order = (length * np.exp(2j * np.arctan2(step[:, 1], step[:, 0]))).sum() / length.sum()
    return float(np.degrees(np.angle(order)) / 2 % 180), float(abs(order))


def in_the_lip(lines: NDArray[np.float64]) -> bool:
    return bool(np.abs(lines[..., 1] - 0.5).max() < 0.5 * (HIGH - LOW) + 0.03)


def test_a_painted_lip_has_creases_across_it(device: Device) -> None:
    lines = creases(grown(device))
    assert len(lines) > 100
    assert in_the_lip(lines)
    angle, agree = axis(lines)
    assert abs(angle - 90) < 15
    assert agree > 0.8
    assert grown(device, rank=0.0).edge_share is None


@pytest.mark.parametrize("region", ["neck", "mouth", "forehead"])
def test_other_regions_need_expressions(device: Device, region: str) -> None:
    """So do rings of a neck, beside a painted lip as without one."""
    mask = {f"region_{region}": 1.0 - band()}
    assert grown(device, painted(**mask)).edge_share is None
    lines = creases(grown(device, painted(**mask, region_lip=band())))
    assert len(lines) > 100
    assert in_the_lip(lines)


def test_a_whole_lip_and_a_coarse_one(device: Device) -> None:
    assert grown(device, Controls({}), region="lip").edge_share is not None
    assert grown(device, anatomy=COARSE).edge_share is None


@pytest.mark.parametrize("degrees", [30.0, 135.0])
def test_creases_follow_painted_directions(device: Device, degrees: float) -> None:
    controls = painted(region_lip=band(), direction=direction(degrees))
    angle, agree = axis(creases(grown(device, controls)))
    assert abs((angle - degrees + 90) % 180 - 90) < 15
    assert agree > 0.8


def test_creases_turn_with_the_setting(device: Device) -> None:
    angle, _ = axis(creases(grown(device, turn=30.0)))
    assert abs(angle - 120) < 15


def on_skin(device: Device, wrinkles: int) -> WrinkleGraph:
    """100 mm of skin with a lip of 13 mm."""
    settings = GraphSettings(wrinkles=wrinkles, patches=0.0, events=0.0)
    mesh, lip = sheets.sheet(scale=100.0), painted(region_lip=band())
    return synthesize(mesh, settings, device, controls=lip, unit="mm").graph


def test_creases_are_of_a_size_of_their_own(device: Device) -> None:
    """As long together, as broad and as deep whether pores are 0.53 mm apart or 0.96."""
    lengths, widths, depths = [], [], []
    for wrinkles, spacing in ((50_000, 0.53), (15_000, 0.96)):
        graph = on_skin(device, wrinkles)
        assert graph.edge_share is not None
        part = graph.edge_share > 1.0
        step = np.diff(graph.node_uv[graph.edge_nodes[part]].astype(np.float64), axis=1)[:, 0]
        length = 100.0 * np.linalg.norm(step, axis=1)
        lengths.append(length.sum())
        widths.append(np.average(graph.edge_half_width[part], weights=length))
        depths.append(spacing * np.average(graph.edge_weight[part], weights=length))
    # A lip has a millimetre of creases to every one or two square millimetres.
    assert min(lengths) / (0.16 * 0.8 * 1e4) > 0.4
    for values in (lengths, widths, depths):
        assert values[1] == pytest.approx(values[0], rel=0.3)


def test_no_line_of_the_skin_around_crosses_the_border_of_a_lip(device: Device) -> None:
    graph = on_skin(device, 15_000)
    assert graph.edge_share is not None
    ends = graph.node_uv[graph.edge_nodes].astype(np.float64)[..., 1]
    inside = ((ends > LOW) & (ends < HIGH)).sum(axis=1)
    others = graph.edge_share <= 1.0
    crossing, beyond = (graph.edge_weight[others & (inside == n)] for n in (1, 0))
    assert len(crossing) > 100
    assert np.percentile(crossing, 98) < 0.5 * np.percentile(beyond, 98)
