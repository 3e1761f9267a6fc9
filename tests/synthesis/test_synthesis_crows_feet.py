"""Crow's feet: rays that age makes of the leaders beside the outer corner of an eye."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import count
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.skin import COARSE, depth_factor
from rhytid.errors import CancelledError
from rhytid.support import cancellation
from rhytid.synthesis import assembly, crows_feet
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.lattice import nearest_within
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.test_synthesis_leaders import COUNT, MESH, MILLIMETRE, folds

# The eye is left of this.
EDGE = 0.42


@cache
def grown(
    device: Device, age: float, angle: float = 90.0, anatomy: str = "fine", rank: float = 1.0
) -> WrinkleGraph:
    """Skin beside an eye that is compressed along `angle` degrees to the way out from there."""
    eye = (MESH.positions[:, 0] < EDGE).astype(np.float32)
    settings = GraphSettings(
        wrinkles=COUNT, age=age, anatomy=anatomy, rank=rank, patches=0.0, events=0.0
    )
    found = replace(folds(angle=angle), regions={"eye_corner": eye})
    return synthesize(MESH, settings, device, folds=found).graph


@cache
def without(
    device: Device, age: float, angle: float = 90.0, anatomy: str = "fine", rank: float = 1.0
) -> WrinkleGraph:
    with patch.object(assembly, "crows_feet", lambda *_: None):
        return grown.__wrapped__(device, age, angle, anatomy, rank)


def deepened(one: WrinkleGraph, two: WrinkleGraph) -> NDArray[np.intp]:
    np.testing.assert_array_equal(one.edge_nodes, two.edge_nodes)
    return np.flatnonzero(one.edge_weight > two.edge_weight + 0.02)


def test_they_leave_the_eye_as_a_few_rays(device: Device) -> None:
    skin, bare = grown(device, 65.0), without(device, 65.0)
    np.testing.assert_array_equal(skin.node_uv, bare.node_uv)
    lines = deepened(skin, bare)
    assert len(lines) > 40
    ends = sheets.places(Surface.of(MESH), skin)[skin.edge_nodes[lines]]
    step, middle = ends[:, 1] - ends[:, 0], ends.mean(axis=1)
    along = np.abs(step[:, 0]) / np.linalg.norm(step, axis=1)
    assert np.median(along) > 0.85
    assert middle[:, 0].min() > EDGE
    assert middle[:, 0].max() < EDGE + 32 * MILLIMETRE
    assert np.ptp(middle[:, 0]) > 10 * MILLIMETRE


def test_there_are_none_where_lines_run_along_the_lid(device: Device) -> None:
    skin, bare = grown(device, 65.0, 0.0), without(device, 65.0, 0.0)
    assert not len(deepened(skin, bare))


def test_fifty_has_a_hint_of_them(device: Device) -> None:
    def deeper(age: float) -> float:
        skin, bare = grown(device, age), without(device, age)
        lines = deepened(skin, bare)
        return depth_factor(age) * float((skin.edge_weight - bare.edge_weight)[lines].sum())

    assert 0.02 * deeper(65.0) < deeper(50.0) < 0.6 * deeper(65.0)


@pytest.mark.parametrize(
    ("age", "anatomy", "rank"),
    [(20.0, "fine", 1.0), (35.0, "fine", 1.0), (65.0, COARSE, 1.0), (65.0, "fine", 0.0)],
)
def test_skin_without_them_is_what_it_was(
    device: Device, age: float, anatomy: str, rank: float
) -> None:
    skin = grown(device, age, anatomy=anatomy, rank=rank)
    bare = without(device, age, anatomy=anatomy, rank=rank).arrays()
    for name, array in skin.arrays().items():
        np.testing.assert_array_equal(array, bare[name])


@pytest.fixture
def skin(device: Device, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, ...]:
    """What crow's feet of old skin are drawn by."""
    found: list[tuple[Any, ...]] = []
    with monkeypatch.context() as patched:
        patched.setattr(assembly, "crows_feet", lambda *about: found.append(about))
        grown.__wrapped__(device, 65.0)
    return found[0]


def test_they_stop_at_each_leader(skin: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    asked, at = [0], []
    find = crows_feet._Eyes.ray

    def ask() -> None:
        asked[0] += 1

    def ray(*about: Any) -> Any:
        at.append(asked[0])
        return find(*about)

    monkeypatch.setattr(crows_feet._Eyes, "ray", ray)
    with cancellation.scope(ask):
        crows_feet.crows_feet(*skin)
    assert len(at) > 10
    assert np.diff(at, prepend=0).min() > 0
    for stop in np.linspace(0, at[-1], 8).astype(int):
        left = iter(range(stop))

        def cancel(left: Any = left) -> None:
            if next(left, None) is None:
                raise CancelledError("enough")

        with cancellation.scope(cancel), pytest.raises(CancelledError, match="enough"):
            crows_feet.crows_feet(*skin)


def test_pores_far_from_eyes_are_not_searched_for() -> None:
    """Of each a tree takes long to say that it is not near, and no job can stop meanwhile."""
    rng, asked, checks = np.random.default_rng(1), [], count()
    places, eye = 10.0 * rng.random((200_000, 3)), rng.random((500, 3))
    tree = scipy.spatial.cKDTree(eye)

    class Tree:
        data = tree.data

        def query(self, some: Any, **reach: float) -> Any:
            asked.append(len(some))
            return tree.query(some, **reach)

    with cancellation.scope(lambda: (next(checks), None)[1]):
        near, distance, nearest = nearest_within(Tree(), places, 3.0)
    every = tree.query(places, distance_upper_bound=3.0)
    np.testing.assert_array_equal(near, np.flatnonzero(np.isfinite(every[0])))
    np.testing.assert_array_equal(distance, every[0][near])
    np.testing.assert_array_equal(nearest, every[1][near])
    assert sum(asked) < 0.5 * len(places)
    assert next(checks) >= len(asked) > 1
    assert not len(nearest_within(tree, places + 100.0, 3.0)[0])
