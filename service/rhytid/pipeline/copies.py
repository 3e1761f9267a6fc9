"""Copies of wrinkles and pores at UV seams: they are drawn in the UV of another chart than their
originals, and respond to stretch as these do. Kernels: copies.cl, line.clh.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.graph import ORIGINAL, WrinkleGraph

Rows = NDArray[np.int64]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Origins:
    """The places at which C consecutive elements of a UDIM sample stretch: those of their
    originals.

    places: segments (C, 4) or centres (C, 2), texels.  triangle (C,).  stiffness (C,), or None: 1
    throughout.
    """

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
        """The origins of elements `rows` (C,) of a graph; None where there are none.

        copy_of: of every element, as in WrinkleGraph.  places: of elements by their rows.
        """
        if not len(rows):
            return None
        first = rows
        if copy_of is not None:
            first = np.where(copy_of[rows] == ORIGINAL, rows, copy_of[rows])
        return cls(places(first), triangle[first], None if stiffness is None else stiffness[first])


@dataclass(frozen=True)
class OriginBuffers:
    """Origins on the device.

    first: the element that the first origin belongs to.  scales: a buffer for the response of each,
    (sigma_w, sigma_d), or r.
    """

    count: int
    first: int
    places: Buffer
    triangle: Buffer
    stiffness: Buffer | None
    scales: Buffer

    @classmethod
    def upload(cls, device: Device, origins: Origins | None, first: int) -> OriginBuffers | None:
        """The origins of elements `first` and following, uploaded; None for None."""
        if origins is None:
            return None
        count, stiffness = len(origins.triangle), origins.stiffness
        return cls(
            count,
            first,
            device.upload(origins.places),
            device.upload(origins.triangle),
            None if stiffness is None else device.upload(stiffness),
            device.empty(2 * count, np.float32),
        )

    def overwrite(self, device: Device, scales: Buffer, defines: Mapping[str, object]) -> None:
        """Overwrite the response of the copies in `scales` by that of their originals.

        defines: that the kernels which found both were compiled with.
        """
        device.launch(
            "copies", "take_scales", (self.count,), self.scales, np.int32(self.first), scales,
            defines=defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (self.places, self.triangle, self.stiffness, self.scales):
            if buffer is not None:
                buffer.release()


def sampled(
    device: Device, elements: NDArray[np.int32], count: int, triangle: Buffer,
    origins: OriginBuffers | None,
) -> NDArray[np.int32]:  # fmt: skip
    """The triangles that some elements of `count` sample, their own and those of their originals.

    triangle: of each element.  origins: of those that are copies.
    """
    own: NDArray[np.int32] = device.read(triangle, (count,), np.int32)[elements]
    if origins is None:
        return own
    first = device.read(origins.triangle, (origins.count,), np.int32)
    copies = elements - origins.first
    return np.concatenate([own, first[copies[(copies >= 0) & (copies < origins.count)]]])


def copied(copy_of: NDArray[np.int32] | None, metric: Floats | None) -> NDArray[np.bool_] | None:
    """(M,) whether each element is a copy or has a metric; None where none is or has."""
    marks = []
    if copy_of is not None:
        marks.append(copy_of != ORIGINAL)
    if metric is not None:
        marks.append(metric.any(axis=1))
    return np.logical_or.reduce(marks) if marks else None


def copies_last(chosen: Rows, last: NDArray[np.bool_] | None) -> tuple[Rows, int]:
    """The rows `chosen` in their order, those marked in `last` at the end, and how many are not."""
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


def skews_of(graph: WrinkleGraph, rows: Rows) -> Floats:
    """(S, 4) float32 (xx, xy, yy, 0) of wrinkles (S,), as line.clh has them: places times these are
    where a wrinkle with a metric is as wide as its half width; (1, 0, 1, 0) where one has none."""
    skews = np.tile(np.array([1.0, 0.0, 1.0, 0.0]), (len(rows), 1))
    if graph.edge_metric is not None:
        metric = graph.edge_metric[rows]
        given = np.flatnonzero(metric.any(axis=1))
        half_width = graph.edge_half_width[rows[given]].astype(np.float64)
        skews[given, :3] = metric_roots(metric[given]) * half_width[:, None]
    return skews.astype(np.float32)
