"""The borders of charts: which sides of triangles are one line of the surface, cut open in UV."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.synthesis.seams.charts import BORDER, SIDES, corner_numbers, orientation
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Surface, cross

NONE = -1


@dataclass(frozen=True, eq=False)
class Borders:
    """K sides of triangles at which a chart ends, and the sides that they meet on the surface.

    triangle (K,), side (K,): the triangle, and the corner that the side begins at.  mate (K,): the
    row of the side across the seam; NONE where the surface ends, or one of both triangles carries
    nothing.  ends (K, 2, 2): uv of both ends.  across (K, 2, 2): uv of the same two places on the
    mate.  flat, beyond (K, 2, 2): from UV vectors of this chart, and of the chart of the mate, to
    the plane in which both triangles are laid flat about the side.
    length (K,): on the surface.  following (K,): the side that begins where this one ends, on both
    sides of the seam, or NONE.
    chart (F,): the chart of every triangle.  row (F, 3): the row of each side, or NONE.
    """

    triangle: IntArray
    side: IntArray
    mate: IntArray
    ends: FloatArray
    across: FloatArray
    flat: FloatArray
    beyond: FloatArray
    length: FloatArray
    following: IntArray
    chart: IntArray
    row: IntArray

    @property
    def seams(self) -> IntArray:
        """Rows of the sides that have a mate."""
        return np.flatnonzero(self.mate != NONE)

    @classmethod
    def of(cls, mesh: Mesh, surface: Surface, across: NDArray[np.int32]) -> Borders:
        """Match the sides by the places of their ends; vertices that an exporter has split along
        the seam lie at the same place, bit for bit."""
        triangle, side = np.nonzero(across == BORDER)
        mate = _mates(mesh, surface, triangle, side)
        ends = surface.uv[triangle[:, None], SIDES[side]]
        facing = np.where(mate == NONE, np.arange(len(mate)), mate)
        there = ends[facing, ::-1]
        corners = corner_numbers(mesh)
        frame, met = _frames(surface, corners, triangle, side), mate != NONE
        places = surface.corners[triangle[:, None], SIDES[side]]
        row = np.full((len(mesh.faces), 3), NONE, np.int64)
        row[triangle, side] = np.arange(len(triangle))
        numbers = corners[triangle[:, None], SIDES[side]]
        return cls(
            triangle, side, mate, ends, there,
            # The mate runs the other way round: both axes of its frame point backwards.
            frame, -frame[facing],
            np.linalg.norm(places[:, 1] - places[:, 0], axis=-1),
            _following(numbers, facing, met),
            _charts(across, triangle, mate, ends, there, orientation(surface.uv)),
            row,
        )  # fmt: skip

    def from_mate(self, row: IntArray, uv: FloatArray) -> FloatArray:
        """(N, 2) places in the chart of side `row` (N,), from uv (N, 2) in the chart across it."""
        offset = np.einsum("nij,nj->ni", self.turn_from_mate(row), uv - self.across[row, 0])
        here: FloatArray = self.ends[row, 0] + offset
        return here

    def turn_from_mate(self, row: IntArray) -> FloatArray:
        """(N, 2, 2) from steps in the chart across side `row` (N,) to steps in its own."""
        turn: FloatArray = np.linalg.inv(self.flat[row]) @ self.beyond[row]
        return turn


def _mates(mesh: Mesh, surface: Surface, triangle: IntArray, side: IntArray) -> IntArray:
    """(K,) the row of the side between the same two places, run the other way round, where there
    is exactly one, both triangles carry pores, and the map is not folded there."""
    _, place = np.unique(mesh.positions + np.float32(0), axis=0, return_inverse=True)
    ends = place.ravel()[mesh.faces[triangle[:, None], SIDES[side]]]
    low_high = np.sort(ends, axis=1)
    order = np.lexsort((low_high[:, 1], low_high[:, 0]))
    same = (low_high[order][1:] == low_high[order][:-1]).all(axis=1)
    before, after = np.append(False, same[:-1]), np.append(same[1:], False)
    pair = np.flatnonzero(same & ~before & ~after)
    one, two = order[pair], order[pair + 1]
    opposed = (ends[one] == ends[two][:, ::-1]).all(axis=1) & (ends[one, 0] != ends[one, 1])
    carried = surface.carries[triangle[one]] & surface.carries[triangle[two]]
    uv = surface.uv[triangle[:, None], SIDES[side]]
    turn = orientation(surface.uv)[triangle]
    folded = (uv[one] == uv[two][:, ::-1]).all(axis=(1, 2)) & (turn[one] != turn[two])
    good = opposed & carried & ~folded
    mate = np.full(len(triangle), NONE, np.int64)
    mate[one[good]], mate[two[good]] = two[good], one[good]
    return mate


def _frames(surface: Surface, numbers: IntArray, triangle: IntArray, side: IntArray) -> FloatArray:
    """(K, 2, 2) from UV to a plane: sides are on the x axis and as long as on the surface, and
    their triangles above it. Across the side UV are as long as they are on the surface around it,
    for one triangle may be a sliver.

    numbers (F, 3): of the corners.
    """
    ends = surface.uv[triangle[:, None], SIDES[side]]
    along = ends[:, 1] - ends[:, 0]
    opposite = surface.uv[triangle, (side + 2) % 3] - ends[:, 0]
    form = _forms(surface, numbers, numbers[triangle[:, None], SIDES[side]])
    covector = np.einsum("kij,kj->ki", form, along)
    left = np.stack([-covector[:, 1], covector[:, 0]], axis=-1)
    left *= np.sign(np.einsum("ki,ki->k", left, _normal(along)) * cross(along, opposite))[:, None]
    size = np.sqrt(np.einsum("ki,kij,kj->k", left, form, left))
    places = surface.corners[triangle[:, None], SIDES[side]]
    length = np.linalg.norm(places[:, 1] - places[:, 0], axis=-1)
    basis = np.stack([along, left], axis=-1)
    usable = surface.carries[triangle]
    frames = np.tile(np.eye(2), (len(triangle), 1, 1))
    frames[usable] = np.linalg.inv(basis[usable])
    frames *= np.stack([length, size], axis=-1)[..., None]
    return frames


def _normal(along: FloatArray) -> FloatArray:
    return np.stack([-along[:, 1], along[:, 0]], axis=-1)


def _forms(surface: Surface, numbers: IntArray, ends: IntArray) -> FloatArray:
    """(K, 2, 2) the mean of JᵀJ around corners `ends` (K, 2): of its logarithm, by area."""
    asked, where = np.unique(ends, return_inverse=True)
    near = np.flatnonzero(surface.carries & np.isin(numbers, asked).any(axis=1))
    jacobian = surface.jacobian[near]
    sizes, axes = np.linalg.eigh(jacobian.transpose(0, 2, 1) @ jacobian)
    logs = (axes * np.log(sizes)[:, None]) @ axes.transpose(0, 2, 1)
    sums = np.zeros((len(asked), 5))
    values = np.concatenate([logs.reshape(-1, 4), np.ones((len(near), 1))], axis=1)
    values *= surface.area[near][:, None]
    for corner in range(3):
        at = np.searchsorted(asked, numbers[near, corner])
        hit = asked[np.minimum(at, len(asked) - 1)] == numbers[near, corner]
        np.add.at(sums, at[hit], values[hit])
    total = sums[where.reshape(ends.shape)].sum(axis=1)
    mean = total[:, :4] / np.maximum(total[:, 4:], 1e-300)
    sizes, axes = np.linalg.eigh(mean.reshape(-1, 2, 2))
    forms: FloatArray = (axes * np.exp(sizes)[:, None]) @ axes.transpose(0, 2, 1)
    return forms


def _following(numbers: IntArray, facing: IntArray, met: BoolArray) -> IntArray:
    """(K,) `following` of Borders.  numbers (K, 2): of the corners at both ends, by vertex and
    UV."""
    start = np.stack([numbers[:, 0], numbers[facing, 1]], axis=1)
    stop = np.stack([numbers[:, 1], numbers[facing, 0]], axis=1)
    _, key = np.unique(np.concatenate([start, stop]), axis=0, return_inverse=True)
    starts, stops = key.ravel()[: len(start)], key.ravel()[len(start) :]
    at = np.full(key.max(initial=0) + 1, NONE, np.int64)
    rows = np.flatnonzero(met)
    at[starts[rows]] = rows
    following: IntArray = np.where(met, at[stops], NONE)
    return following


def _charts(
    across: NDArray[np.int32],
    triangle: IntArray,
    mate: IntArray,
    ends: FloatArray,
    beyond: FloatArray,
    turn: FloatArray,
) -> IntArray:
    """(F,) numbers of the charts: triangles are of one where they meet, and where only vertices are
    split but not the UV."""
    one, side = np.nonzero(across != BORDER)
    joined = np.flatnonzero((mate != NONE) & (ends == beyond).all(axis=(1, 2)))
    joined = joined[turn[triangle[joined]] == turn[triangle[mate[joined]]]]
    first = np.concatenate([one, triangle[joined]])
    second = np.concatenate([across[one, side], triangle[mate[joined]]])
    count = len(across)
    links = scipy.sparse.coo_array(
        (np.ones(len(first), np.int8), (first, second)), shape=(count, count)
    )
    _, chart = scipy.sparse.csgraph.connected_components(links, directed=False)
    numbers: IntArray = chart.astype(np.int64)
    return numbers
