"""Crow's feet, which age makes of the leaders that leave the outer corner of an eye: a few rays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.support.cancellation import check_each
from rhytid.synthesis.aged_lines import AgedLine, AgedLines, Look, Ways
from rhytid.synthesis.candidate_graph import Ground
from rhytid.synthesis.fields import level_directions, looked_up
from rhytid.synthesis.hashes import place_keys, unit_intervals
from rhytid.synthesis.lattice import nearest_within
from rhytid.synthesis.lines import Indices, Lines
from rhytid.synthesis.progress import gathered
from rhytid.synthesis.ranks import Ranks
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, unit

Singles = NDArray[np.float32]
# Of how far skin is around an eye: where it lies within.
_WITHIN = 0.5
# Millimetres: how near the eye a ray begins; how far around there the eye says which way is
# outwards; how long it is at least, and as far as it may reach; how far the next is.
_NEAR, _SEEN, _SHORTEST, _REACH, _APART = 13.0, 18.0, 7.0, 30.0, 2.5
# Millimetres from the eye that half of a ray is, at least: what lies on a lid is none.
_OUTSIDE, _TIE = 1.0, 1e-3
# Cosines of the way of a ray to the way outwards, and of that to the level direction, at least:
# elsewhere leaders run along the lids.
_AWAY, _ASIDE = 0.75, 0.7
# How far skin has leaders along a ray at least, in the mean.
_FOLDED = 0.4
# How worn skin is when the first appear, and by chance later.
_ONSET, _LATER = 0.1, 0.5
# Weight of the smallest, of the largest 1.
_SMALL = 0.55
_LOOK = Look(rises=0.25, fades=0.35, begins=0.1, broad=1.5, quiet=0.6, beside=2.5)
# A purpose of random numbers.
_CHANCE = 33


def crows_feet(
    ground: Ground,
    pores: Points,
    lines: Lines,
    weight: Singles,
    millimetre: float,
    worn: float,
    ranks: Ranks,
    seed: int,
) -> AgedLines | None:
    """Those of skin so worn, 1 at 65; None where it has none. Arguments as of `perioral_lines`."""
    eye = looked_up(ground.fields.rays, pores) >= _WITHIN
    if not eye.any():
        return None
    corner = _Eyes(pores, pores.position[eye], millimetre, seed)
    around, ends = corner.around(), lines.pores
    parts = check_each(_by_leader(lines, around, ranks))
    folded = (part for part in parts if _leading(ground, pores, ends[part]) > _FOLDED)
    found = [corner.ray(part, ends[part]) for part in folded]
    ways = Ways(pores, lines, weight, around, millimetre)
    rays = _apart([ray for ray in found if ray is not None], _APART * millimetre)
    return AgedLines.of(rays, _LOOK, ways, worn, min(ranks.rank, 1.0))


def _by_leader(lines: Lines, around: BoolArray, ranks: Ranks) -> list[IntArray]:
    """The wrinkles of each leader along the preferred directions, between pores `around` (N,)."""
    row = gathered(ranks.row, lines.edge[: lines.whole])
    line = np.flatnonzero(row)  # few: all that follows is of leaders alone
    leader = ranks.preferred[row[line]]
    of = (leader >= 0) & around[lines.pores[line]].all(axis=1)
    line, leader = line[of], leader[of]
    order = np.argsort(leader, kind="stable")
    parts = np.split(line[order], np.flatnonzero(np.diff(leader[order])) + 1)
    return [part for part in parts if len(part)]


def _leading(ground: Ground, pores: Points, ends: Indices) -> float:
    """How far skin has leaders at the ends (P, 2) of wrinkles, in the mean."""
    at = ends.ravel()
    leading = ground.fields.leading(pores.triangle[at], pores.uv[at])
    return float(leading.reshape(ends.shape).mean())


@dataclass(frozen=True, eq=False)
class _Ray:
    """A leader that may be a ray.  place (P, 3): of its wrinkles.  far: from the eye to where it
    begins, less its length."""

    drawn: AgedLine
    place: FloatArray
    far: float


class _Eyes:
    """Looks for rays beside eyes.

    within (E, 3): places of pores around eyes.  millimetre: in units of the surface.
    """

    def __init__(self, pores: Points, within: FloatArray, millimetre: float, seed: int) -> None:
        self._pores, self._within, self._millimetre, self._seed = pores, within, millimetre, seed
        self._tree, self._middle = scipy.spatial.cKDTree(within), within.mean(axis=0)

    def around(self) -> BoolArray:
        """(N,) whether rays may lie over pores."""
        found: BoolArray = np.zeros(len(self._pores), np.bool_)
        reach = _REACH * self._millimetre
        found[nearest_within(self._tree, self._pores.position, reach)[0]] = True
        return found

    def ray(self, line: IntArray, ends: Indices) -> _Ray | None:
        """The ray that the wrinkles (P,) of a leader, between pores `ends` (P, 2), are; None where
        they do not lead away from the outer corner of an eye."""
        place, pore = self._pores.position[ends.ravel()], ends.ravel()
        first, last, near = self._ends(place)
        begin, long = place[first], float(np.linalg.norm(place[last] - place[first]))
        way = (place[last] - begin) / max(long, 1e-300)
        if long < _SHORTEST * self._millimetre or near > _NEAR * self._millimetre:
            return None
        if not self._leads_away(int(pore[first]), begin, way):
            return None
        middle = place.reshape(-1, 2, 3).mean(axis=1)
        at = np.clip((middle - begin) @ way / long, 0.0, 1.0)
        key = place_keys(self._pores.uv[pore[[first]]])
        larger, later = (float(u[0]) for u in unit_intervals(key, _CHANCE, self._seed)[:2])
        size, onset = _SMALL + (1.0 - _SMALL) * larger, _ONSET + _LATER * later
        return _Ray(AgedLine(line, at, size, onset), middle, near - long)

    def _ends(self, place: FloatArray) -> tuple[int, int, float]:
        """Which of places (M, 3) on a leader are its beginning and its end, and how far from the
        eye it begins; infinitely far where much of it is on the lids."""
        away = self._tree.query(place)[0]
        # Both ends of one on a lid are at the eye; rays lead from the middle of the face.
        first = int((away + _TIE * np.linalg.norm(place - self._middle, axis=1)).argmin())
        last = int(np.linalg.norm(place - place[first], axis=1).argmax())
        outside = float(np.median(away)) > _OUTSIDE * self._millimetre
        return first, last, float(away[first]) if outside else np.inf

    def _leads_away(self, pore: int, begin: FloatArray, way: FloatArray) -> bool:
        """Whether a way from a pore at `begin` leads away from an eye, and to the side of it that
        is farther from the middle of all eyes."""
        seen = self._tree.query_ball_point(begin, _SEEN * self._millimetre, return_sorted=True)
        centre = self._within[seen].mean(axis=0)
        outwards = unit(begin - centre)
        level = level_directions(self._pores.normal[[pore]].astype(np.float64))[0]
        beside = bool(outwards @ (centre - self._middle) > 0.0)
        aside = abs(float(level @ outwards)) > _ASIDE
        return beside and aside and float(way @ outwards) > _AWAY


def _apart(rays: list[_Ray], apart: float) -> Iterator[AgedLine]:
    """The longest that begin near the eye, as far as they keep apart."""
    taken: list[FloatArray] = []
    for ray in sorted(rays, key=lambda ray: ray.far):
        if taken:
            tree = scipy.spatial.cKDTree(np.concatenate(taken))
            if tree.query(ray.place)[0].min() < apart:
                continue
        taken.append(ray.place)
        yield ray.drawn
