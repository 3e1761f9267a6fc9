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
from rhytid.synthesis.trails import Paths
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

SPOKES = np.array([0.0, 0.4, 1.2, 1.5, 2.8, 4.0])


def star(work: Workspace) -> Paths:
    """Edges from pore 0 outwards, of lengths that grow."""
    length = 1.0 + 0.2 * np.arange(len(SPOKES))
    rim = np.stack([np.cos(SPOKES), np.sin(SPOKES), 0 * SPOKES], axis=-1) * length[:, None]
    position = np.concatenate([np.zeros((1, 3)), rim])
    count = len(position)
    nodes = np.stack([np.zeros(count - 1), np.arange(1, count)], axis=-1).astype(np.int32)
    points = Points(np.zeros(count, int), position[:, :2], position, np.eye(3)[[2] * count])
    edges = Edges(nodes, length.astype(np.float32), np.zeros(count - 1, np.int32))
    along, left = (np.tile(axis.astype(np.float32), (count, 1)) for axis in np.eye(3)[:2])
    lattice = Lattice.absolute(1.0, *np.array([[-3.0] * 3, [3.0] * 3]))
    as_usual = np.ones(count, np.float32)
    return Paths.of(work, points, edges, along, left, as_usual, lattice, 1.5)


def two_floats(x: float, y: float) -> Any:
    return np.array((x, y), [("x", np.float32), ("y", np.float32)])[()]


def test_walkers_choose_in_proportion_to_appeal_and_straightness(device: Device) -> None:
    appeal, heading, count = np.linspace(0.5, 2.0, len(SPOKES)), 0.6, 70_000
    with Workspace(device) as work:
        paths = star(work)
        ways = paths.ways
        # Ways back to the middle have no appeal, so all deposits are steps from there.
        given = np.concatenate([appeal, np.zeros(len(SPOKES))]).astype(np.float32)
        deposit = work.full(len(SPOKES), np.int32(0))
        work.run(
            "trails", "walk", count, count // paths.pores, count / paths.pores, np.uint32(1),
            np.uint32(7), 1, 3, two_floats(np.cos(heading), np.sin(heading)), paths.key,
            ways.offsets, ways.pairs, ways.others,
            paths.direction, paths.anisotropy, work.upload(given), deposit, defines=DEFINES,
        )  # fmt: skip
        found = work.read(deposit, (len(SPOKES),), np.int32)
    assert (found % 3 == 0).all()
    # One in seven starts in the middle, half of them each way.
    wanted = np.zeros(len(SPOKES))
    for turned in (0.0, np.pi):
        chance = np.maximum(np.cos(SPOKES - heading - turned), 0.0) ** 4 * appeal
        wanted += 0.5 * count / paths.pores * chance / chance.sum()
    assert found.sum() == 3 * count // paths.pores
    assert found / 3 == pytest.approx(wanted, abs=4 * np.sqrt(count / 7 / 4))


def test_appeal_and_pull_are_the_formulas(device: Device) -> None:
    strength = np.linspace(0.0, 9.0, len(SPOKES)).astype(np.float32)
    starts = np.array([0, 1, 2, 4, 5, 6, 6], np.int32)
    crossing = np.array([1, 0, 3, 4, 2, 2], np.int32)
    with Workspace(device) as work:
        paths = star(work)
        pull, appeal = (work.empty(2 * len(SPOKES), np.float32) for _ in range(2))
        still = work.empty(1, np.float32)
        work.run("trails", "pull_of_unworn", 1, 0.25, 1.2, still, defines=DEFINES)
        work.run(
            "trails", "pull_of_edges", len(SPOKES), 0.25, 1.2, 8.0, 1.5, still,
            work.upload(strength), work.upload(starts), work.upload(crossing), pull,
            defines=DEFINES,
        )  # fmt: skip
        work.run(
            "trails", "appeal_of_ways", paths.pores, paths.ways.offsets, paths.direction,
            paths.ways.pairs, paths.length, pull, paths.anisotropy, 1.5, two_floats(0.0, 1.0),
            0.02, appeal, defines=DEFINES,
        )  # fmt: skip
        pulls = work.read(pull, (len(SPOKES),), np.float32)
        appeals = work.read(appeal, (len(SPOKES),), np.float32)
    across = [strength[crossing[a:b]].sum() for a, b in pairwise(starts)]
    worn = strength / (1 + strength / 8.0)
    assert pulls == pytest.approx((0.25 + worn) ** 1.2 / (1 + 1.5 * np.array(across)), rel=1e-5)
    length = 1.0 + 0.2 * np.arange(len(SPOKES))
    liking = np.abs(np.sin(SPOKES)) ** 2.5 + 0.02
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
