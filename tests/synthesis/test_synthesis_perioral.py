"""Lines that age draws from the border of a painted lip."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import COARSE, depth_factor
from rhytid.support import cancellation
from rhytid.synthesis import assembly, perioral
from rhytid.synthesis.aged_lines import Ways
from rhytid.synthesis.generate import synthesize
from synthesis import sheets
from synthesis.painted import painted

MESH, COUNT = sheets.sheet(), 15_000
# The lip is a band as wide as the sheet: shares of its height at which it is white.
LOW, HIGH = 0.42, 0.58
# Pores are half a millimetre apart where nothing is painted: the sheet is some 40 mm high.
MILLIMETRE = 0.8 / 40


@cache
def lip_and_mouth() -> Controls:
    v = 1.0 - (np.arange(64) + 0.5) / 64
    inside = ((v > LOW) & (v < HIGH)).astype(np.float32)
    lip = np.repeat(inside[:, None], 64, axis=1)
    return painted(region_lip=lip, region_mouth=np.float32(1.0) - lip)


@cache
def folds() -> Folds:
    """Skin that is compressed along the lip, and folds across it."""
    tensor = np.zeros((len(MESH.positions), 6), np.float32)
    tensor[:, 0] = 0.04**2
    return Folds(tensor, ENOUGH)


def fanned() -> Folds:
    """The same with a fan: lines that run down and outwards beside the lower lip, on the left."""
    x, y, _ = MESH.positions.T
    there = (x < 0.3) & (y < LOW) & (y > LOW - 0.25)
    fans = np.zeros((len(x), 6), np.float32)
    fans[there, 0] = 0.2**2
    return replace(folds(), fans=fans)


@cache
def grown(
    device: Device, age: float, anatomy: str = "fine", rank: float = 1.0, fan: bool = False
) -> WrinkleGraph:
    settings = GraphSettings(
        wrinkles=COUNT, patches=0.0, events=0.0, age=age, anatomy=anatomy, rank=rank
    )
    found = fanned() if fan else folds()
    return synthesize(MESH, settings, device, controls=lip_and_mouth(), folds=found).graph


@cache
def without(
    device: Device, age: float, anatomy: str = "fine", rank: float = 1.0, fan: bool = False
) -> WrinkleGraph:
    with patch.object(assembly, "perioral_lines", lambda *_: None):
        return grown.__wrapped__(device, age, anatomy, rank, fan)


def deepened(one: WrinkleGraph, two: WrinkleGraph) -> NDArray[np.intp]:
    """Lines that are deeper in the first graph, of two with the same lines."""
    np.testing.assert_array_equal(one.edge_nodes, two.edge_nodes)
    return np.flatnonzero(one.edge_weight > two.edge_weight + 0.02)


@pytest.mark.parametrize(
    ("age", "anatomy", "rank"),
    [(20.0, "fine", 1.0), (35.0, "fine", 1.0), (65.0, COARSE, 1.0), (65.0, "fine", 0.0)],
)
def test_skin_without_them_is_what_it_was(
    device: Device, age: float, anatomy: str, rank: float
) -> None:
    bare = without(device, age, anatomy, rank).arrays()
    for name, array in grown(device, age, anatomy, rank).arrays().items():
        np.testing.assert_array_equal(array, bare[name])


def test_they_come_with_the_rank(device: Device) -> None:
    change = []
    for rank in (0.02, 0.5, 1.0, 2.0):
        skin = grown(device, 65.0, rank=rank)
        bare = without(device, 65.0, rank=rank)
        change.append(skin.edge_weight - bare.edge_weight)
    hint, half, whole, more = change
    assert np.abs(hint).max() < 0.02
    deeper = [np.maximum(each, 0.0).sum() for each in (half, whole, more)]
    assert 0.05 * deeper[1] < deeper[0] < 0.6 * deeper[1]
    assert deeper[2] > 0.8 * deeper[1]


def test_they_are_nearly_straight(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[NDArray[np.int64]] = []
    along = Ways.along

    def kept(self: Ways, *course: Any) -> tuple[NDArray[Any], NDArray[Any]] | None:
        found = along(self, *course)
        drawn.extend([] if found is None else [found[0]])
        return found

    monkeypatch.setattr(Ways, "along", kept)
    skin = grown.__wrapped__(device, 65.0)
    assert len(drawn) > 15
    winding = []
    for lines in drawn:
        ends = skin.node_uv[skin.edge_nodes[lines]].astype(np.float64)
        between = np.linalg.norm(ends.reshape(-1, 1, 2) - ends.reshape(-1, 2), axis=-1)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        winding.append(length.sum() / between.max())
        assert between.max() > 4.5 * MILLIMETRE
    assert np.median(winding) < 1.06
    assert max(winding) < 1.1


def test_they_run_up_and_down_from_the_border_and_fade(device: Device) -> None:
    skin, bare = grown(device, 65.0), without(device, 65.0)
    np.testing.assert_array_equal(skin.node_uv, bare.node_uv)
    lines = deepened(skin, bare)
    assert len(lines) > 60
    ends = skin.node_uv[skin.edge_nodes[lines]].astype(np.float64)
    step, v = ends[:, 1] - ends[:, 0], ends[..., 1].mean(axis=1)
    along = np.abs(step[:, 1]) / np.linalg.norm(step, axis=1)
    assert np.median(along) > 0.85
    away = np.maximum(v - HIGH, LOW - v)
    assert -0.03 < away.min() < 0.03
    assert 0.1 < away.max() < 0.35
    near, far = away < np.percentile(away, 40), away > np.percentile(away, 80)
    weight = skin.edge_weight[lines]
    assert weight[near].mean() > 1.5 * weight[far].mean()


def test_fifty_has_a_hint_of_them(device: Device) -> None:
    def drawn(age: float) -> tuple[int, float]:
        skin, bare = grown(device, age), without(device, age)
        lines = deepened(skin, bare)
        deeper = skin.edge_weight[lines] - bare.edge_weight[lines]
        return len(lines), depth_factor(age) * float(deeper.sum())

    some, hint = drawn(50.0)
    more, deep = drawn(65.0)
    assert 0 < some < more
    assert 0.05 * deep < hint < 0.45 * deep


def test_skin_beside_them_is_softer(device: Device) -> None:
    skin, bare = grown(device, 65.0), without(device, 65.0)
    softer = np.flatnonzero(skin.edge_weight < bare.edge_weight - 0.02)
    lines = deepened(skin, bare)
    middle = skin.node_uv[skin.edge_nodes].mean(axis=1)
    gap = np.linalg.norm(middle[softer][:, None] - middle[lines], axis=-1).min(axis=1)
    assert len(softer) > 60
    assert gap.max() < 0.08


def test_there_are_none_in_a_fan(device: Device) -> None:
    skin, bare = grown(device, 65.0, fan=True), without(device, 65.0, fan=True)
    assert bare.edge_share is not None

    def in_fan(lines: NDArray[np.intp]) -> NDArray[np.intp]:
        x, v = (skin.node_uv[skin.edge_nodes[lines]].mean(axis=1).T - 0.1) / 0.8
        found: NDArray[np.intp] = lines[(x < 0.27) & (v < LOW) & (v > 0.2)]
        return found

    assert len(in_fan(np.flatnonzero(bare.edge_share > 1.02))) > 15
    lines = deepened(skin, bare)
    assert len(lines) > 60
    assert not len(in_fan(lines))


def test_a_job_can_stop_while_the_lip_is_looked_at() -> None:
    """Of dense skin there are tens of thousands of places, each of which sees thousands."""
    rng, checks = np.random.default_rng(1), []
    lip, place = rng.random((400, 3)), rng.random((1000, 3))
    tree = scipy.spatial.cKDTree(lip)
    with cancellation.scope(lambda: checks.append(1)):
        found = perioral._centres(tree, lip, place, 0.3)
    assert len(checks) > 10
    seen = tree.query_ball_point(place, 0.3, return_sorted=True)
    np.testing.assert_array_equal(found, [lip[of].mean(axis=0) for of in seen])
