"""Lines that bend, taper and go on as one, and what keeps them whole, through the stages."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meshes import deform
from pipeline.binned import BinnedScene
from pipeline.scenes import DEPTH, Scene, random_graph, settings_of, sheet
from reference import bends, drawing, locate, redraw
from reference import bins as reference
from reference.response import pore_stretch, wrinkle_stretch
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.tiles import udim_origin

# The claim of line.clh.
BOUND = 1e-3 * DEPTH
LINES = {"curvature": 1.0, "taper": 1.0}
ALL: dict[str, Any] = {
    "shape": {**LINES, "least_half_width": 0.7},
    "response": {"ends": 1.0, "soft_limits": True, "pore_depth_limit": 2.0},
}
ARRAYS = ("edge_slopes", "edge_end_weights", "edge_end_half_widths", "edge_partners")


def bent(graph: WrinkleGraph, seed: int = 1, steepest: float = 0.6) -> WrinkleGraph:
    """With slopes, sizes of its ends and partners at random."""
    rng, size = np.random.default_rng(seed), (graph.wrinkles, 2)
    return replace(
        graph,
        edge_slopes=rng.uniform(-steepest, steepest, size).astype(np.float32),
        edge_end_weights=rng.uniform(0, 1, size).astype(np.float32),
        edge_end_half_widths=(graph.edge_half_width[:, None] * rng.uniform(0.5, 1.0, size)).astype(
            np.float32
        ),
        edge_partners=rng.integers(-1, graph.wrinkles, size),
    )


# Half widths up to a fifth of the length, as the claim has it, when widened by a fifth.
def shared(graph: WrinkleGraph, seed: int = 5) -> WrinkleGraph:
    """With shares at random."""
    share = np.random.default_rng(seed).uniform(0.0, 2.5, graph.wrinkles)
    return replace(graph, edge_share=share.astype(np.float32))


GRAPH = bent(random_graph(41, 120, (0.004, 0.02), (0.15, 0.4), metric=True))
FINE = bent(random_graph(42, 300, (0.0005, 0.003), (0.03, 0.2), metric=True))


class BentScene(Scene):
    """Whose reference knows of bends."""

    def expected(self, points, positions, udim=1001, model="tensor"):
        settings, origin = self.settings, udim_origin(udim)
        logs, axes = self.reference_logs(positions, model)
        logs_at, axes_at = locate.sample(self._wrinkle, logs, axes)
        r = wrinkle_stretch(logs_at, axes_at, redraw.directions(self.graph))
        given = settings.response, settings.shape, 1 / settings.resolution, origin
        lines = bends.lines(self.graph, r, *given)
        at_pores, _ = locate.sample(self._pore, logs, axes)
        discs = bends.discs(self.graph, pore_stretch(at_pores), *given)
        return drawing.draw(points, lines, discs, settings.shape, DEPTH)

    def reference_logs(self, positions, model="tensor"):
        if not self.settings.response.soft_limits:
            return super().reference_logs(positions, model)
        wide = replace(self.settings.response, log_stretch_limit=50.0)
        settings, self.settings = self.settings, replace(self.settings, response=wide)
        logs, axes = super().reference_logs(positions, model)
        self.settings = settings
        limit = settings.response.log_stretch_limit
        return bends.held(logs, limit, limit), axes


# Each setting without the others.
ALONE = [
    {"shape": {"curvature": 0.5}},
    {"shape": {"taper": 0.7}},
    {"response": {"ends": 1.0}},
    {"response": {"ends": 0.4, "soft_limits": True}},
    {"response": {"pore_depth_limit": 1.5}},
    {"shape": {"least_half_width": 0.7}},
]


@pytest.mark.parametrize(
    "graph", [pytest.param(GRAPH, id="wide"), pytest.param(FINE, id="fine", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "changes",
    [
        *(pytest.param(one, marks=pytest.mark.slow) for one in ALONE),
        {"shape": LINES},
        ALL,
    ],
    ids=str,
)
def test_redrawn_crops_are_those_of_double(device, graph, changes):
    scene = BentScene(device, sheet(), graph, settings_of(**changes))
    positions = np.float32(0.93) * deform(scene.mesh.positions, 5, 0.15)
    found = scene.redrawn(positions, at=(64, 128), side=64)
    points = drawing.crop(64, 128, 64, 64, 256)
    wanted = scene.expected(points, positions).reshape(64, 64)
    assert np.abs(found - wanted).max() <= BOUND
    plain = Scene(device, scene.mesh, graph, settings_of()).redrawn(
        positions, at=(64, 128), side=64
    )
    assert np.abs(found - plain).max() > 0.03 * DEPTH


def test_without_the_arrays_and_with_their_settings_at_0_the_drawing_is_the_same(device):
    positions = deform(sheet().positions, 5, 0.15)
    plain = replace(GRAPH, **dict.fromkeys(ARRAYS))
    on = {"shape": LINES, "response": {"ends": 1.0}}
    maps = [
        Scene(device, sheet(), graph, settings_of(**changes)).redrawn(positions)
        for graph, changes in ((plain, {}), (GRAPH, {}), (plain, on))
    ]
    assert Scene(device, sheet(), plain, settings_of(**on)).elements().line_defines == {}
    for other in maps[1:]:
        np.testing.assert_array_equal(other, maps[0])


@pytest.mark.parametrize("changes", [{}, {"response": {"ends": 1.0}}, ALL], ids=str)
def test_shares_are_those_of_double(device, changes):
    scene = BentScene(device, sheet(), shared(GRAPH), settings_of(**changes))
    positions = np.float32(0.93) * deform(scene.mesh.positions, 5, 0.15)
    found = scene.redrawn(positions, at=(64, 128), side=64)
    points = drawing.crop(64, 128, 64, 64, 256)
    wanted = scene.expected(points, positions).reshape(64, 64)
    assert np.abs(found - wanted).max() <= BOUND
    plain = Scene(device, scene.mesh, GRAPH, settings_of(**changes))
    assert np.abs(found - plain.redrawn(positions, at=(64, 128), side=64)).max() > 0.1 * DEPTH


def test_shares_of_1_and_no_stretch_change_nothing(device):
    positions = deform(sheet().positions, 5, 0.15)
    ones = replace(GRAPH, edge_share=np.ones(GRAPH.wrinkles, np.float32))
    for graph, frame in ((ones, positions), (shared(GRAPH), None)):
        maps = [
            Scene(device, sheet(), one, settings_of(**ALL)).redrawn(frame) for one in (graph, GRAPH)
        ]
        np.testing.assert_array_equal(*maps)


def test_tiles_are_crops(device):
    scene = BentScene(device, sheet(), GRAPH, settings_of(**ALL))
    positions = deform(scene.mesh.positions, 6, 0.15)
    whole = scene.redrawn(positions)
    for row, column in ((0, 0), (64, 128), (192, 192)):
        tile = scene.redrawn(positions, at=(row, column), side=64)
        np.testing.assert_array_equal(tile, whole[row : row + 64, column : column + 64])


@pytest.mark.slow
@pytest.mark.parametrize("udim", [1001, 1002, 1011, 1012])
def test_partners_in_other_udims_count_and_no_arc_is_cut_off(device, udim):
    graph = bent(random_graph(43, 60, (0.01, 0.05), (0.4, 0.8), span=2.0), 3, 0.8)
    graph = replace(graph, node_weight=0 * graph.node_weight)
    scene = BentScene(device, sheet(udims=2), graph, settings_of(**ALL))
    positions = deform(scene.mesh.positions, 7, 0.15)
    found = scene.redrawn(positions, udim)
    some = range(0, 256, 3)  # texels of each side: the reference takes its time
    wanted = scene.expected(drawing.texels(some, some, 256), positions, udim)
    wanted = wanted.reshape(len(some), -1)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found[::3, ::3] - wanted).max() <= 2.0 * BOUND
    elements = scene.elements(udim)
    assert elements.wrinkles > len(np.unique(device.read(
        elements.wrinkle_lists.members, (elements.wrinkle_lists.members.nbytes // 4,), np.int32
    )))  # fmt: skip


def line_of_two(weights):
    """A strong wrinkle and a faint one that goes on from it along u, on a sheet."""
    node = np.array([[0.1, 0.503], [0.5, 0.503], [0.9, 0.503]], np.float32)
    return WrinkleGraph(
        node_uv=node, node_weight=np.zeros(3), node_radius=np.full(3, 0.01),
        edge_nodes=np.array([[0, 1], [1, 2]]), edge_weight=np.array(weights),
        edge_half_width=np.full(2, 0.02),
        edge_end_weights=np.array([[weights[0], np.mean(weights)], [np.mean(weights), weights[1]]]),
        edge_partners=np.array([[-1, 1], [0, -1]]),
    )  # fmt: skip


def test_a_strong_segment_beside_a_faint_one_is_no_staple(device):
    """Along the bottom of a line of two whose parts are squeezed by different amounts."""
    mesh, graph = sheet(), line_of_two((0.8, 0.1))
    positions = mesh.positions.copy()
    left = positions[:, 0] < np.median(positions[:, 0])
    positions[left, 1] *= 0.8
    steps = []
    for changes in ({"response": {"ends": 1.0}, "shape": LINES}, {}):
        scene = BentScene(device, mesh, graph, settings_of(**changes))
        bottom = scene.redrawn(positions).min(axis=0) / DEPTH
        steps.append(np.abs(np.diff(bottom[100:156])).max())
    assert steps[0] < 0.1
    assert steps[1] > 0.4


def test_lines_below_a_texel_keep_their_mean_and_do_not_break_into_dots(device):
    """Against the mean of 4 x 4 texels of a map four times as fine."""
    graph = bent(random_graph(45, 200, (0.0008, 0.002), (0.1, 0.4)), 5, 0.3)
    graph = replace(graph, node_weight=0 * graph.node_weight)
    shape, off = {"wrinkle_bulge": 0.0, "sharpness": 1.0}, []
    for least in (0.7, 0.0):
        wanted = {"shape": {**shape, **LINES, "least_half_width": least}}
        coarse, fine = (
            Scene(device, sheet(), graph, settings_of(resolution=size, **wanted)).redrawn(None)
            for size in (256, 1024)
        )
        mean = fine.reshape(256, 4, 256, 4).mean(axis=(1, 3))
        off.append(np.sqrt(np.mean((coarse - mean) ** 2) / np.mean(mean**2)))
    assert off[0] < 0.6 * off[1]


@pytest.mark.slow
@pytest.mark.parametrize("merge", ["min", "mellow"])
def test_bins_draw_the_same_lines(device, merge):
    """Each bin as redraw draws it at the stretch of the sample, all else being 0."""
    graph = replace(GRAPH, node_weight=0 * GRAPH.node_weight)
    settings = settings_of(bins={"merge": merge, "bits": 16}, **ALL)
    made = BinnedScene(device, sheet(), graph, settings)
    straight = BinnedScene(device, sheet(), graph, settings_of(bins={"merge": merge, "bits": 16}))
    theta = redraw.directions(made.graph)
    own, _ = reference.assign(theta, settings.bins.count)
    for layer in range(settings.bins.count):
        found = made.layers()[layer]
        graph = replace(made.graph, edge_weight=made.graph.edge_weight * (own == layer))
        for sample, r in enumerate(reference.samples(settings.bins)):
            given = replace(settings.response, ends=0.0), settings.shape, 1 / 256, (0.0, 0.0)
            lines = bends.lines(graph, np.full(graph.wrinkles, r), *given)
            valleys, bulges = drawing.meet(made.points, lines, None, settings.shape)
            sides = [valleys, bulges] if merge == "mellow" else [bulges - valleys]
            depth = bends.scale(np.array(r), -settings.response.alpha_d, True)
            step = (depth + reference.HEADROOM) / (2**15 - 1)
            off = np.abs(found[sample] * step - np.array(sides))
            assert off.max() <= 1e-3 + step
        assert np.abs(found - straight.layers()[layer]).max() > 100
