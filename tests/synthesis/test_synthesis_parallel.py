"""What the device decides at once is what goes one by one in double."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from reference.synthesis import crossing_pairs, pairs_in_sight, thrown_one_by_one
from rhytid.device import launches
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh
from rhytid.synthesis import workspace
from rhytid.synthesis.dart_selection import DartSelection, Throw
from rhytid.synthesis.edges import LEAST_ANGLE, REACH, crossings
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.pores import Darts
from rhytid.synthesis.surface import Surface
from rhytid.synthesis.workspace import Workspace
from synthesis import sheets

pytestmark = pytest.mark.release

RADIUS = 0.05
MESHES = pytest.mark.parametrize("make", [sheets.sheet, sheets.tube, sheets.face_to_face])


class Wider(Fields):
    """Pores the further apart the further right in the map."""

    least_spacing, most_spacing = 0.5, 2.0

    def spacing(self, triangle: NDArray[np.int32], uv: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.float32(0.5) + uv[:, 0]


@MESHES
@pytest.mark.parametrize("fields", [Fields(), Wider()], ids=["even", "wider"])
def test_darts_are_kept_as_if_thrown_one_by_one(
    device: Device, monkeypatch: pytest.MonkeyPatch, make: Callable[[], Mesh], fields: Fields
) -> None:
    monkeypatch.setattr("rhytid.synthesis.dart_selection._SPARE", 16)  # so that it must make room
    with Workspace(device) as work:
        darts = Darts(work, Surface.of(make()), fields, RADIUS, 5, 700)
        sieve, none = (DartSelection(work, darts.lattice, RADIUS, fields, 10.0) for _ in range(2))
        thrown = []
        for turn in range(2):
            for throw in darts.throws(turn, 2000 / darts.room, none):
                sieve.take(throw)
                thrown.append(counting(work, throw))
        pores = sieve.points()[0]
    assert len(thrown) > 4
    place, normal, factor = (np.concatenate(arrays) for arrays in zip(*thrown, strict=True))
    kept = thrown_one_by_one(place, normal, factor, range(len(place)), RADIUS / darts.lattice.unit)
    wanted = darts.lattice.positions(place[kept])
    assert sorted(pores.position.tolist()) == sorted(wanted.tolist())


@MESHES
@pytest.mark.parametrize("fields", [Fields(), Wider()], ids=["even", "wider"])
def test_darts_that_are_left_out_ahead_would_not_be_kept(
    device: Device, make: Callable[[], Mesh], fields: Fields
) -> None:
    surface, found, looked_at = Surface.of(make()), [], []
    with Workspace(device) as work:
        for sifts in (False, True):
            darts = Darts(work, surface, fields, RADIUS, 5, 700)
            sieve, none = (
                DartSelection(work, darts.lattice, RADIUS, fields, 5000.0) for _ in range(2)
            )
            looked_at.append(0)
            for turn in range(3):
                for throw in darts.throws(turn, 2000 / darts.room, sieve if sifts else none):
                    sieve.take(throw)
                    looked_at[-1] += throw.count
            found.append(sorted(sieve.points()[0].position.tolist()))
    assert looked_at[1] < 0.7 * looked_at[0]
    assert found[0] == found[1]


def counting(work: Workspace, throw: Throw) -> tuple[NDArray[Any], ...]:
    """Places, normals and factors of the darts that count, in the order of their priorities."""
    count = throw.count
    factor = work.read(throw.factor, (count,), np.float32)
    level = work.read(throw.level, (count,), np.float32)
    order = np.argsort(work.read(throw.priority, (count,), np.uint32), kind="stable")
    order = order[(level * factor * factor < 1)[order]]
    place = work.read(throw.place, (count, 3), np.int32)
    return place[order], work.read(throw.normal, (count, 3), np.float32)[order], factor[order]


def test_darts_are_uniform_by_area_in_space(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = Surface.of(sheets.sheet(sheets.uneven))
    count = 100_000
    with Workspace(device) as work:
        darts = Darts(work, surface, Fields(), RADIUS, 5, 2 * count)
        none = DartSelection(work, darts.lattice, RADIUS, Fields(), 10.0)
        monkeypatch.setattr("rhytid.synthesis.pores._FIRST", 2 * count)
        (place, _, _) = counting(work, next(darts.throws(0, count / darts.room, none)))
    assert len(place) == pytest.approx(count, rel=1e-3)
    position = darts.lattice.positions(place)
    counts, _, _ = np.histogram2d(position[:, 0], position[:, 1], 8)
    # Chi squared with 63 degrees of freedom: mean 63, deviation 11.2. Every triangle has its share,
    # so it is far less.
    expected = count / counts.size
    assert np.sum((counts - expected) ** 2 / expected) < 63 + 5 * 11.2


def test_few_darts_are_thrown_first_and_then_as_many_as_before(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.synthesis.pores._FIRST", 100)
    with Workspace(device) as work:
        darts = Darts(work, Surface.of(sheets.sheet(sheets.uneven)), Fields(), RADIUS, 5, 3000)
        sieve = DartSelection(work, darts.lattice, RADIUS, Fields(), 10.0)
        thrown = [[t.of for t in darts.throws(turn, 3000 / darts.room, sieve)] for turn in range(2)]
    first, second = thrown
    assert first[0] <= 100
    assert first[1:] == pytest.approx(np.cumsum(first)[:-1].tolist(), rel=0.3)
    assert len(second) == 2
    assert max(second) <= 3000
    assert sum(second) == sum(first)


def test_how_many_darts_are_thrown_at_a_time_changes_no_pore(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = sheets.scattered(device, sheets.tube(), 0.03)
    monkeypatch.setattr("rhytid.synthesis.pores.BATCH", 1500)
    monkeypatch.setattr("rhytid.synthesis.pores.MOST_AT_A_TIME", 1500)
    monkeypatch.setattr("rhytid.synthesis.pores._FIRST", 50)
    parts = sheets.scattered(device, sheets.tube(), 0.03)
    assert whole.position.tobytes() == parts.position.tobytes()
    assert whole.uv.tobytes() == parts.uv.tobytes()


@pytest.mark.slow
@MESHES
@pytest.mark.parametrize("count", [4, 8])
def test_edges_join_what_is_in_sight(device: Device, make: Callable[[], Mesh], count: int) -> None:
    pores, edges = sheets.net(device, make(), RADIUS, count=count)
    wanted = pairs_in_sight(pores.position, pores.normal, count, REACH * RADIUS, LEAST_ANGLE)
    found = set(map(tuple, edges.nodes.tolist()))
    assert found <= wanted
    # A sheet and a tube can be drawn on everywhere but across the borders of what they end at.
    assert len(found) > 0.98 * len(wanted)


@pytest.mark.slow
@MESHES
def test_crossings_are_those_of_all_pairs(device: Device, make: Callable[[], Mesh]) -> None:
    pores, _ = sheets.net(device, make(), RADIUS)
    nodes = some_pairs(pores.position)
    length = np.linalg.norm(pores.position[nodes[:, 0]] - pores.position[nodes[:, 1]], axis=-1)
    with Workspace(device) as work:
        found = crossings(work, pores, nodes, length.astype(np.float32))
    wanted = crossing_pairs(pores.position, pores.normal.astype(float), nodes)
    assert len(wanted) > 1000
    assert len(found) == len(wanted)
    assert set(map(tuple, np.sort(found, axis=1).tolist())) == wanted


@pytest.mark.slow
def test_edges_that_cross_many_take_no_more_memory(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    pores, _ = sheets.net(device, sheets.sheet(), RADIUS)
    nodes = some_pairs(pores.position)
    length = np.linalg.norm(pores.position[nodes[:, 0]] - pores.position[nodes[:, 1]], axis=-1)
    with Workspace(device) as work:
        wanted = crossings(work, pores, nodes, length.astype(np.float32))
    monkeypatch.setattr("rhytid.synthesis.edges._BLOCK", 1024)
    slots = []
    run = Workspace.run

    def counted(work: Workspace, program: str, *rest: Any, **named: Any) -> None:
        if program == "crossings":
            slots.append(rest[1] * named["defines"]["CROSSINGS"])
        run(work, program, *rest, **named)

    monkeypatch.setattr(Workspace, "run", counted)
    with Workspace(device) as work:
        found = crossings(work, pores, nodes, length.astype(np.float32))
    assert found.tolist() == wanted.tolist()
    assert np.bincount(found[:, 0]).max() > 50
    assert max(slots) <= 8 * 1024


def some_pairs(position: np.ndarray) -> np.ndarray:
    """Pairs of points near each other, and a few that are far apart."""
    rng = np.random.default_rng(3)
    nodes = rng.integers(len(position), size=(60_000, 2))
    distance = np.linalg.norm(position[nodes[:, 0]] - position[nodes[:, 1]], axis=-1)
    chosen = (distance > 0) & (distance < 3 * RADIUS)
    chosen[:20] = distance[:20] > 0
    return np.unique(np.sort(nodes[chosen], axis=1), axis=0).astype(np.int32)


@pytest.mark.slow
def test_launch_shape_changes_no_bit(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = synthesize(sheets.tube(), sheets.wanted(2000), device).graph.arrays()
    for name, items in (("MOST_ITEMS", 192), ("LEAST_ITEMS", 16), ("FIRST_ITEMS", 16)):
        monkeypatch.setattr(launches, name, items)
    monkeypatch.setattr(workspace, "_GROUP", 16)
    blocks = synthesize(sheets.tube(), sheets.wanted(2000), device).graph.arrays()
    for name, array in whole.items():
        assert array.tobytes() == blocks[name].tobytes(), name
