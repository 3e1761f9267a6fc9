"""Furrows of the forehead: a few long level leaders, and what is small between them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.expressions import ENOUGH, Folds
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.leader_families import CROSSING, FURROWS, PREFERRED
from rhytid.synthesis.ranks import Ranks
from synthesis.test_synthesis_leaders import COUNT, MESH, MILLIMETRE, traced


def raised(region: str = "forehead") -> Folds:
    """Skin that is compressed along y, as by raised brows."""
    tensor = np.zeros((len(MESH.positions), 6), np.float32)
    tensor[:, 1] = 0.15**2
    return Folds(tensor, ENOUGH, {region: np.ones(len(tensor), np.float32)})


def test_a_forehead_has_a_few_that_run_across_it(device: Device) -> None:
    leaders, pores = traced(device, MESH, raised())
    family = leaders.courses.wishes.family[leaders.row]
    furrows = np.flatnonzero(family == FURROWS.number)
    lines = [pores.points.position[pores.line == n] for n in furrows]
    assert 3 <= len(lines) <= 6
    assert min(np.ptp(line[:, 0]) for line in lines) > 30 * MILLIMETRE
    for n, line in enumerate(lines):
        others = np.concatenate(lines[:n] + lines[n + 1 :])
        assert np.median(cKDTree(others).query(line)[0]) > 7 * MILLIMETRE
    between = np.isin(family, (CROSSING.number, PREFERRED.number))
    assert between.sum() > len(lines)
    length = (leaders.last - leaders.first) * CROSSING.pace
    assert np.median(length[between]) < 0.6 * length[furrows].min()
    none = traced(device, MESH, raised("cheek"))[0]
    assert not (none.courses.wishes.family[none.row] == FURROWS.number).any()


def test_they_deepen_with_age_and_what_is_between_does_not(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[Ranks] = []
    of = Ranks.of

    def kept(*given: Any) -> Ranks:
        found.append(of(*given))
        return found[-1]

    monkeypatch.setattr(Ranks, "of", kept)
    for age in (35.0, 65.0):
        synthesize(MESH, GraphSettings(wrinkles=COUNT, age=age), device, folds=raised())
    young, old = ([ranks.family == f.number for f in (FURROWS, CROSSING)] for ranks in found)
    for small in (young[1], old[1]):
        assert small.sum() > 40
    depth = [[r.weight[of].mean() for of in fs] for r, fs in zip(found, (young, old), strict=True)]
    assert depth[1][0] > 1.5 * depth[0][0]
    assert depth[1][1] < 0.9 * depth[0][1]
    assert depth[1][1] < 0.5 * depth[1][0]
    width = [found[1].width[of].mean() for of in old]
    assert width[0] > 1.3 * width[1]
