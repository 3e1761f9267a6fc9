"""Which triangles meet in UV: the charts that a straight line in the map may cross, and wrinkles
across a UV seam, from each of their pores up to the border of its chart."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.support import cancellation
from rhytid.synthesis.surface import BoolArray, FloatArray, IntArray, Points, Surface, cross

BORDER = -1
# Triangles that one line may cross; a line still under way then ends there.
LONGEST = 4096
# The corners at both ends of each side.
SIDES = np.array([[0, 1], [1, 2], [2, 0]])
Triangles = NDArray[np.int32]
# The two halves of a wrinkle meet within this share of its length.
GAP = 0.25


@dataclass(frozen=True, eq=False)
class Traces:
    """The ends of straight UV segments that start inside a triangle and stay on connected ones.

    end (N,): the triangle of the last point.  middle (N,): the triangle of the midpoint, BORDER
    where the line ends before it.  share (N,): how much of the line lies on the chart, 1 = all.
    length (N,): its length on the surface, of the part on the chart.
    """

    end: IntArray
    middle: IntArray
    share: FloatArray
    length: FloatArray


# Of meshes that are in use: the size of a build is found before it, by the same neighbours.
_found: WeakKeyDictionary[Mesh, NDArray[np.int32]] = WeakKeyDictionary()


def neighbours(mesh: Mesh) -> NDArray[np.int32]:
    """(F, 3) the triangle across the side from corner i to i + 1, or BORDER; read-only.

    Two triangles meet where a side has the same two vertices and the same UV at both, however
    often the file repeats that UV; not across a fold of the map, nor where three meet. They are
    found once for a mesh.
    """
    across = _found.get(mesh)
    if across is None:
        across = _across(mesh)
        across.flags.writeable = False
        _found[mesh] = across
    return across


def _across(mesh: Mesh) -> NDArray[np.int32]:
    keys = corner_numbers(mesh)[:, SIDES]
    keys = np.sort(keys, axis=-1).reshape(-1, 2)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    ordered = keys[order]
    same = (ordered[1:] == ordered[:-1]).all(axis=-1)
    # A side belongs to exactly two triangles where it equals the next one but no third.
    before, after = np.append(False, same[:-1]), np.append(same[1:], False)
    pair = np.flatnonzero(same & ~before & ~after)
    one, two = order[pair], order[pair + 1]
    turn = orientation(mesh.triangle_uv())
    flat = (turn[one // 3] == turn[two // 3]) & (turn[one // 3] != 0)
    across = np.full(3 * len(mesh.faces), BORDER, np.int32)
    across[one[flat]] = two[flat] // 3
    across[two[flat]] = one[flat] // 3
    return across.reshape(-1, 3)


def trace(
    surface: Surface,
    across: NDArray[np.int32],
    start: NDArray[np.integer],
    origin: FloatArray,
    step: FloatArray,
) -> Traces:
    """Follow UV segments from `origin` (N, 2), inside triangles `start` (N,), by `step` (N, 2).

    across: (F, 3) neighbours of the triangles.
    """
    end, middle = start.astype(np.int64), np.full(len(start), BORDER, np.int64)
    share, length = np.zeros(len(start)), np.zeros(len(start))
    came_from = np.full(len(start), BORDER, np.int64)
    active = np.arange(len(start))
    for _ in range(LONGEST):
        cancellation.check()
        triangle, entered = end[active], share[active]
        following, leaves = _exit(
            surface.uv[triangle], origin[active], step[active], across[triangle], came_from[active]
        )
        leaves = np.clip(leaves, entered, 1.0)
        vector = surface.along(triangle, step[active])
        length[active] += (leaves - entered) * np.linalg.norm(vector, axis=-1)
        half = (entered <= 0.5) & (leaves >= 0.5)
        middle[active[half]] = triangle[half]
        share[active] = leaves
        came_from[active] = triangle
        goes_on = (leaves < 1.0) & (following != BORDER)
        active = active[goes_on]
        end[active] = following[goes_on]
        if not len(active):
            break
    return Traces(end, middle, share, length)


def _exit(
    corners: FloatArray,
    origin: FloatArray,
    step: FloatArray,
    across: NDArray[np.int32],
    came_from: IntArray,
) -> tuple[IntArray, FloatArray]:
    """The triangle (N,) that each line enters next, and where along the line."""
    sides = np.roll(corners, -1, axis=1) - corners
    turn = np.sign(cross(sides[:, 0], sides[:, 1]))[:, None]
    outward = turn * cross(step[:, None], sides)
    distance = turn * cross(corners - origin[:, None], sides)
    leaving = (outward > 0) & ((across != came_from[:, None]) | (across == BORDER))
    where = np.full(outward.shape, np.inf)
    np.divide(distance, outward, out=where, where=leaving)
    side = np.argmin(where, axis=1)[:, None]
    nearest = np.take_along_axis(where, side, axis=1)[:, 0]
    following = np.take_along_axis(across, side, axis=1)[:, 0]
    # A line that no side lets out slipped through a corner by rounding: it ends there.
    lost = ~np.isfinite(nearest)
    return np.where(lost, BORDER, following).astype(np.int64), np.where(lost, 0.0, nearest)


def side_at(corners: FloatArray, uv: FloatArray) -> IntArray:
    """(S,) the side of each triangle (S, 3, 2) that goes through a point (S, 2) on its rim."""
    start, stop = corners[:, SIDES[:, 0]], corners[:, SIDES[:, 1]]
    along = stop - start
    off = np.abs(cross(along, uv[:, None] - start)) / np.linalg.norm(along, axis=-1)
    side: IntArray = np.argmin(off, axis=1)
    return side


def corner_numbers(mesh: Mesh) -> IntArray:
    """(F, 3) one number for each pair of a vertex and a place in UV."""
    # Adding zero turns -0.0 into 0.0.
    u, v = (mesh.uv[mesh.face_uv.ravel()] + 0.0).T
    vertex = mesh.faces.ravel()
    order = np.lexsort((v, u, vertex))
    differs = np.zeros(len(order), bool)
    for key in (vertex, u, v):
        ordered = key[order]
        differs[1:] |= ordered[1:] != ordered[:-1]
    welded = np.empty((len(mesh.faces), 3), np.int64)
    welded.reshape(-1)[order] = np.cumsum(differs)
    return welded


def orientation(uv: FloatArray) -> NDArray[np.float64]:
    """(F,) 1 where the UV of a triangle turn left, -1 where right, 0 without area."""
    turn: NDArray[np.float64] = np.sign(cross(uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]))
    return turn


@dataclass(frozen=True, eq=False)
class Halves:
    """The part of each wrinkle on its first pore's side of a seam.

    step (N, 2): UV vector to where the second pore would be if the chart went on.
    share (N,): how much of it lies on the chart, 1 where it meets no border.
    exit (N, 3): the place on the surface where it leaves the chart.  exit_uv (N, 2): in UV.
    last (N,): the triangle there.  middle (N,): that of the midpoint, BORDER where the chart ends
    before.
    """

    step: FloatArray
    share: FloatArray
    exit: FloatArray
    exit_uv: FloatArray
    last: IntArray
    middle: IntArray


def halves(
    surface: Surface, across: Triangles, pores: Points, nodes: NDArray[np.integer]
) -> Halves:
    """The way from pores nodes[:, 0] towards nodes[:, 1] in the tangent plane, up to the border."""
    one, two = nodes.T
    triangle, origin = pores.triangle[one], pores.uv[one].astype(np.float64)
    ahead = pores.position[two] - pores.position[one]
    step = np.einsum("ncx,nx->nc", np.linalg.pinv(surface.jacobian[triangle]), ahead)
    line = trace(surface, across, triangle, origin, step)
    end = origin + line.share[:, None] * step
    return Halves(step, line.share, surface.place(line.end, end), end, line.end, line.middle)


def meets_at_seam(
    surface: Surface,
    across: Triangles,
    pores: Points,
    nodes: NDArray[np.integer],
    length: NDArray[np.floating],
) -> BoolArray:
    """(N,) true where both halves leave their charts at the same place of the surface."""
    there = halves(surface, across, pores, nodes)
    back = halves(surface, across, pores, nodes[:, ::-1])
    gap = np.linalg.norm(there.exit - back.exit, axis=-1)
    meets: BoolArray = (there.share < 1.0) & (back.share < 1.0) & (gap <= GAP * length)
    return meets & _long_enough(pores, nodes[:, 0], there) & _long_enough(pores, nodes[:, 1], back)


def _long_enough(pores: Points, owner: NDArray[np.integer], half: Halves) -> BoolArray:
    """(N,) true where float32 tells the border from the pore."""
    origin = pores.uv[owner]
    end = origin + half.share[:, None] * half.step
    distinct: BoolArray = (end.astype(np.float32) != origin).any(axis=1)
    return distinct
