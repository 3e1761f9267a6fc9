"""Places on UV seams as both charts have them, to compare what is drawn there.

Found from the mesh alone, apart from the product.
"""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

Floats = NDArray[np.float64]


class SeamPlaces(NamedTuple):
    """here, there (P, 2): uv of the same places in both charts.  bend (P,): the angle between the
    sides of the seam that meet at the nearer end, on one chart against the other, radians.
    along (P,): what length of the surface each stands for.  corner (P,): how far on the surface
    each is from an end of the seam or from where its two charts bend by different angles.
    position (P, 3): on the surface.  triangles (P, 2): that of either side."""

    here: Floats
    there: Floats
    weight: Floats
    corner: Floats
    position: Floats
    triangles: NDArray[np.int64]


def seam_places(mesh: Mesh, usable: NDArray[np.bool_], apart: float, angle: float) -> SeamPlaces:
    """Places about `apart` from each other, mesh units, on sides of which both triangles are
    usable; angle: by how much charts bend differently at a corner, radians."""
    seams = _seams(mesh, usable)
    corners = _corners(seams, angle)
    found = []
    for (a, b), (p, q), (r, s), both in seams:
        length = float(np.linalg.norm(np.subtract(b, a)))
        count = max(int(np.ceil(length / apart)), 1)
        for k in range(count):
            x = (k + 0.5) / count
            place = (1 - x) * np.array(a) + x * np.array(b)
            away = np.linalg.norm(corners - place, axis=1).min(initial=np.inf)
            here, there = ((1 - x) * np.array(m) + x * np.array(n) for m, n in ((p, q), (r, s)))
            found.append((here, there, length / count, away, place, both))
    return SeamPlaces(*(np.array(values) for values in zip(*found, strict=True)))


def _seams(mesh: Mesh, usable: NDArray[np.bool_]) -> list:
    """Ends in space and in either chart, and the triangles, of each pair of sides."""
    sides = defaultdict(list)
    uv = mesh.triangle_uv()
    for t in np.flatnonzero(usable):
        places = [tuple(map(float, p)) for p in mesh.positions[mesh.faces[t]] + np.float32(0)]
        for i in range(3):
            j = (i + 1) % 3
            sides[frozenset((places[i], places[j]))].append(
                ((places[i], places[j]), tuple(uv[t, i]), tuple(uv[t, j]), t)
            )
    found = []
    for pair in sides.values():
        if len(pair) != 2:
            continue
        (ends, p, q, one), (other, s, r, two) = pair
        if ends == other[::-1] and (p, q) != (r, s):
            found.append((ends, (p, q), (r, s), (one, two)))
    return found


def _corners(seams: list, angle: float) -> Floats:
    """(C, 3) ends of seams, and places where the two charts bend by angles that differ."""
    at = defaultdict(list)
    for (a, b), (p, q), (r, s), _ in seams:
        # Of either end: where it is in both charts, and the ways from there.
        at[a].append((p, r, np.subtract(q, p), np.subtract(s, r)))
        at[b].append((q, s, np.subtract(p, q), np.subtract(r, s)))
    corners = []
    for place, meeting in at.items():
        if len(meeting) != 2:
            corners.append(place)
            continue
        one, two = meeting
        same = one[0] == two[0] and one[1] == two[1]
        swapped = one[0] == two[1] and one[1] == two[0]
        if not (same or swapped):
            corners.append(place)
            continue
        ways = (two[2], two[3]) if same else (two[3], two[2])
        bends = [_angle(one[2 + k], ways[k]) for k in range(2)]
        if abs(bends[0] - bends[1]) > angle:
            corners.append(place)
    return np.array(corners).reshape(-1, 3)


def _angle(a: Floats, b: Floats) -> float:
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.arccos(np.clip(cosine, -1, 1)))
