"""Crow's feet: rays that age makes of the leaders beside the outer corner of an eye."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.skin import COARSE, depth_factor
from rhytid.synthesis import assembly
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.test_synthesis_leaders import COUNT, MESH, MILLIMETRE, folds

# The eye is left of this.
EDGE = 0.42


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


def without(
    device: Device, monkeypatch: pytest.MonkeyPatch, age: float, *others: float
) -> WrinkleGraph:
    with monkeypatch.context() as patched:
        patched.setattr(assembly, "crows_feet", lambda *_: None)
        return grown(device, age, *others)


def deepened(one: WrinkleGraph, two: WrinkleGraph) -> NDArray[np.intp]:
    np.testing.assert_array_equal(one.edge_nodes, two.edge_nodes)
    return np.flatnonzero(one.edge_weight > two.edge_weight + 0.02)


def test_they_leave_the_eye_as_a_few_rays(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    skin, bare = grown(device, 65.0), without(device, monkeypatch, 65.0)
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


def test_there_are_none_where_lines_run_along_the_lid(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    skin, bare = grown(device, 65.0, 0.0), without(device, monkeypatch, 65.0, 0.0)
    assert not len(deepened(skin, bare))


def test_fifty_has_a_hint_of_them(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    def deeper(age: float) -> float:
        skin, bare = grown(device, age), without(device, monkeypatch, age)
        lines = deepened(skin, bare)
        return depth_factor(age) * float((skin.edge_weight - bare.edge_weight)[lines].sum())

    assert 0.02 * deeper(65.0) < deeper(50.0) < 0.6 * deeper(65.0)


@pytest.mark.parametrize(
    ("age", "anatomy", "rank"),
    [(20.0, "fine", 1.0), (35.0, "fine", 1.0), (65.0, COARSE, 1.0), (65.0, "fine", 0.0)],
)
def test_skin_without_them_is_what_it_was(
    device: Device, monkeypatch: pytest.MonkeyPatch, age: float, anatomy: str, rank: float
) -> None:
    skin = grown(device, age, anatomy=anatomy, rank=rank)
    monkeypatch.setattr(assembly, "crows_feet", lambda *_: None)
    bare = grown(device, age, anatomy=anatomy, rank=rank).arrays()
    for name, array in skin.arrays().items():
        np.testing.assert_array_equal(array, bare[name])
