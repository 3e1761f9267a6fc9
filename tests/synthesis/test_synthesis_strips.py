"""How lines share the shortening of a strip of skin, against sums over all pairs of pores."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhytid.synthesis import strips
from rhytid.synthesis.strips import Strips

PORES, LINES, SPACING = 400, 900, 0.05


def made() -> tuple[Strips, tuple[np.ndarray, ...]]:
    """Lines between pores by chance, and the arguments of `given`: every ninth leads, and asks as
    far as one of two families."""
    rng = np.random.default_rng(5)
    pores = rng.integers(PORES, size=(LINES, 2)).astype(np.int32)
    position, mass = rng.random((PORES, 3)) * [1.0, 1.0, 0.01], rng.random(LINES)
    edge, weight = np.arange(LINES, dtype=np.int32), rng.random(LINES).astype(np.float32)
    lead = np.arange(0, LINES, 9)
    strip = rng.choice([2.0, 3.5], len(lead))
    takes = rng.random(len(lead)).astype(np.float32) * np.float32(20.0)
    return Strips(edge, pores, weight, mass, position, SPACING), (lead, takes, strip)


def wanted(
    lines: Strips, lead: np.ndarray, takes: np.ndarray, strip: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    asked, there, farthest = np.zeros((3, PORES))
    others = np.delete(np.arange(LINES), lead)
    for side in (0, 1):
        ends = lines.pores[:, side]
        np.add.at(asked, ends[lead], 0.5 * lines.mass[lead] * takes)
        np.add.at(there, ends[others], 0.5 * lines.mass[others])
        np.maximum.at(farthest, ends[lead], strip)
    apart = np.linalg.norm(lines.position[:, None] - lines.position, axis=-1)
    reach = np.where(asked > 0, farthest * SPACING, 1e-9)[:, None]
    near = np.where(apart <= reach, 1.0 - (apart / reach) ** 2, 0.0) ** 2
    offered = near * there
    asks = asked[:, None] * offered / np.maximum(offered.sum(axis=1), 1e-300)[:, None]
    of_all = asks.sum(axis=0) / np.maximum(there, 1e-300)
    least = np.minimum(1.0, 0.8 / np.maximum(of_all, 1e-300))
    return (asks * least).sum(axis=1) / np.maximum(asked, 1e-300), of_all * least


def test_what_leaders_ask_for_is_given_by_the_pores_around_them() -> None:
    lines, given = made()
    got, gives = lines.given(*given)
    for found, sums in zip((got, gives), wanted(lines, *given), strict=True):
        np.testing.assert_allclose(found, sums, rtol=1e-12, atol=1e-300)
    assert (gives > 0.79).any()
    assert (gives[gives > 0] < 0.5).any()
    assert (got[got > 0] < 0.99).any()


def test_how_many_pores_ask_at_a_time_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    lines, given = made()
    whole = lines.given(*given)
    monkeypatch.setattr(strips, "_ASKING", 7)
    for found, before in zip(lines.given(*given), whole, strict=True):
        assert found.tobytes() == before.tobytes()


def test_without_leaders_nobody_asks() -> None:
    lines, _ = made()
    none = np.zeros(0, np.intp)
    got, gives = lines.given(none, np.zeros(0, np.float32), np.zeros(0))
    assert not got.any()
    assert not gives.any()


def test_pores_that_nobody_asks_are_not_looked_at_and_count_for_nothing() -> None:
    lines, given = made()
    got, gives = lines.given(*given)
    far = np.concatenate([lines.position[:50] + 7.0, lines.position])
    moved = replace(lines, pores=lines.pores + np.int32(50), position=far)
    for found, usual in zip(moved.given(*given), (got, gives), strict=True):
        np.testing.assert_array_equal(found[:50], 0.0)
        np.testing.assert_array_equal(found[50:], usual)
