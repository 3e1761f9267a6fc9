"""Triangles whose place in the map another has: found by their nearest neighbours, and where there
are none, by a look at all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from rhytid.synthesis import surface
from rhytid.synthesis.surface import _covered_by_others, _inside, _may_cover


def expected(uv: NDArray[Any]) -> NDArray[np.bool_]:
    """By the nearest centres alone."""
    centres = uv.mean(axis=1)
    near = scipy.spatial.cKDTree(centres).query(centres, k=min(surface._NEIGHBOURS, len(uv)))[1]
    others = near.reshape(len(uv), -1).T
    rows = np.arange(len(uv))
    return np.any([(other < rows) & _inside(centres, uv[other]) for other in others], axis=0)


def grid(rng: np.random.Generator, side: int, shaken: float) -> NDArray[np.float64]:
    """(2 side², 3, 2) triangles of a grid in UV whose corners are shaken by a share of a cell."""
    at = np.stack(np.meshgrid(*[np.linspace(0, 1, side + 1)] * 2, indexing="ij"), axis=-1)
    at += shaken / side * rng.normal(size=at.shape)
    low, high = (at[:-1, :-1], at[1:, :-1], at[1:, 1:]), (at[:-1, :-1], at[1:, 1:], at[:-1, 1:])
    return np.concatenate([np.stack(one, axis=-2).reshape(-1, 3, 2) for one in (low, high)])


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", ["plain", "shaken", "heap", "unequal"])
@pytest.mark.parametrize("at_once", [7, 1 << 16])
def test_nothing_is_covered_that_is_not_and_nothing_missed(
    seed: int, kind: str, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surface, "_AT_ONCE", at_once)
    rng = np.random.default_rng(seed)
    uv = grid(rng, int(rng.integers(1, 12)), 0.3 if kind == "shaken" else 0.0)
    if kind == "heap":
        uv = rng.random((60, 1, 2)) + rng.choice([0.05, 0.3]) * rng.random((60, 3, 2))
    elif kind == "unequal":
        uv = np.concatenate([uv, [[[-3.0, -3.0], [6.0, -3.0], [-3.0, 6.0]]]])

    found = _covered_by_others(uv, np.ones(len(uv), bool))

    np.testing.assert_array_equal(found, expected(uv))
    centres = uv.mean(axis=1)
    over = [_inside(centres, np.repeat(one[None], len(uv), axis=0)) for one in uv]
    assert _may_cover(centres, uv) >= (np.array(over) & ~np.eye(len(uv), dtype=bool)).any()
    if kind == "plain":
        assert not _may_cover(centres, uv)
