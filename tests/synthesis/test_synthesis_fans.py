"""The fan of a corner of the mouth: which way its lines run, and how they come with age."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.skin import depth_factor
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.leader_families import FANS
from synthesis.test_synthesis_leaders import COUNT, MESH, MILLIMETRE, folds, traced


def corner() -> np.ndarray:
    """(V, 6) skin that folds around a corner of a mouth, within 15 mm below (0.25, 0.8)."""
    way = MESH.positions[:, :2] - np.float32([0.25, 0.8])
    far = np.linalg.norm(way, axis=1)
    x, y = way.T / np.maximum(far, 1e-6)
    rows = np.stack([y * y, x * x, 0 * x, -x * y, 0 * x, 0 * x], axis=1)
    beside = (far > 2 * MILLIMETRE) & (far < 15 * MILLIMETRE) & (y < -0.5)
    return (beside[:, None] * 0.2**2 * rows).astype(np.float32)


def test_a_corner_of_the_mouth_has_a_few_lines_that_leave_it_as_a_fan(device: Device) -> None:
    leaders, pores = traced(device, MESH, replace(folds(), fans=corner()))
    family = leaders.courses.wishes.family[leaders.row]
    fan = np.flatnonzero(family == FANS.number)
    assert 4 <= len(fan) <= 12
    lines = [pores.points.position[pores.line == n] for n in fan]
    length = [np.linalg.norm(line[-1] - line[0]) / MILLIMETRE for line in lines]
    assert 4.0 < min(length) < 0.8 * max(length) < 12.0
    turns = []
    for line in lines:
        way, out = line[-1] - line[0], line.mean(axis=0) - np.array([0.25, 0.8, 0.0])
        cosine = abs(way @ out) / np.linalg.norm(way) / np.linalg.norm(out)
        turns.append(np.degrees(np.arccos(min(cosine, 1.0))))
    assert np.median(turns) < 12.0
    assert max(turns) < 25.0
    without, _ = traced(device, MESH, folds())
    assert not np.isin(FANS.number, without.courses.wishes.family[without.row])
    others = [n for n in np.unique(pores.line) if n not in fan]
    far = [pores.points.position[pores.line == n][:, 0].min() > 0.44 for n in others]
    assert all(far)


@pytest.mark.parametrize(("folded", "least"), [(0.0, 1.2), (0.5, 2.2)], ids=["even", "folded"])
def test_a_fan_comes_with_age(device: Device, folded: float, least: float) -> None:
    """Most where other expressions fold skin, too, for lines there deepen with age."""
    tensor = folds().tensor + np.float32(folded) * corner()
    found = replace(folds(), tensor=tensor, fans=corner())
    depth = []
    for age in (20.0, 35.0, 65.0):
        settings = GraphSettings(wrinkles=COUNT, age=age, patches=0.0, events=0.0)
        graph = synthesize(MESH, settings, device, folds=found).graph
        left = graph.node_uv[graph.edge_nodes, 0].mean(axis=1) < 0.44
        led = left & (graph.edge_share > 1.02)
        assert np.count_nonzero(led) > 10
        depth.append(depth_factor(age) * graph.edge_weight[led].mean())
    assert depth[0] < 0.08 * depth[1]
    assert depth[2] > least * depth[1]
