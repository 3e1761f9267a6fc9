"""Perioral lines, which age draws from the border of the lips over the skin around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.support import cancellation
from rhytid.synthesis.aged_lines import AgedLine, AgedLines, Look, Ways
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import level_directions, looked_up
from rhytid.synthesis.hashes import Words, place_keys, unit_intervals
from rhytid.synthesis.lattice import nearest_within
from rhytid.synthesis.lines import Lines
from rhytid.synthesis.progress import row_blocks
from rhytid.synthesis.ranks import Ranks
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, unit

Singles = NDArray[np.float32]
# Shares of a lip from which on a pore lies within it, and of the mouth around it; and how far skin
# has a fan from which on it has no perioral lines.
_WITHIN, _AROUND, _FANNED = 0.5, 0.25, 0.5
# Millimetres: how far from the lip lines begin; how far around a place the lip says which way is
# outwards.
_BEGIN, _SEEN = 1.3, 6.0
# Cosine to the vertical from which on lines begin above or below the lips: none at their corners,
# which fans leave.
_UPRIGHT = 0.6
# Millimetres from one to the next, at least and by chance more; below the lips as many times that.
_APART, _FARTHER, _BELOW = 1.3, 2.2, 1.7
# Millimetres that one is to be long, and by chance longer.
_SHORTEST, _LONGER = 7.0, 3.0
# How far outwards lines spread, and lean by chance.
_SPREAD, _LEAN = 0.35, 0.2
# How worn skin is when the first appear, and by chance later.
_ONSET, _LATER = 0.1, 0.5
# Weight of the smallest, of the largest 1.
_SMALL = 0.65
_LOOK = Look(rises=0.12, fades=0.45, begins=0.5, broad=1.4, quiet=0.5, beside=2.2)
# Where there is no way, the next is looked for so far from there, millimetres.
_MISSED = 0.3
# Places that the lip is seen from at a time: of dense skin each sees thousands of pores.
_TOGETHER = 64
# A purpose of random numbers.
_CHANCE = 31


def perioral_lines(
    ground: Ground,
    pores: Points,
    lines: Lines,
    weight: Singles,
    millimetre: float,
    worn: float,
    ranks: Ranks,
    seed: int,
) -> AgedLines | None:
    """Those of skin so worn, 1 at 65; None where it has none.

    weight (W,): of the lines.  millimetre: in units of the surface.
    """
    lip, uneven, fans = (
        looked_up(of, pores)
        for of in (ground.fields.creases, ground.fields.uneven, ground.fields.fans)
    )
    around = (uneven > _AROUND) & (lip < _WITHIN) & (fans < _FANNED)
    if not around.any() or not (lip >= _WITHIN).any():
        return None
    border = _Border.of(pores, around, pores.position[lip >= _WITHIN], millimetre, seed)
    ways = Ways(pores, lines, weight, around, millimetre)
    return AgedLines.of(border.across(ways), _LOOK, ways, worn, min(ranks.rank, 1.0))


@dataclass(frozen=True, eq=False)
class _Border:
    """B pores beside the lips.

    pore (B,).  place (B, 3).  key (B,), chance (4, B): a word and numbers from 0 to 1 of each.
    level, up (B, 3): unit tangents.  beside, above (B,): the way outwards from the lip along these,
    of length 1 at most.
    """

    pore: IntArray
    place: FloatArray
    key: Words
    chance: FloatArray
    level: FloatArray
    up: FloatArray
    beside: FloatArray
    above: FloatArray
    millimetre: float

    @classmethod
    def of(
        cls, pores: Points, around: BoolArray, lip: FloatArray, millimetre: float, seed: int
    ) -> _Border:
        """Of pores `around` (N,) those near pores of the lip, which are at `lip` (L, 3)."""
        tree, pore = scipy.spatial.cKDTree(lip), np.flatnonzero(around)
        pore = pore[nearest_within(tree, pores.position[pore], _BEGIN * millimetre)[0]]
        place, normal = pores.position[pore], pores.normal[pore].astype(np.float64)
        level, key = level_directions(normal), place_keys(pores.uv[pore])
        up = np.cross(normal, level)
        outwards = unit(place - _centres(tree, lip, place, _SEEN * millimetre))
        beside, above = ((outwards * axis).sum(axis=1) for axis in (level, up))
        chance = np.array(unit_intervals(key, _CHANCE, seed), np.float64)
        return cls(pore, place, key, chance, level, up, beside, above, millimetre)

    def across(self, ways: Ways) -> Iterator[AgedLine]:
        """Lines up from the upper lip, and fewer down from the lower one."""
        tree, free = scipy.spatial.cKDTree(self.place), np.abs(self.above) > _UPRIGHT
        course = self._courses()
        for row in np.argsort(self.key, kind="stable").tolist():
            if not free[row]:
                continue
            cancellation.check()
            found = ways.along(self.pore[row], course[row])
            first, larger, _, later = self.chance[:, row].tolist()
            apart = _APART + _FARTHER * first if found else _MISSED
            apart *= _BELOW if self.above[row] < 0 else 1.0
            free[tree.query_ball_point(self.place[row], apart * self.millimetre)] = False
            if found:
                yield AgedLine(*found, _SMALL + (1.0 - _SMALL) * larger, _ONSET + _LATER * later)

    def _courses(self) -> FloatArray:
        """(B, 3) from each pore to where a line from there is to end: away from the lip."""
        _, long, lean, _ = self.chance
        aside = _SPREAD * self.beside + _LEAN * (2.0 * lean - 1.0)
        way = unit(np.sign(self.above)[:, None] * self.up + aside[:, None] * self.level)
        found: FloatArray = (_SHORTEST + _LONGER * long)[:, None] * self.millimetre * way
        return found


def _centres(
    tree: scipy.spatial.cKDTree, lip: FloatArray, place: FloatArray, reach: float
) -> FloatArray:
    """(B, 3) the middle of the lip (L, 3) within `reach` of each place (B, 3)."""
    found: FloatArray = np.empty(place.shape)
    for rows in row_blocks(len(place), _TOGETHER):
        seen = tree.query_ball_point(place[rows], reach, return_sorted=True)
        found[rows] = [lip[of].mean(axis=0) for of in seen]
    return found
