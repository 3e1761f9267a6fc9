"""How the UV of one chart go on in the next, around a stretch of the seam between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.seams.border_places import BorderPlaces
from rhytid.synthesis.seams.borders import Borders
from rhytid.synthesis.seams.supports import Supports
from rhytid.synthesis.seams.twins import Twins
from rhytid.synthesis.surface import FloatArray, IntArray

# How much longer than wide a copy may be on the surface.
LONGER = 3.0
# How much the shape of a seam counts beside how its two triangles lie, across the seam.
_STIFFNESS = 0.02
# The most by which the shape of a seam may change lengths against its two triangles.
_BEND = 2.0


def over_seams(
    borders: Borders,
    places: BorderPlaces,
    supports: Supports,
    drawn: Twins,
    pairs: tuple[IntArray, IntArray, FloatArray],
    counts: float,
) -> Twins:
    """A twin over the nearest stretch of seam of each element.

    pairs: (P,) of `drawn`, (P,) places that they reach and (P,) how far away these are, in sizes.
    counts: a map from chart to chart is fitted to places so much farther than the nearest.
    """
    who, place, near = pairs
    if not len(who):
        return Twins.originals(who)
    run = places.runs(who, place)
    # The nearest place of all of an element tells its run.
    order = np.lexsort((near, drawn.of[who]))
    best = order[np.append(True, np.diff(drawn.of[who][order]) != 0)]
    kept = np.flatnonzero(np.isin(run, run[best]))
    _, group = np.unique(drawn.of[who[kept]], return_inverse=True)
    group = group.ravel()
    source, row = drawn.take(who[best]), places.row[place[best]]
    root = supports.root[source.of] @ np.linalg.inv(source.turn)
    weight = _weights(group, near[kept], len(best), counts)
    laid = _laid(borders, row, root), borders.beyond[row]
    here, there = places.here[place[kept]], places.there[place[kept]]
    nearest = places.here[place[best]], places.there[place[best]]
    turn, shift = _fitted(laid, group, weight, (here, there), nearest)
    return Twins(
        source.of,
        row,
        turn @ source.turn,
        np.einsum("nij,nj->ni", turn, source.shift) + shift,
        near[best],
    )


def _weights(group: IntArray, near: FloatArray, count: int, counts: float) -> FloatArray:
    """(P,) of places in a fit, near ones above all."""
    least = np.full(count, np.inf)
    np.minimum.at(least, group, near)
    beyond = np.minimum((near - least[group]) / counts, 1.0)
    weight: FloatArray = (1.0 - beyond**2) ** 4 + 1e-6
    return weight


def _fitted(
    laid: tuple[FloatArray, FloatArray],
    group: IntArray,
    weight: FloatArray,
    sides: tuple[FloatArray, FloatArray],
    nearest: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """(G, 2, 2), (G, 2): the affine maps that bring the places of each group best to where they
    are across the seam, and else as the two triangles lie.

    laid: (G, 2, 2) of both charts, to one plane.  sides: (P, 2) uv of places here and there.
    nearest: (G, 2) the same of one place of each group.
    """
    (flat, beyond), count = laid, len(laid[0])
    total = np.bincount(group, weight, count)[:, None]
    middle, other = (_sums(group, weight[:, None] * uv, count) / total for uv in sides)
    x = np.einsum("nij,nj->ni", flat[group], sides[0] - middle[group])
    y = np.einsum("nij,nj->ni", beyond[group], sides[1] - other[group])
    xx, yx = (
        _sums(group, weight[:, None, None] * a[:, :, None] * x[:, None], count) for a in (x, y)
    )
    pull = _STIFFNESS * np.trace(xx, axis1=1, axis2=2)[:, None, None] + 1e-30
    bend = (yx + pull * np.eye(2)) @ np.linalg.inv(xx + pull * np.eye(2))
    sizes = np.linalg.svd(bend, compute_uv=False)
    wild = (sizes[:, 0] > _BEND) | (sizes[:, 1] < 1 / _BEND) | (np.linalg.det(bend) <= 0)
    bend[wild] = np.eye(2)
    middle[wild], other[wild] = (uv[wild] for uv in nearest)
    turn = np.linalg.inv(beyond) @ bend @ flat
    return turn, other - np.einsum("nij,nj->ni", turn, middle)


def _laid(borders: Borders, row: IntArray, root: FloatArray) -> FloatArray:
    """(G, 2, 2) from the UV of a chart to the plane of both triangles at a side, as it is around
    the side; or, where charts are so crumpled that an element of root (G, 2, 2) would be longer
    than LONGER there, as the element is round and as large as it is on the seam."""
    sizes = np.linalg.svd(borders.flat[row] @ np.linalg.inv(root), compute_uv=False)
    crumpled = sizes[:, 0] > LONGER * sizes[:, 1]
    along = np.einsum("nij,nj->ni", root, borders.ends[row, 1] - borders.ends[row, 0])
    x, y = along.T
    size = np.hypot(x, y)
    turned = np.stack([x, y, -y, x], axis=-1).reshape(-1, 2, 2) / size[:, None, None] @ root
    sense = np.sign(np.linalg.det(borders.flat[row]) * np.linalg.det(turned))
    turned[:, 1] *= sense[:, None]
    round_: FloatArray = turned * (borders.length[row] / size)[:, None, None]
    return np.where(crumpled[:, None, None], round_, borders.flat[row])


def _sums(group: IntArray, values: NDArray[np.floating], count: int) -> FloatArray:
    """(G, ...) sums of values (P, ...) by group (P,)."""
    flat = values.reshape(len(values), -1)
    columns = [np.bincount(group, column, count).astype(np.float64) for column in flat.T]
    sums: FloatArray = np.stack(columns, axis=-1).reshape(count, *values.shape[1:])
    return sums
