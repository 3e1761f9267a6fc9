"""What is stored a second time at UV seams, from the arrays of a graph."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.test_stage_seams import N, folded
from reference import redraw
from rhytid.device.runtime import Device
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import REGIONS
from rhytid.synthesis import assembly
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.seams.copies import with_copies
from synthesis import sheets
from synthesis.painted import painted, right
from synthesis.seam_change import MetricChange

Given = tuple[dict[str, np.ndarray], tuple[Any, ...]]


def given_to_copy(device: Device, mesh: Mesh) -> Given:
    """Arrays of a graph before its copies, and the other arguments of `with_copies`."""
    found: list[Given] = []

    def kept(arrays: dict[str, np.ndarray], *others: Any) -> dict[str, np.ndarray]:
        found.append(({name: values.copy() for name, values in arrays.items()}, others))
        return with_copies(arrays, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(assembly, "with_copies", kept)
        synthesize(mesh, sheets.wanted(1000), device)
    return found[0]


def copied(given: Given, **changes: np.ndarray) -> WrinkleGraph:
    arrays = {name: values.copy() for name, values in {**given[0], **changes}.items()}
    return WrinkleGraph(**with_copies(arrays, *given[1]), origin=None)


def test_both_halves_of_what_is_cut_at_a_seam_are_copied(device: Device) -> None:
    given = given_to_copy(device, folded())
    whole = copied(given)
    of, count = np.unique(whole.edge_copy_of[~whole.own_edges], return_counts=True)
    first, second = of[0], of[-1]
    halves = given[0]["edge_copy_of"].copy()
    halves[second] = first  # as if it were the other half of that one
    cut = copied(given, edge_copy_of=halves)
    rows = np.flatnonzero(cut.edge_copy_of == first)
    assert len(rows) == 1 + count[0] + count[-1]
    before, after = (redraw.segments(graph) for graph in (whole, cut))
    places = [*after[rows[rows != second]]]
    wanted = before[np.isin(whole.edge_copy_of, (first, second))]
    np.testing.assert_array_equal(np.sort(places, axis=0), np.sort(wanted, axis=0))


def test_what_has_a_metric_keeps_it_where_nothing_is_copied(device: Device) -> None:
    """Wrinkles whose ends, round in UV, reach over the seam, but nothing of which is beyond it."""
    given = given_to_copy(device, folded(across=0.05))
    graph, before = copied(given), given[0]
    alone = np.setdiff1d(np.flatnonzero(graph.edge_metric.any(axis=1)), graph.edge_copy_of)
    alone = alone[graph.own_edges[alone]]
    assert len(alone) > 20
    assert (graph.edge_triangle[alone] >= 2 * N * N).all()
    of_edges = {n: v[alone] for n, v in before.items() if n.startswith("edge_")}
    of_edges["edge_partners"] = np.full_like(of_edges["edge_partners"], ORIGINAL)
    none = np.zeros_like(before["node_weight"])
    left = copied(given, **of_edges, node_weight=none)
    assert left.edge_copy_of is None
    assert left.node_copy_of is None
    np.testing.assert_array_equal(left.edge_metric, graph.edge_metric[alone])
    np.testing.assert_array_equal(left.edge_slopes, graph.edge_slopes[alone])
    assert (left.edge_slopes != of_edges["edge_slopes"]).any()


def test_copies_take_the_share_of_their_originals(device: Device) -> None:
    given = given_to_copy(device, folded())
    share = np.linspace(0, 3, len(given[0]["edge_nodes"])).astype(np.float32)
    graph = copied(given, edge_share=share)
    copies = np.flatnonzero(~graph.own_edges)[-20:]
    assert len(graph.edge_share) == graph.wrinkles
    np.testing.assert_array_equal(graph.edge_share[copies], share[graph.edge_copy_of[copies]])


@pytest.mark.slow
def test_far_from_a_seam_nothing_is_changed(device: Device) -> None:
    given = given_to_copy(device, folded(across=0.05, steps=(1, 3) * (N // 2)))
    arrays, graph = given[0], copied(given)
    count = len(arrays["edge_nodes"])
    plain = np.flatnonzero(~graph.edge_metric[:count].any(axis=1))
    assert 0.5 * count < len(plain) < count
    for name, values in arrays.items():
        found = getattr(graph, name)[: len(values)]
        rows = plain if name in ("edge_metric", "edge_slopes") else slice(None)
        np.testing.assert_array_equal(found[rows], values[rows])


def test_the_change_of_a_metric_is_told() -> None:
    """The tool's own rule: of quads one to three times as dense along the seam."""
    mesh = folded(across=1.3, steps=(1, 3) * (N // 2))
    change = MetricChange(mesh)
    second = 2 * N * N
    at = np.array([0.0, 0.5 / N, 0.0])
    assert change.around(second + 1, at, 0.3 / N) == pytest.approx(1.0, abs=1e-6)
    assert change.around(second + 1, at, 0.6 / N) == pytest.approx(3.0, rel=0.01)
    assert change.around(0, np.array([-1.0, 0.0, 0.0]), 0.5) == pytest.approx(1.0, abs=1e-6)


def test_copies_are_as_rough_as_their_originals(device: Device) -> None:
    """Pores, ends of wrinkles beyond a seam and copies of both, where two regions meet."""
    controls = painted(region_lip=right(1.0, 0.0))
    graph = synthesize(folded(), sheets.wanted(1000), device, controls=controls).graph
    copies, lip = np.flatnonzero(~graph.own_nodes), REGIONS["lip"]
    assert len(copies) > 20
    plain = synthesize(folded(), sheets.wanted(1000), device).graph
    # Between creases swells are half as high.
    for name, of_lip in (("node_grain", lip.grain), ("node_undulation", 0.5 * lip.undulation)):
        rough = getattr(graph, name)
        np.testing.assert_array_equal(rough[copies], rough[graph.node_copy_of[copies]])
        assert sorted([rough.min(), rough.max()]) == pytest.approx(sorted([of_lip, 1.0]))
        assert getattr(plain, name) is None
