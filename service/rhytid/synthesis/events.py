"""Single features of the skin, placed on a surface: bumps, papules, scars, milia, moles, pores.

Darts are thrown into every triangle, numbered, by a word of the places of its corners: what is
below it in the UV map, and its number, make no difference. A dart counts where its level is below
the events to an area there, so that more events leave those where they are that there were. Larger
kinds come first, and keep others at a distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.events import EVENT_DEPTHS, EVENTS, FADING, KINDS
from rhytid.domain.graph import ORIGINAL
from rhytid.domain.lengths import DEPTH_OF_SPACING
from rhytid.domain.skin import depth_factor
from rhytid.support import cancellation
from rhytid.synthesis.fields import Fields, SmoothNoise, level_directions
from rhytid.synthesis.hashes import Words, random4, unit_interval
from rhytid.synthesis.lattice import Around
from rhytid.synthesis.leaders import unit_length
from rhytid.synthesis.progress import over_rows, row_blocks
from rhytid.synthesis.seams.copies import Arrays
from rhytid.synthesis.shapes import pore_ellipses
from rhytid.synthesis.surface import (
    UDIM_COLUMNS,
    BoolArray,
    FloatArray,
    IntArray,
    Points,
    Surface,
    cross,
    unit,
)

# Side of the cells in which corners of triangles are counted, millimetres; where in its cell the
# origin lies, so that corners of meshes made by rule lie at no border.
_CELL, _BETWEEN = 0.1, 0.381966
_LEAST_WEIGHT = 1e-6
# What lies farther from an event than this many times its reach is no skin around it.
_AROUND = 2.0
# Two events are at least so many times the sum of their radii apart.
_APART = 0.8
# Which kinds are placed first.
_FIRST = ("mole", "scar", "papule", "milium", "bump", "wide_pore")
# Of kinds that come in groups: how far their numbers to an area differ, a deviation of their
# logarithm; and the most of the factor.
_GROUPED, _DENSEST = 1.4, 6.0
# The share of these that stands alone.
_STRAY = 0.25
# So that random numbers for one purpose are others than for another.
_THROWN, _SIZED, _NOISE = 11, 31, 51
Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Darts:
    """N darts of one kind.  points: where.  key (N,): a random word of each.  level (N,): in darts
    per cm²."""

    points: Points
    key: Words
    level: FloatArray

    def take(self, index: NDArray[np.bool_]) -> Darts:
        """The darts of a mask."""
        return Darts(self.points.take(index), self.key[index], self.level[index])


@dataclass(frozen=True, eq=False)
class Events:
    """E events on a surface, in an order that follows from their places.

    kind (E,): as `node_kind`.  weight (E,): strengths.  radius (E,): of circles as large, in units
    of the surface.  metric (E, 3), circle (E,): UV metrics and radii.
    """

    points: Points
    kind: NDArray[np.int32]
    weight: Singles
    radius: FloatArray
    metric: Singles
    circle: Singles

    def __len__(self) -> int:
        return len(self.kind)

    def take(self, index: BoolArray) -> Events:
        """The events of a mask."""
        return Events(
            self.points.take(index), self.kind[index], self.weight[index], self.radius[index],
            self.metric[index], self.circle[index],
        )  # fmt: skip

    def added_to(self, arrays: Arrays) -> Arrays:
        """The arrays of a graph with the events after its nodes; none of these is a copy yet, but
        for ends of wrinkles. They are replaced in their dictionary one by one."""
        own = {
            "node_uv": self.points.uv.astype(np.float32),
            "node_weight": self.weight,
            "node_radius": self.circle,
            "node_metric": self.metric,
            "node_triangle": self.points.triangle.astype(np.int32),
            "node_copy_of": np.full(len(self), ORIGINAL, np.int32),
            "node_kind": self.kind,
        }
        arrays["node_kind"] = np.zeros(len(arrays["node_uv"]), np.int32)
        for name, more in own.items():
            kind = arrays[name].dtype
            arrays[name] = np.concatenate([arrays[name], more.astype(kind, copy=False)])
        return arrays

    def fading(
        self, surface: Surface, triangle: NDArray[np.integer], uv: NDArray[np.floating]
    ) -> Singles:
        """(N,) factors of the weights of what lies at uv (N, 2): below 1 over events whose kind
        lines fade over."""
        most = FADING[self.kind]
        over = np.flatnonzero(most > 0)
        factor = np.ones(len(triangle), np.float32)
        if not len(over):
            return factor
        centre, radius = self.points.position[over], self.radius[over]
        reach = float(radius.max())
        tree, around = scipy.spatial.cKDTree(centre), Around(centre, reach)

        def fade(rows: slice) -> None:
            places = surface.place(triangle[rows], uv[rows].astype(np.float64))
            some = around.near(places)
            distance, near = tree.query(places[some], k=1, distance_upper_bound=reach)
            found = np.isfinite(distance)
            event, there = near[found], some[found]
            inside = np.maximum(1.0 - (distance[found] / radius[event]) ** 4, 0.0)
            factor[rows.start + there] = 1.0 - most[over][event] * inside

        over_rows(len(triangle), fade)
        return factor


def events_of(
    surface: Surface,
    fields: Fields,
    settings: GraphSettings,
    spacing: float,
    unit: str | None = None,
) -> Events | None:
    """The events of a surface; None where there are none.

    spacing: of pores on even skin, in units of the surface.  unit: of the mesh, for sizes in
    millimetres; where it has no known length they count from the spacing, which is that of SKIN
    where density is 1.
    """
    if settings.events == 0.0:
        return None
    even = spacing * settings.density**0.5
    millimetre = unit_length(unit, even * surface.scale) / surface.scale
    throw = _Throw(surface, fields, settings, millimetre)
    found = [throw.darts(kind) for kind in range(1, len(KINDS) + 1)]
    kind = np.repeat(np.arange(1, len(found) + 1), [len(d.key) for d in found]).astype(np.int32)
    if not len(kind):
        return None
    depth = DEPTH_OF_SPACING * (spacing / millimetre) * depth_factor(settings.age)
    return throw.shaped(_joined(found), kind, depth)


class _Throw:
    """Throws darts onto a surface, and makes events of them.  millimetre: in units of the
    surface."""

    def __init__(
        self, surface: Surface, fields: Fields, settings: GraphSettings, millimetre: float
    ) -> None:
        self._surface, self._fields, self._settings = surface, fields, settings
        self._millimetre = millimetre
        self._keys, self._corners = _placed_corners(surface, millimetre)

    def darts(self, kind: int) -> Darts:
        """The darts of a kind that count."""
        cancellation.check()
        event, settings, fields = KINDS[kind - 1], self._settings, self._fields
        rates = {r: settings.events * v for r, v in event.rates_at(settings.age).items()}
        most = max(rates.values()) * fields.most_events * (_DENSEST if event.groups else 1.0)
        darts = self._below(most, kind)
        at = darts.points
        rate = fields.of_regions(rates, at.triangle, at.uv).astype(np.float64)
        rate *= fields.events(at.triangle, at.uv)
        rate *= ~fields.bare(at.triangle, at.uv)
        if event.groups:
            rng = np.random.default_rng([settings.start, _NOISE, kind])
            rate *= _grouped(SmoothNoise(event.groups, rng).at(at.position / self._millimetre))
        return darts.take(darts.level < rate)

    def _below(self, most: float, kind: int) -> Darts:
        """The darts of a kind below the level `most`."""
        surface = self._surface
        used = np.flatnonzero(surface.carries & (surface.area > 0))
        area = surface.area[used] / (10.0 * self._millimetre) ** 2
        count = np.floor(area * most).astype(np.int64) + 1
        triangle, area = np.repeat(used, count), np.repeat(area, count)
        number = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        words = random4(self._keys[triangle], number, _THROWN + kind, self._settings.start)
        one, two, three, key = words
        level = (number + unit_interval(one).astype(np.float64)) / area
        low = np.flatnonzero(level < most)
        at = triangle[low]
        points = _points(surface, at, self._corners[at], two[low], three[low])
        inside = (points.uv >= 0).all(axis=1) & (points.uv[:, 0] < UDIM_COLUMNS)
        return Darts(points, key[low], level[low]).take(inside)

    def shaped(self, darts: Darts, kind: NDArray[np.int32], depth: float) -> Events:
        """The events of darts, those that are too close to others left out.

        kind: of each.  depth: of a wrinkle of strength 1, millimetres.
        """
        surface, fields = self._surface, self._fields
        words = random4(darts.key, _SIZED, self._settings.start, kind)
        sizes = np.stack([unit_interval(w) for w in words], axis=-1).astype(np.float64)
        radius = self._millimetre * _between(kind, "radius", sizes[:, 0])
        kept = _kept(darts, kind, radius)
        # Of those that are left by place: nothing else about them is without an order.
        kept = kept[np.lexsort(darts.points.position[kept].T)]
        points, kind, sizes, radius = darts.points.take(kept), kind[kept], sizes[kept], radius[kept]
        height = radius / self._millimetre * _between(kind, "steepness", sizes[:, 1])
        weight = height / (EVENT_DEPTHS * depth) * fields.event_strength(points.triangle, points.uv)
        patched = _of_kinds(kind, [e.patched for e in KINDS])
        weight *= fields.event_patches(points.triangle, points.uv) ** patched
        weight = np.clip(weight, _LEAST_WEIGHT, 1.0)
        longer = 1.0 + (_of_kinds(kind, [e.longer for e in KINDS]) - 1.0) * sizes[:, 2] ** 2
        angle = _angles(surface, points, np.pi * sizes[:, 3])
        metric, circle = pore_ellipses(surface, points.triangle, radius, angle, longer)
        found = Events(points, kind, weight.astype(np.float32), radius, metric, circle)
        return found.take(_over_own_skin(surface, found, radius * np.sqrt(longer)))


def _placed_corners(surface: Surface, millimetre: float) -> tuple[Words, IntArray]:
    """(F,) a word of each triangle, from the places of its corners, and (F, 3) its corners in the
    order of these places: whichever comes first in the mesh.

    Places are counted in cells, so that the mesh in another unit, whose positions are rounded
    otherwise, has the same words but for very few triangles.
    """
    places = surface.corners
    cells = np.floor(places / (_CELL * millimetre) + _BETWEEN).astype(np.int64)
    keys = np.concatenate([cells, places], axis=-1)[..., [5, 4, 3, 2, 1, 0]]
    order = np.lexsort(keys.transpose(2, 0, 1), axis=-1)
    words = np.take_along_axis(cells, order[..., None], axis=1).reshape(-1, 9).astype(np.uint32)
    state = random4(*words[:, :4].T)
    state = random4(*(s ^ w for s, w in zip(state, words[:, 4:8].T, strict=True)))
    return random4(state[0], words[:, 8], 0, 0)[0], order


def _grouped(noise: Singles) -> Singles:
    """Factors of the number of events in groups, their mean 1 but for the limit."""
    deviation = np.float32(_GROUPED)
    factor: Singles = np.exp(deviation * noise - np.float32(0.5) * deviation**2)
    stray = np.float32(_STRAY)
    found: Singles = stray + (np.float32(1.0) - stray) * np.minimum(factor, np.float32(_DENSEST))
    return found


def _points(
    surface: Surface, triangle: IntArray, corners: IntArray, one: Words, two: Words
) -> Points:
    """Points even over triangles (N,), from two words each.  corners (N, 3): in their order."""
    a, b = (unit_interval(word).astype(np.float64) for word in (one, two))
    beyond = a + b > 1.0
    a, b = np.where(beyond, 1.0 - a, a), np.where(beyond, 1.0 - b, b)
    shares = np.stack([1.0 - a - b, a, b], axis=-1)

    def mixed(values: FloatArray) -> FloatArray:
        at = values[triangle[:, None], corners]
        # One by one: a product of matrices may round a row by where in the array it is.
        found: FloatArray = at[:, 0] * shares[:, :1] + at[:, 1] * shares[:, 1:2]
        return found + at[:, 2] * shares[:, 2:]

    uv, position = mixed(surface.uv).astype(np.float32), mixed(surface.corners)
    return Points(triangle, uv, position, unit(mixed(surface.normals)))


def _joined(darts: list[Darts]) -> Darts:
    points = [d.points for d in darts]
    names = ("triangle", "uv", "position", "normal")
    whole = Points(*(np.concatenate([getattr(p, n) for p in points]) for n in names))
    key, level = (np.concatenate([getattr(d, n) for d in darts]) for n in ("key", "level"))
    return Darts(whole, key, level)


def _kept(darts: Darts, kind: NDArray[np.int32], radius: FloatArray) -> IntArray:
    """Darts that no earlier one is too close to: kinds in the order of _FIRST, and then by their
    words."""
    turn = [_FIRST.index(name) for name in EVENTS]
    order = np.lexsort((darts.key, _of_kinds(kind, turn)))
    pairs = scipy.spatial.cKDTree(darts.points.position).query_pairs(
        2.0 * _APART * float(radius.max()), output_type="ndarray"
    )
    one, two = pairs.T
    apart = np.linalg.norm(darts.points.position[one] - darts.points.position[two], axis=-1)
    facing = (darts.points.normal[one] * darts.points.normal[two]).sum(-1) > 0
    close = (apart < _APART * (radius[one] + radius[two])) & facing
    others: dict[int, list[int]] = {}
    for a, b in pairs[close].tolist():
        others.setdefault(a, []).append(b)
        others.setdefault(b, []).append(a)
    kept = np.zeros(len(kind), np.bool_)
    for dart in order.tolist():
        kept[dart] = not any(kept[other] for other in others.get(dart, ()))
    return np.flatnonzero(kept)


def _over_own_skin(surface: Surface, events: Events, reach: FloatArray) -> BoolArray:
    """(E,) whether all that lies below an event in the UV map is skin around it. At the border of
    a chart it is drawn on, over the gutter, and would cover what other skin lies there.

    reach (E,): half of its length on the surface.
    """
    corners, found = surface.corners, np.ones(len(events), np.bool_)
    middle = corners.mean(axis=1)
    extent = np.linalg.norm(corners - middle[:, None], axis=-1).max(axis=1)
    for rows in row_blocks(len(events)):
        within = _within_rims(events.metric[rows]) + events.points.uv[rows, None]
        event, triangle = _near_in_map(surface.uv, events.points.uv[rows], within)
        apart = np.linalg.norm(events.points.position[rows][event] - middle[triangle], axis=-1)
        far = np.flatnonzero(apart > _AROUND * reach[rows][event] + extent[triangle])
        event, triangle = event[far], triangle[far]
        at = within[event].reshape(-1, 2)
        shares = surface.barycentric(np.repeat(triangle, within.shape[1]), at)
        covers = (shares > 0.0).all(axis=-1).reshape(-1, within.shape[1]).any(axis=1)
        found[rows.start + event[covers]] = False
    return found


def _within_rims(metric: Singles) -> FloatArray:
    """(E, R, 2) UV steps from the centres of ellipses to places within and on their rims."""
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    uu, uv, vv = metric.astype(np.float64).T[..., None]
    size = np.sqrt(uu * way[:, 0] ** 2 + 2.0 * uv * way[:, 0] * way[:, 1] + vv * way[:, 1] ** 2)
    rim = way / size[..., None]
    return np.concatenate([rim, 0.5 * rim], axis=1)


def _near_in_map(
    corners: FloatArray, centre: Singles, within: FloatArray
) -> tuple[IntArray, IntArray]:
    """Pairs of events and triangles that may share places in the UV map.

    corners (F, 3, 2).  centre (E, 2), within (E, R, 2): places of the events.
    """
    middle = corners.mean(axis=1)
    extent = np.linalg.norm(corners - middle[:, None], axis=-1).max(axis=1)
    size = np.frexp(extent)[1]  # triangles that are about as large have a tree of their own
    reach = np.linalg.norm(within - centre[:, None], axis=-1).max(axis=1)
    events, triangles = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    sides = corners[:, 1:] - corners[:, :1]
    flat = cross(sides[:, 0], sides[:, 1]) == 0.0
    for one in np.unique(size[~flat]):
        rows = np.flatnonzero((size == one) & ~flat)
        near = scipy.spatial.cKDTree(middle[rows]).query_ball_point(
            centre, reach + extent[rows].max()
        )
        events.append(np.repeat(np.arange(len(near)), [len(found) for found in near]))
        triangles.append(rows[np.fromiter(chain.from_iterable(near), np.int64)])
    return np.concatenate(events), np.concatenate(triangles)


def _angles(surface: Surface, points: Points, turn: FloatArray) -> FloatArray:
    """(E,) angles as `pore_axes` has them, of axes that lie `turn` (E,) to the left of the level
    direction on the surface."""
    level = level_directions(points.normal.astype(np.float64))
    beside = np.cross(points.normal, level)
    axis = np.cos(turn)[:, None] * level + np.sin(turn)[:, None] * beside
    along, other = surface.jacobian[points.triangle].transpose(2, 0, 1)
    along = unit(along)
    across = unit(other - along * (other * along).sum(-1)[:, None])
    angle: FloatArray = np.arctan2((axis * across).sum(-1), (axis * along).sum(-1))
    return angle


def _between(kind: NDArray[np.int32], name: str, share: FloatArray) -> FloatArray:
    """(E,) sizes between the least and the most of each kind, small ones more often than large
    ones."""
    ends = np.sort(np.abs([getattr(event, name) for event in KINDS]), axis=1)[kind - 1]
    found: FloatArray = ends[:, 0] * (ends[:, 1] / ends[:, 0]) ** share
    return found


def _of_kinds(kind: NDArray[np.int32], values: list[float] | list[int]) -> FloatArray:
    found: FloatArray = np.array(values, np.float64)[kind - 1]
    return found
