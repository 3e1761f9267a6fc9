"""What leaders make of the lines around them: weights and widths by rank.

A leader is deeper and broader than other lines. They are fainter beside it, the nearer the more,
and wherever skin folds one way.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.skin import wear
from rhytid.synthesis.candidate_graph import CandidateGraph
from rhytid.synthesis.fields import Fields, looked_up
from rhytid.synthesis.lattice import Around
from rhytid.synthesis.leader_families import (
    CREASES,
    CROSSING,
    FAMILIES,
    FANS,
    PREFERRED,
    RHOMBI,
    RINGS,
    leading_any_way,
    leading_of,
)
from rhytid.synthesis.leaders import LeaderEdges, LeaderPores, edges_along
from rhytid.synthesis.lines import Indices
from rhytid.synthesis.progress import over_rows
from rhytid.synthesis.shapes import WIDE
from rhytid.synthesis.strips import Strips

Singles = NDArray[np.float32]
# Priority of a leader's edges: above that of any other, below the classes of edges.
_FIRST = np.float32(64.0)
# Strength that a leader's edges have as walkers set out: they are drawn along it.
_WORN = np.float32(3.0)
# Weight of the deepest leader at rest, before factors of the skin; half widths, in those of a line
# of strength 1, of the faintest leader and of the deepest.
_DEEPEST = 0.5
# Factors of these at 65, for leaders are what expressions leave behind: they are deeper and, lest
# their sides be steeper, broader. The same of the weight of others where skin folds one way. Below
# 35 a factor of its own is taken to a negative power: leaders are fainter there, and what lies
# between them is less quiet, but weaker for its age; their width is that of 35. Where lines are
# uneven, as around the mouth, leaders stay as narrow as at 35: broad ones would be dells there. The
# pair of a frown is seen at rest from 50 on: it deepens more.
_OLD, _OLD_PAIR, _YOUNG, _OLD_BROAD = 1.9, 4.1, 2.4, 1.45
# Power of its profile at 65: as deep all along as others, and as narrow as at 35, it was a slit.
_OLD_PAIR_UNEVEN = 1.5
# What is uneven deepens most by its region, so that leaders there would be as deep as lines can be
# from 50 on, and 65 would look like 50; and of others less is left at 65.
_OLD_NARROW = 0.7
# The fan of a corner of the mouth is not there at 20, a hint at 35, and plain at 65, to which what
# age makes of lines where skin folds adds more than this.
_OLD_FAN, _YOUNG_FAN = 1.6, 8.0
# Rhombi of the neck deepen with its region.
_OLD_RHOMBI = 1.5
# Of the level ones of a forehead the furrows deepen, and the small ones between stay what they are.
_OLD_SMALL = 0.8
_OLD_OTHERS, _OLD_UNEVEN, _YOUNG_OTHERS = 0.65, 0.3, 0.75
# Powers of the size and of the profile of leaders at 65: small ones come up to the large ones, so
# that more are seen, and they are deep for a little more of their length. More was slits.
_OLD_SIZE, _OLD_PROFILE = 0.5, 0.85
_NARROW, _BROAD = 0.6, 1.25
# How far other lines are fainter: beside a leader, and where skin folds one way; how far from a
# leader, in pore spacings, the first ends.
_BESIDE, _FOLDED, _REACH = 0.3, 0.5, 4.0
# The same where skin has creases, and from which share of such a region on: well before these
# begin, or its border would be a furrow; and where it folds, but no one way, as above the corner of
# the mouth: directions whirl there, and strong lines would be a winding ridge along the lip.
_CREASED, _RIM, _CRUMPLED = 0.8, 0.3, 0.75
# How much less of the shortening than its family says a leader of weight 1 takes. It fades to the
# ends as the depth does, for pressed skin would make cuts of them. What they take, others give:
# strips.py.
_DEEP_TAKES = 0.6
# What is left of that at 65, where they follow the preferred directions or are the pair of a frown:
# they are deep at rest, and pressed as hard as at 35 they were cuts, as deep as lines can be from
# end to end, with sides of 60 degrees. Level ones of the forehead are long and never so steep.
_OLD_TAKES = 0.1
# By the numbers of families, what leaders take more than by themselves, and how far from.
_TAKES_MORE = np.array([family.takes - 1.0 for family in FAMILIES], np.float32)
_STRIPS = np.array([family.strip for family in FAMILIES])
_PAIR = [family.number for family in FAMILIES if family.single]
_RHOMBI = [family.number for family in RHOMBI]
_STEEP = [PREFERRED.number, CROSSING.number, *_PAIR, *_RHOMBI]
# Those that may lie between furrows of the forehead; and those that stay as uneven with age.
_SMALL, _UNEVEN = [PREFERRED.number, CROSSING.number], [RINGS.number, *_RHOMBI]
_TINY = np.float32(1e-6)
# Pores on a leader would be beads on a string: of their depth is left.
_BEADS = 0.6


@dataclass(frozen=True, eq=False)
class Ranks:
    """Leaders among the edges of a candidate graph.

    row (E,) int32: where each edge stands in the arrays of K rows, the first of which is for all
    edges that are no part of a leader: 0, or infinite.
    weight (K,) float32: before factors of the skin.  most (K,) float32: the largest factor of the
    skin: with it a leader is as deep as lines can be in its middle, or a crease as deep as it is at
    the usual distance of pores, and tapers from there as others do.  width (K,) float32: half
    widths, in pore spacings.  profile (K,) float32: from 0 at both ends of a leader to 1.
    family (K,) int8: the number.  preferred (K,) int32: the leader, along the preferred directions,
    and -1 for others.
    quiet (N,) float32: factor of the weight of other lines at each pore.  creased (N,) float32: one
    more, where skin has creases.
    calm (N,) float32: how far patches do not make other lines livelier, at each pore.
    of_pores (N,) float32: factor of the depth of the pores.  uneven (N,) float32: how far
    other lines differ by chance from those beside them, at each pore.  rank: the setting.
    worn_by_age: how worn skin is at its age.
    """

    row: Indices
    weight: Singles
    most: Singles
    width: Singles
    profile: Singles
    family: NDArray[np.int8]
    preferred: Indices
    quiet: Singles
    creased: Singles
    calm: Singles
    of_pores: Singles
    uneven: Singles
    rank: float
    worn_by_age: float = 0.0

    @classmethod
    def of(
        cls,
        net: CandidateGraph,
        leaders: LeaderPores,
        fields: Fields,
        spacing: float,
        settings: GraphSettings,
    ) -> Ranks:
        """Find the edges along leaders.

        leaders: the first pores of the net.  spacing: mean distance of pores on even skin.
        """
        rank, worn = settings.rank, wear(settings.age)
        along, place = edges_along(net, leaders), (net.pores.triangle, net.pores.uv)
        row = np.zeros(len(net.edges), np.int32)
        row[along.edge] = np.arange(1, len(along.edge) + 1)
        leading = looked_up(partial(leading_any_way, fields), net.pores)
        uneven = np.minimum(rank, 1.0) * looked_up(fields.uneven, net.pores) * leading
        uneven = np.minimum(uneven, 1.0).astype(np.float32)
        even = 1.0 - uneven[net.edges.nodes[along.edge]].mean(axis=1)
        at = net.edges.nodes[along.edge, 0]
        leads = leading_of(along.family, fields, *(values[at] for values in place))
        usual, one = np.float32(leaders.usual), np.float32(1.0)
        own = np.where(along.family == CREASES.number, usual, one)
        small = np.where(
            np.isin(along.family, _SMALL),
            np.minimum(fields.crossing(*(values[at] for values in place)), 1.0),
            0.0,
        )
        middle, profile, width = _sizes(along, even, leads, rank, worn, own, small)
        most = np.minimum(own, 1.0) / middle
        quiet = (1.0 - _BESIDE * _nearness(net, leaders, _REACH * spacing)) * (
            1.0 - _FOLDED * leading
        )
        quiet *= 1.0 - _CRUMPLED * looked_up(fields.crumpled, net.pores)
        quiet *= _of_others(worn, uneven) ** (worn * leading)
        creased = looked_up(fields.creased, net.pores)
        creased = 1.0 - _CREASED * np.minimum(creased / _RIM, 1.0)
        preferred = np.where(along.family == PREFERRED.number, along.leader, -1)
        of_pores = np.ones(len(net.pores), np.float32)
        of_pores[net.first] = _BEADS ** min(rank, 1.0)
        return cls(
            row, _beside_none(0.0, middle * profile), _beside_none(np.inf, most),
            _beside_none(0.0, width), _beside_none(0.0, np.minimum(profile, 1.0)),
            np.append(0, along.family).astype(np.int8), np.append(-1, preferred).astype(np.int32),
            (quiet**rank).astype(np.float32),
            (creased**rank).astype(np.float32), calm_of(leading, rank), of_pores, uneven, rank,
            worn,
        )  # fmt: skip

    @property
    def leads(self) -> NDArray[np.bool_]:
        """(E,) whether each edge is part of a leader."""
        found: NDArray[np.bool_] = (self.weight > 0)[self.row]
        return found

    def of_lines(self, edge: NDArray[np.int32], pores: NDArray[np.int32]) -> RankedLines:
        """What W lines are by their ranks.  edge (W,), pores (W, 2): of each."""
        row = self.row[edge]
        weight, leads = self.weight[row], self.weight[row] > 0
        quiet, calm = (
            np.float32(0.5) * (values[pores[:, 0]] + values[pores[:, 1]])
            for values in (self.quiet, self.calm)
        )
        # Of a hard mask the lines that end beyond it would be a ring.
        quiet *= self.creased[pores].min(axis=1)
        factor = np.where(leads, np.float32(1.0), quiet)
        return RankedLines(leads, weight, self.most[row], self.width[row], factor, calm)

    def unevenness(self, edge: NDArray[np.int32], pores: NDArray[np.int32]) -> Singles:
        """How far W lines differ from those beside them; leaders have sizes of their own.
        Arguments as of `of_lines`."""
        found = np.empty(len(edge), np.float32)

        def find(rows: slice) -> None:
            one, two = pores[rows].T
            uneven = np.float32(0.5) * (self.uneven[one] + self.uneven[two])
            leads = self.weight[self.row[edge[rows]]] > 0
            found[rows] = np.where(leads, np.float32(0.0), uneven)

        over_rows(len(found), find)
        return found

    def worn(self) -> Singles:
        """(E,) strengths that walkers find as they set out."""
        found: Singles = np.where(self.leads, _WORN, np.float32(0.0))
        return found

    def raised(self, strength: Singles) -> Singles:
        """(E,) strengths in which leaders come before all other edges."""
        found = np.empty(len(strength), np.float32)

        def raise_some(rows: slice) -> None:
            weight = self.weight[self.row[rows]]
            found[rows] = np.where(weight > 0, _FIRST + weight, strength[rows])

        over_rows(len(found), raise_some)
        return found

    def shares(self, strips: Strips) -> Singles:
        """(W,) shares of W lines; over a strip of skin their mean by mass is 1."""
        lead = np.flatnonzero(self.leads[strips.edge])
        row, ends = self.row[strips.edge[lead]], strips.pores
        takes = (_TAKES_MORE[self.family[row]] - _DEEP_TAKES * strips.weight[lead]) * self.rank
        takes *= self.profile[row] * _left_to(self.family[row], self.worn_by_age)
        taken, given = strips.given(lead, takes, _STRIPS[self.family[row]])
        share = np.empty(len(ends), np.float32)

        def find(rows: slice) -> None:
            share[rows] = 1.0 - 0.5 * (given[ends[rows, 0]] + given[ends[rows, 1]])

        over_rows(len(share), find)
        kept = 0.5 * (taken[ends[lead, 0]] + taken[ends[lead, 1]])
        share[lead] = 1.0 + takes * kept
        return share


@dataclass(frozen=True, eq=False)
class RankedLines:
    """Of W lines: leads, whether each is part of a leader; of those that are, weight, most and
    width as in `Ranks`; factor, of the weight of each; of the others, calm as in `Ranks`."""

    leads: NDArray[np.bool_]
    weight: Singles
    most: Singles
    width: Singles
    factor: Singles
    calm: Singles


def _sizes(
    along: LeaderEdges,
    even: NDArray[np.floating],
    leading: NDArray[np.floating],
    rank: float,
    worn: float,
    own: NDArray[np.floating],
    small: NDArray[np.floating],
) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
    """(L,) weights of leaders in their middle, profiles and half widths in pore spacings, at an
    age.

    even (L,): how far lines there are like those beside them.  leading (L,): how far skin has
    leaders of that family.  own (L,): the distance of pores that sizes are meant for, of what it
    is.  small (L,): how far each lies between furrows of the forehead.
    """
    # Those that expressions leave behind; lips have creases at any age.
    aged = np.where(along.family == CREASES.number, 0.0, worn)
    pair, fan = np.isin(along.family, _PAIR), along.family == FANS.number
    old = np.where(pair, _OLD_PAIR, _OLD**even * _OLD_NARROW ** (1.0 - even))
    old = old ** (1.0 - small) * _OLD_SMALL**small
    old, young = np.where(fan, _OLD_FAN, old), np.where(fan, _YOUNG_FAN, _YOUNG)
    rhombi = np.isin(along.family, _RHOMBI)
    old = np.where(rhombi, _OLD_RHOMBI, old)
    deepest = _DEEPEST * (old if worn > 0.0 else young) ** aged
    comes = np.where(pair | fan | np.isin(along.family, _UNEVEN), 0.0, aged * (1.0 - small))
    shown = np.maximum(along.profile, _TINY)
    middle = deepest.astype(np.float32) * min(rank, 1.0) * along.depth * own / shown
    risen, profile = _older(along.depth / shown, along.profile, leading, comes)
    profile = profile ** (1.0 + pair * (_OLD_PAIR_UNEVEN - 1.0) * np.maximum(aged, 0.0))
    broad = min(rank, 1.0) * (_NARROW + (_BROAD - _NARROW) * along.size)
    broader = np.where(pair, 1.0, even) * np.maximum(aged, 0.0)
    return np.clip(middle * risen, _TINY, 1.0), profile, WIDE * broad * own * _OLD_BROAD**broader


def _older(
    middle: NDArray[np.floating],
    profile: NDArray[np.floating],
    leading: NDArray[np.floating],
    aged: NDArray[np.floating],
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(L,) factors of the depths of leaders in their middle, and their profiles, as worn as `aged`
    (L,) says, exactly 1 and as they are where that is not above 0.
    Where skin has leaders less, by `leading` (L,), they stay as much shallower."""
    worn = np.clip(aged, 0.0, 1.0)
    less = (1.0 - _OLD_SIZE) * worn
    there = np.sqrt(np.clip(leading, _TINY, 1.0))
    risen = (there / np.maximum(middle, _TINY)) ** less
    return risen, profile ** (1.0 - (1.0 - _OLD_PROFILE) * worn)


def _left_to(family: NDArray[np.int8], worn: float) -> Singles:
    """(L,) what is left by age of what leaders of families by numbers (L,) take; exactly 1 up to
    35."""
    old = np.isin(family, _STEEP) * np.float32(min(max(worn, 0.0), 1.0))
    found: Singles = np.float32(_OLD_TAKES) ** old
    return found


def _of_others(worn: float, uneven: Singles) -> Singles | float:
    """(N,) what of the weight of other lines is left at 65, or is there before 35, by how uneven
    they are (N,)."""
    if worn <= 0.0:
        return _YOUNG_OTHERS
    found: Singles = np.float32(_OLD_OTHERS) ** (1.0 - uneven) * np.float32(_OLD_UNEVEN) ** uneven
    return found


def calm_of(leading: Singles, rank: float) -> Singles:
    """(N,) how far patches do not make skin between leaders livelier, 0 to 1.  leading (N,): how
    far skin has leaders, in any direction."""
    found: Singles = np.minimum(np.float32(min(rank, 1.0)) * leading, np.float32(1.0))
    return found


def _beside_none(none: float, values: NDArray[np.floating]) -> Singles:
    """(K,) values of the edges of leaders (K - 1,), after that of all others."""
    return np.append(none, values).astype(np.float32)


def _nearness(net: CandidateGraph, leaders: LeaderPores, reach: float) -> Singles:
    """(N,) from 1 on a leader of depth 1 to 0 at `reach`, less beside shallower ones."""
    found = np.zeros(len(net.pores), np.float32)
    if not len(leaders):
        return found
    centres = leaders.points.position
    tree, around = scipy.spatial.cKDTree(centres), Around(centres, reach)

    def find(rows: slice) -> None:
        places = net.pores.position[rows]
        some = around.near(places)
        distance, nearest = tree.query(places[some], distance_upper_bound=reach)
        near = np.isfinite(distance)
        share = 1.0 - (distance[near] / reach) ** 2
        found[rows.start + some[near]] = share**2 * np.sqrt(leaders.depth[nearest[near]])

    over_rows(len(found), find)
    return found
