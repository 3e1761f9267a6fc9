"""What patches of skin are where it has leaders."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.skin import REGIONS
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.patches import Patches
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.test_synthesis_leaders import COUNT, MESH, SPACING, folds


def in_patches(
    device: Device, region: str, patches: float
) -> tuple[WrinkleGraph, NDArray[np.float32], NDArray[np.bool_]]:
    """A graph of skin that folds on the right, what patches make of its lines, as logarithms, and
    which of these lie on the right."""
    settings = GraphSettings(wrinkles=4 * COUNT, patches=patches, region=region)
    graph = synthesize(MESH, settings, device, folds=folds()).graph
    surface, first = Surface.of(MESH), graph.edge_nodes[:, 0]
    noise = Patches.of(surface, settings, None)
    assert noise is not None
    triangle, uv = graph.node_triangle[first], graph.node_uv[first]
    amount = np.full(len(uv), patches * REGIONS[region].patchiness, np.float32)
    place = sheets.places(surface, graph)[first]
    lively = np.log(noise.factor("strength", amount, triangle, uv))
    return graph, lively, place[:, 0] > np.median(MESH.positions[:, 0]) + 5 * SPACING


def test_they_run_on_through_patches(device: Device) -> None:
    graph, lively, _ = in_patches(device, "face", 2.0)
    depth = np.log(graph.edge_weight)
    leads = graph.edge_share > 1.05
    assert leads.sum() > 100
    follows, followed = (np.polyfit(lively[of], depth[of], 1)[0] for of in (leads, ~leads))
    assert 0.1 < follows < 0.6 < followed


def test_lines_between_them_are_no_deeper_in_lively_patches(device: Device) -> None:
    """But fainter in quiet ones, as lines elsewhere are."""
    graph, lively, folded = in_patches(device, "face", 2.0)
    depth, others = np.log(graph.edge_weight), graph.edge_share < 1.0
    quiet, livelier, elsewhere = (
        np.polyfit(lively[of], depth[of], 1)[0]
        for of in (
            others & folded & (lively < 0.0), others & folded & (lively > 0.0),
            ~folded & (lively > 0.0),
        )
    )  # fmt: skip
    assert abs(livelier) < 0.15
    assert quiet > 0.7
    assert elsewhere > 0.6


def test_swells_among_them_are_less_patchy(device: Device) -> None:
    """They are on a forehead; a cheek is less patchy as it is."""
    for region, among in (("forehead", 1.8), ("cheek", 0.35)):
        graph, _, folded = in_patches(device, region, 1.0)
        patchiness = graph.node_patchiness
        assert patchiness is not None
        of = patchiness[graph.edge_nodes[:, 0]]
        assert np.median(of[folded]) == pytest.approx(among, abs=0.02)
        assert np.median(of[~folded]) == pytest.approx(REGIONS[region].patchiness)
