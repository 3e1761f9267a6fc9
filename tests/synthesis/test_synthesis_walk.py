"""One step of the walkers, and lines across the map, against what they mean in double."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.synthesis.edges import DEFINES, Edges
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.seams.charts import BORDER, neighbours, trace
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails import BEYOND, TOGETHER, Paths
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

SPOKES = np.array([0.0, 0.4, 1.2, 1.5, 2.8, 4.0])


# As many ways out as the device reads at a time, and more.
MANY = np.linspace(0.1, 6.0, 11)


def star(work: Workspace, spokes: NDArray[np.float64] = SPOKES) -> Paths:
    """Edges from pore 0 outwards, of lengths that grow."""
    length = 1.0 + 0.2 * np.arange(len(spokes))
    rim = np.stack([np.cos(spokes), np.sin(spokes), 0 * spokes], axis=-1) * length[:, None]
    position = np.concatenate([np.zeros((1, 3)), rim])
    nodes = np.stack([np.zeros(len(spokes)), np.arange(1, len(position))], axis=-1)
    return joined(work, position, nodes.astype(np.int32), length)


def joined(
    work: Workspace,
    position: NDArray[np.float64],
    nodes: NDArray[np.int32],
    length: NDArray[np.float64],
) -> Paths:
    """Edges `nodes` (E, 2) of a length (E,) between pores (N, 3) on the plane z = 0."""
    count = len(position)
    points = Points(np.zeros(count, int), position[:, :2], position, np.eye(3)[[2] * count])
    edges = Edges(nodes, length.astype(np.float32), np.zeros(len(nodes), np.int32))
    along, left = (np.tile(axis.astype(np.float32), (count, 1)) for axis in np.eye(3)[:2])
    lattice = Lattice.absolute(1.0, *np.array([[-4.0] * 3, [4.0] * 3]))
    as_usual = np.ones(count, np.float32)
    return Paths.of(work, points, edges, along, left, as_usual, lattice, 1.5)


def two_floats(x: float, y: float) -> Any:
    return np.array((x, y), [("x", np.float32), ("y", np.float32)])[()]


def walked(
    work: Workspace, paths: Paths, count: int, steps: int, heading: float, appeal: NDArray[Any]
) -> NDArray[np.int32]:
    """(E,) deposits of `count` walkers, as many from each pore, either way along `heading`, 3 at
    each of their steps.  appeal (2E,): of the ways out."""
    ways, rest = paths.ways, np.zeros(BEYOND)
    given = work.upload(np.concatenate([appeal, rest]).astype(np.float32))
    deposit = work.full(paths.edges, np.int32(0))
    work.run(
        "trails", "walk", -(-count // TOGETHER), count, count // paths.pores,
        count / paths.pores, np.uint32(1), np.uint32(7), steps, 3,
        two_floats(np.cos(heading), np.sin(heading)), paths.key, ways.offsets, ways.pairs,
        ways.others, paths.direction, paths.arrival, paths.anisotropy, given, deposit,
        defines=DEFINES,
    )  # fmt: skip
    found: NDArray[np.int32] = work.read(deposit, (paths.edges,), np.int32)
    assert (found % 3 == 0).all()
    return found // 3


@pytest.mark.parametrize("spokes", [SPOKES, MANY], ids=["few", "many"])
def test_walkers_choose_in_proportion_to_appeal_and_straightness(
    device: Device, spokes: NDArray[np.float64]
) -> None:
    appeal, heading, pores = np.linspace(0.5, 2.0, len(spokes)), 0.6, len(spokes) + 1
    each = 10_001  # from each pore: all together are no whole number of work-items
    with Workspace(device) as work:
        # Ways back to the middle have no appeal, so all deposits are steps from there.
        given = np.concatenate([appeal, np.zeros(len(spokes))])
        found = walked(work, star(work, spokes), each * pores, 1, heading, given)
    # Half of those that start in the middle go each way.
    wanted = np.zeros(len(spokes))
    for turned in (0.0, np.pi):
        chance = np.maximum(np.cos(spokes - heading - turned), 0.0) ** 4 * appeal
        wanted += 0.5 * each * chance / chance.sum()
    assert found.sum() == each
    assert found == pytest.approx(wanted, abs=4 * np.sqrt(each / 4))


def test_walkers_go_straight_on(device: Device) -> None:
    # From pore 0 east to pore 1, and from there straight on or 0.7 to the left; all else is shut.
    turn, each = 0.7, 10_000
    ends = np.array([[0.0, 0], [1, 0], [2, 0], [1 + np.cos(turn), np.sin(turn)]])
    position = np.column_stack([ends, np.zeros(4)])
    nodes = np.array([[0, 1], [1, 2], [1, 3]], np.int32)
    with Workspace(device) as work:
        paths = joined(work, position, nodes, np.ones(3))
        ways = paths.ways
        starts = work.read(ways.offsets, (5,), np.int32)
        others = work.read(ways.others, (6,), np.int32)
        pore = np.repeat(np.arange(4), np.diff(starts))
        appeal = ((pore == 0) | ((pore == 1) & (others > 1))).astype(np.float64)
        one, two = (walked(work, paths, 4 * each, steps, 0.0, appeal) for steps in (1, 2))
    # Of those that start at pore 0 half go east; those that start at pore 1 take one step at most.
    second, chance = two - one, np.cos([0.0, turn]) ** 4
    assert second[0] == 0
    assert second[1:].sum() == one[0] == pytest.approx(each / 2, abs=4 * np.sqrt(each / 4))
    wanted = one[0] * chance / chance.sum()
    assert second[1:] == pytest.approx(wanted, abs=4 * np.sqrt(each / 8))


def test_appeal_and_pull_are_the_formulas(device: Device) -> None:
    count = len(MANY)  # no whole number of work-items
    strength = np.linspace(0.0, 9.0, count).astype(np.float32)
    strength[count - 2] = 0.0
    starts = np.array([0, 1, 2, 4, 5, 6, 6, 6, 7, 7, 8, 9], np.int32)
    crossing = np.array([1, 0, 3, 4, 2, 2, 10, 8, 7], np.int32)
    with Workspace(device) as work:
        paths = star(work, MANY)
        pull, appeal = work.full(count + 8, np.float32(-1.0)), work.empty(2 * count, np.float32)
        still = work.empty(1, np.float32)
        work.run("trails", "pull_of_unworn", 1, 0.25, 1.2, still, defines=DEFINES)
        work.run(
            "trails", "pull_of_edges", -(-count // 8), count, 0.25, 1.2, 8.0, 1.5, still,
            work.upload(strength), work.upload(starts), work.upload(crossing), pull,
            defines=DEFINES,
        )  # fmt: skip
        work.run(
            "trails", "appeal_of_ways", paths.pores, paths.ways.offsets, paths.direction,
            paths.ways.pairs, paths.length, pull, paths.anisotropy, 1.5, two_floats(0.0, 1.0),
            0.02, appeal, defines=DEFINES,
        )  # fmt: skip
        pulls = work.read(pull, (count + 8,), np.float32)
        appeals = work.read(appeal, (count,), np.float32)
    assert (pulls[count:] == -1.0).all()
    pulls = pulls[:count]
    across = [strength[crossing[a:b]].sum() for a, b in pairwise(starts)]
    worn = strength / (1 + strength / 8.0)
    assert pulls == pytest.approx((0.25 + worn) ** 1.2 / (1 + 1.5 * np.array(across)), rel=1e-5)
    length = 1.0 + 0.2 * np.arange(count)
    liking = np.abs(np.sin(MANY)) ** 2.5 + 0.02
    assert appeals == pytest.approx(liking * (1.5 / length) ** 1.5 * pulls, rel=2e-3)


@pytest.mark.parametrize("make", [sheets.sheet, sheets.with_hole, sheets.tube])
def test_lines_are_followed_as_in_double(device: Device, make: sheets.Callable[[], Any]) -> None:
    mesh = make()
    pores, edges = sheets.net(device, mesh, 0.03)
    uv, (one, two) = pores.uv.astype(np.float64), edges.nodes.T
    line = trace(
        Surface.of(mesh), neighbours(mesh), pores.triangle[one], uv[one], uv[two] - uv[one]
    )
    drawn: NDArray[np.bool_] = edges.middle != BORDER
    assert (line.share[drawn] == 1.0).all()
    # A middle on an edge may fall to either side.
    assert np.mean(line.middle[drawn] == edges.middle[drawn]) > 0.999
