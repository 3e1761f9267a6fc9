"""Primary lines: a coarse net laid along the edges of the fine one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from reference.synthesis import route
from rhytid.device.runtime import Device
from rhytid.synthesis.candidate_graph import CandidateGraph, Ground
from rhytid.synthesis.fields import Directions, Fields
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.primary_lines import (
    COARSER,
    Primary,
    lay_routes,
    meeting,
    nearest_pores,
    with_primary_lines,
)
from rhytid.synthesis.progress import silent
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails import Paths
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

RADIUS = 0.02
Laid = tuple[CandidateGraph, Primary, NDArray[np.float32], NDArray[np.int32]]


@pytest.fixture(scope="module")
def laid(device: Device) -> Laid:
    """A net on a tube, its primary lines, the weights these give, and where they meet."""
    mesh = sheets.tube()
    with Workspace(device) as work:
        ground = Ground(work, Surface.of(mesh), neighbours(mesh), Fields())
        directions = Directions(RADIUS, np.random.default_rng(1), Fields())
        net = CandidateGraph.build(ground, RADIUS, 8, 1, silent)
        primary = Primary.build(ground, RADIUS, 8, 1, directions, silent)
        paths = net.paths(work, directions, Fields(), silent)
        return net, primary, *primary.laid(ground, net, paths, RADIUS)


def ways_of(net: CandidateGraph) -> list[list[tuple[int, int]]]:
    """For each pore its (edge, other pore)."""
    ways: list[list[tuple[int, int]]] = [[] for _ in range(len(net.pores))]
    for edge, (one, two) in enumerate(net.edges.nodes.tolist()):
        ways[one].append((edge, two))
        ways[two].append((edge, one))
    return ways


def test_lines_take_the_way_of_least_detour(device: Device, laid: Laid) -> None:
    net, primary, weight, _ = laid
    hubs = nearest_in_double(net.pores, primary.pores)
    ways, wanted = ways_of(net), np.zeros(len(net.edges))
    for (one, two), own in zip(primary.ends, primary.weight, strict=True):
        way = route(hubs[one], hubs[two], ways, net.pores.position)
        wanted[way] = np.maximum(wanted[way], own)
    # Where two ways are as long but for rounding, another may be taken.
    assert np.mean(np.abs(weight - wanted) < 1e-5) > 0.999
    assert np.count_nonzero(wanted) > 100


def nearest_in_double(pores: Points, places: Points) -> NDArray[np.intp]:
    """(H,) the pore nearest to each place."""
    apart = np.linalg.norm(pores.position[None] - places.position[:, None], axis=-1)
    return apart.argmin(axis=1)


def test_the_nearest_pore_is_found_or_none(device: Device, laid: Laid) -> None:
    net, primary, _, _ = laid
    with Workspace(device) as work:
        even = np.ones(len(primary.pores), np.float32)
        few = net.pores.take(np.arange(5))
        found = nearest_pores(work, net.pores, primary.pores, 2 * RADIUS, even, net.lattice)
        none = nearest_pores(work, few, primary.pores, RADIUS / 4, even, net.lattice)
        wide = nearest_pores(work, net.pores, primary.pores, RADIUS / 4, 8 * even, net.lattice)
    assert (found == nearest_in_double(net.pores, primary.pores)).all()
    assert np.mean(none == -1) > 0.9
    assert (wide == found).all()


def test_a_line_that_cannot_arrive_is_not_laid(device: Device) -> None:
    pores, edges = sheets.net(device, sheets.face_to_face(), 0.04)
    frame = np.zeros((len(pores), 3), np.float32)
    up = pores.normal[:, 2] > 0
    one, two = np.flatnonzero(up)[[0, -1]]
    apart = np.linalg.norm(pores.position - pores.position[two], axis=1)
    other = np.argmin(np.where(up, np.inf, apart))
    hubs = np.array([one, two, other, -1], np.int32)
    with Workspace(device) as work:
        lattice = Lattice.absolute(0.04, *Surface.of(sheets.face_to_face()).extent)
        paths = Paths.of(work, pores, edges, frame, frame, frame[:, 0], lattice, 0.06)
        for ends, any_laid in (([0, 1], True), ([0, 2], False), ([0, 3], False), ([1, 1], False)):
            line = np.array([ends], np.int32)
            found = lay_routes(work, pores, paths, hubs, line, np.ones(1, np.float32))
            assert found.any() == any_laid


def test_primary_lines_go_far_and_meet_evenly(laid: Laid) -> None:
    net, primary, weight, hubs = laid
    on = net.edges.nodes[weight > 0]
    assert 0.1 < len(on) / len(net.edges) < 0.35
    # They end at hubs alone.
    degree = np.bincount(on.ravel(), minlength=len(net.pores))
    ends = np.flatnonzero(degree == 1)
    assert np.isin(ends, hubs).all()
    apart = np.linalg.norm(net.pores.position[hubs][:, None] - net.pores.position[hubs], axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert apart.min() > (COARSER - 2.0) * RADIUS
    assert len(hubs) > 0.9 * len(primary.pores)


def test_what_is_primary_is_deeper() -> None:
    strength, primary = np.float32([0.5, 1.0, 0.5]), np.float32([0.0, 0.0, 0.5])
    found = with_primary_lines(strength, primary)
    assert found[1] == pytest.approx(2 * found[0])
    assert found[2] > 3 * found[1]


def test_a_small_surface_has_none(device: Device) -> None:
    mesh = sheets.sheet()
    with Workspace(device) as work:
        ground = Ground(work, Surface.of(mesh), neighbours(mesh), Fields())
        directions = Directions(0.1, np.random.default_rng(1), Fields())
        assert not len(Primary.build(ground, 0.1, 8, 1, directions, silent).ends)


def test_where_lines_meet_are_the_pores_at_their_ends() -> None:
    ends = np.array([[4, 1], [-1, 4], [2, -1]], np.int32)
    assert meeting(ends, 7).tolist() == [1, 2, 4]
    assert meeting(ends[:0], 7).tolist() == []
