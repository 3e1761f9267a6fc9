"""Copies at UV seams: they are drawn in the UV of another chart than that of what they copy, and
answer to stretch as that does. Kernels: copies.cl, listed.clh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer, Device
from rhytid.domain.graph import ORIGINAL, WrinkleGraph

Rows = NDArray[np.int64]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Origins:
    """What the last C elements of a UDIM answer to stretch with, as if they were where their
    originals are: places (C, 4) segments or (C, 2) centres in texels, triangle (C,), stiffness (C,)
    or None."""

    places: Floats
    triangle: NDArray[np.int32]
    stiffness: Floats | None

    @classmethod
    def of(
        cls,
        rows: Rows,
        copy_of: NDArray[np.int32] | None,
        places: Callable[[Rows], Floats],
        triangle: NDArray[np.int32],
        stiffness: Floats | None,
    ) -> Origins | None:
        """Of elements (C,) of a graph; None where there are none."""
        if not len(rows):
            return None
        first = rows
        if copy_of is not None:
            first = np.where(copy_of[rows] == ORIGINAL, rows, copy_of[rows])
        return cls(places(first), triangle[first], None if stiffness is None else stiffness[first])


@dataclass(frozen=True)
class OriginBuffers:
    """Origins on the device. first: the element that the first of them belongs to.  scales: room
    for (sigma_w, sigma_d) of each."""

    count: int
    first: int
    places: Buffer
    triangle: Buffer
    stiffness: Buffer | None
    scales: Buffer

    @classmethod
    def upload(cls, device: Device, origins: Origins | None, elements: int) -> OriginBuffers | None:
        """Those of the last of so many elements."""
        if origins is None:
            return None
        count, stiffness = len(origins.triangle), origins.stiffness
        return cls(
            count,
            elements - count,
            device.upload(origins.places),
            device.upload(origins.triangle),
            None if stiffness is None else device.upload(stiffness),
            device.empty(2 * count, np.float32),
        )

    def give(self, device: Device, scales: Buffer) -> None:
        """Put the scales of the originals in the place of those of the copies."""
        device.launch(
            "copies", "take_scales", (self.count,), self.scales, np.int32(self.first), scales
        )

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self.places, self.triangle, self.stiffness, self.scales):
            if buffer is not None:
                buffer.release()


def copied(copy_of: NDArray[np.int32] | None, metric: Floats | None) -> NDArray[np.bool_] | None:
    """(M,) what is a copy or has a metric; None where nothing is or has."""
    marks = []
    if copy_of is not None:
        marks.append(copy_of != ORIGINAL)
    if metric is not None:
        marks.append(metric.any(axis=1))
    return np.logical_or.reduce(marks) if marks else None


def copies_last(chosen: Rows, last: NDArray[np.bool_] | None) -> tuple[Rows, int]:
    """The rows in their order, those marked after the others, and how many these are."""
    if last is None:
        return chosen, len(chosen)
    mark = last[chosen]
    return chosen[np.argsort(mark, kind="stable")], int(np.count_nonzero(~mark))


def metric_roots(metric: Floats) -> NDArray[np.float64]:
    """(N, 3) Cholesky factors (xx, xy, yy) of metrics (N, 3): rootᵀ·root = metric."""
    uu, uv, vv = metric.astype(np.float64).T
    xx = np.sqrt(uu)
    # Products of two float32 are exact in double, so the determinant is rounded only once.
    return np.stack([xx, uv / xx, np.sqrt((uu * vv - uv * uv) / uu)], axis=1)


def rim_reach(root: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 2) how far the rims of roots (N, 3) go along u and v."""
    along = np.stack([np.hypot(root[:, 1], root[:, 2]) / root[:, 0], np.ones(len(root))], axis=1)
    reach: NDArray[np.float64] = along / root[:, 2:]
    return reach


def skewed_roots(graph: WrinkleGraph, rows: Rows, resolution: int) -> Floats:
    """(S, 4) float32 (xx, xy, yy, 0), texels⁻¹, of wrinkles (S,); round where one has no metric."""
    across = 1.0 / graph.edge_half_width[rows].astype(np.float64)
    root = np.stack([across, np.zeros_like(across), across, np.zeros_like(across)], axis=1)
    if graph.edge_metric is not None:
        metric = graph.edge_metric[rows]
        given = np.flatnonzero(metric.any(axis=1))
        root[given, :3] = metric_roots(metric[given])
    return (root / resolution).astype(np.float32)
