"""Events against the reference, in any tiling, and apart from pores."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from reference import events as reference
from reference.drawing import texels
from reference.inputs import Response
from rhytid.domain.events import EVENT_NAMES, MOST_KIND
from rhytid.domain.graph import WrinkleGraph
from rhytid.errors import GraphError
from rhytid.pipeline.element_arrays import check_cover, pore_arrays
from rhytid.pipeline.event_elements import EventElements, event_arrays
from rhytid.pipeline.events import add_events, event_scales, fill_events
from rhytid.pipeline.stretch import StretchStage

SIZE = 256
# As events.cl says.
ERROR = 1e-6 * DEPTH * reference.TALLEST


def graph_of_events(seed: int = 3, metric: bool = True) -> WrinkleGraph:
    """Nodes of every kind, pores among them, of 2 to 40 texels."""
    plain = random_graph(seed, 60, half_width=(0.008, 0.15), metric=metric)
    kinds = np.arange(plain.pores) % (MOST_KIND + 1)
    return replace(plain, node_kind=kinds.astype(np.int32))


class Scene:
    """A sheet that a frame stretches, and a graph of events on it."""

    def __init__(self, device, graph=None, **changes):
        self.device, self.mesh = device, sheet()
        self.settings = settings_of(**changes)
        self.graph = graph or graph_of_events()
        rng = np.random.default_rng(5)
        self.triangle = rng.integers(0, len(self.mesh.faces), self.graph.pores).astype(np.int32)
        stage = StretchStage(device, self.mesh)
        moved = self.mesh.positions * np.float32([1.2, 0.85, 1.0])
        response = self.settings.response
        self.stretch = stage.run(moved, response.log_stretch_limit)
        ratios, _ = stage.read(self.stretch)
        limit = response.log_stretch_limit
        self.logs = np.clip(np.log(ratios.astype(np.float64)), -limit, limit)[self.triangle]

    def arrays(self, stiffness=None):
        return event_arrays(self.graph, self.triangle, self.settings, 1001, stiffness)

    def drawn(self, square=(0, 0, SIZE), arrays=None):
        elements = EventElements(self.device, arrays or self.arrays())
        scales = event_scales(self.device, elements)
        fill_events(self.device, elements, self.settings, self.stretch, scales)
        out = self.device.full(square[2] ** 2, np.float32(0.0))
        add_events(self.device, elements, self.settings, scales.values, square, out)
        return self.device.read(out, (square[2], square[2]), np.float32)

    def expected(self, logs=None):
        points = texels(range(SIZE), range(SIZE), SIZE)
        response = Response(
            beta_w=self.settings.response.beta_w, beta_d=self.settings.response.beta_d
        )
        logs = self.logs if logs is None else logs
        found = reference.added(points, self.graph, self.graph.node_kind, logs, response, DEPTH)
        return found.reshape(SIZE, SIZE)


@pytest.mark.parametrize("metric", [False, True])
def test_events_are_those_of_the_reference(device, metric):
    scene = Scene(device, graph_of_events(metric=metric))
    expected = scene.expected()
    assert expected.max() > 3 * DEPTH
    assert expected.min() < -2 * DEPTH
    np.testing.assert_allclose(scene.drawn(), expected, atol=ERROR)


def test_stiff_events_answer_less(device):
    scene = Scene(device)
    stiffness = np.full(scene.graph.pores, 0.3, np.float32)
    drawn = scene.drawn(arrays=scene.arrays(stiffness))
    expected = scene.expected(0.3 * scene.logs)
    np.testing.assert_allclose(drawn, expected, atol=ERROR)


def test_any_tiling_gives_the_same_bits(device):
    scene = Scene(device)
    whole = scene.drawn()
    for row in range(0, SIZE, 64):
        for column in range(0, SIZE, 64):
            part = whole[row : row + 64, column : column + 64]
            np.testing.assert_array_equal(scene.drawn((row, column, 64)), part)


def test_what_texels_do_not_carry_keeps_its_mean(device):
    small = replace(
        graph_of_events(),
        node_radius=np.full(120, 0.4 / SIZE, np.float32),
        node_metric=None,
        node_uv=np.random.default_rng(2).uniform(0.1, 0.9, (120, 2)).astype(np.float32),
    )
    means = [
        Scene(device, small, shape={"least_half_width": least}).drawn().astype(float).sum()
        for least in (4.0, 2.0)
    ]
    assert means[0] == pytest.approx(means[1], rel=0.03)


def test_copies_answer_as_their_originals(device):
    graph = graph_of_events()
    half = graph.pores // 2
    copy_of = np.full(graph.pores, -1, np.int32)
    copy_of[half:] = np.arange(half)
    kinds = graph.node_kind.copy()
    kinds[half:] = kinds[:half]
    scene = Scene(device, replace(graph, node_copy_of=copy_of, node_kind=kinds))
    scene.logs[half:] = scene.logs[:half]
    np.testing.assert_allclose(scene.drawn(), scene.expected(), atol=ERROR)


def test_events_are_no_pores():
    graph = graph_of_events()
    pores = int((graph.node_kind == 0).sum())
    assert graph.counts()[0] == pores
    assert sum(graph.event_counts().values()) == graph.pores - pores
    assert set(graph.event_counts()) == set(EVENT_NAMES)
    triangle, settings = np.zeros(graph.pores, np.int32), settings_of()
    discs = pore_arrays(graph, triangle, settings, 1001)
    bare = replace(graph, node_weight=graph.node_weight * (graph.node_kind == 0), node_kind=None)
    np.testing.assert_array_equal(
        discs.centres, pore_arrays(bare, triangle, settings, 1001).centres
    )


def test_a_graph_without_events_has_none():
    graph = replace(graph_of_events(), node_kind=None)
    triangle = np.zeros(graph.pores, np.int32)
    assert event_arrays(graph, triangle, settings_of(), 1001) is None
    pores = replace(graph, node_kind=np.zeros(graph.pores, np.int32))
    assert event_arrays(pores, triangle, settings_of(), 1001) is None
    check_cover(pores, settings_of(), 1001)


@pytest.mark.parametrize("kind", [-1, MOST_KIND + 1])
def test_unknown_kinds_are_refused(kind):
    graph = graph_of_events()
    kinds = graph.node_kind.copy()
    kinds[7] = kind
    with pytest.raises(GraphError, match=r"node_kind\[7\]"):
        replace(graph, node_kind=kinds)
