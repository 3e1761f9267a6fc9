"""Wrinkles that run to and fro across their segments: the wave, and its size on a mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference.inputs import Array, Graph, Indices

GOLDEN = (1 + 5**0.5) / 2
LARGEST = 0.2


class Waves(NamedTuple):
    """One value a wrinkle, (M,).  amplitude: in UV, to the left of the segment where positive.
    count: waves along the whole wrinkle.  phase: in waves.  share: of the whole wrinkle that the
    segment is, its last part going back where negative."""

    amplitude: Array
    count: Array
    phase: Array
    share: Array

    def of(self, i: int) -> Waves:
        """That of one wrinkle."""
        return Waves(*(values[i] for values in self))


def arcs(p: ArrayLike) -> Array:
    """Period 1: the parabola through 0, 1 and 0 over the first half, its mirror over the second."""
    p = np.mod(np.asarray(p, np.float64), 1.0)
    half = np.mod(p, 0.5)
    return np.where(p < 0.5, 1.0, -1.0) * 16 * half * (0.5 - half)


def wave(x: ArrayLike, count: float, phase: float, level: bool = False) -> Array:
    """How far aside, -1 to 1, at x from 0 to 1 along it.  level: at both ends, as on arcs."""
    x = np.asarray(x, np.float64)
    sum = 0.65 * arcs(count * x + phase) + 0.35 * arcs(GOLDEN * count * x + 5 * phase)
    rise = np.minimum(4 * max(count, 1.0) * x * (1 - x), 1.0)
    return sum * (rise * (2 - rise)) ** (2 if level else 1)


def phases(rows: ArrayLike) -> Array:
    """(M,) in [0, 1), from the row of each wrinkle: the finaliser of MurmurHash3, 24 bits of it."""
    return np.array([_mixed(int(row)) for row in np.asarray(rows)])


def _mixed(row: int) -> float:
    h = row * 0x9E3779B1 % 2**32
    h = (h ^ h >> 16) * 0x85EBCA6B % 2**32
    h = (h ^ h >> 13) * 0xC2B2AE35 % 2**32
    return ((h ^ h >> 16) >> 8) / 2**24


def on_mesh(
    graph: Graph, corners: Array, uv: Array, triangle: Indices, amplitude: float, frequency: float
) -> Waves:
    """Of wrinkles none of which crosses a seam. corners (F, 3, 3) and uv (F, 3, 2) of a mesh;
    triangle (M,): on which each wrinkle lies, -1 for none."""
    ends = np.asarray(graph.node_uv, np.float64)[np.asarray(graph.edge_nodes)]
    found = np.zeros((2, len(ends)))
    for i, t in enumerate(triangle):
        if t < 0:
            continue
        j = (corners[t, 1:] - corners[t, 0]).T @ np.linalg.inv((uv[t, 1:] - uv[t, 0]).T)
        step = ends[i, 1] - ends[i, 0]
        length = np.linalg.norm(j @ step)
        # A shift d across the segment sweeps |step| d in UV, and length · amplitude on the surface.
        area = np.sqrt(np.linalg.det(j.T @ j))
        shift = min(amplitude, LARGEST * length) * length / area / np.linalg.norm(step)
        found[:, i] = min(shift, LARGEST * np.linalg.norm(step)), frequency * length
    return Waves(*found, phases(range(len(ends))), np.ones(len(ends)))
