"""The growth of costs: of a frame with texels, wrinkles, triangles and bins, and of synthesis with
wrinkles."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.synthesis.progress import clocked, silent
from rhytid_lab.bench.frame import FrameBench
from rhytid_lab.bench.subject import Grown, grow
from rhytid_lab.plots import Point, curves
from rhytid_lab.samples.sphere import sphere, sphere_stretch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Of synthesis, as its progress calls them, and their sum.
STAGES = ("pores", "edges", "crossings", "directions", "trails", "selection", "shapes", "all")
# Of each series: the title of its axis, and the cases that it times.
SERIES = {
    "size": (
        "texels per side, wrinkles in proportion",
        ("stretch", "redraw", "binned", "convolved"),
    ),
    "wrinkles": ("wrinkles", ("redraw", "precompute")),
    "triangles": ("triangles", ("stretch", "redraw", "binned")),
    "bins": ("orientation bins", ("binned", "precompute")),
    "synthesis": ("wrinkles", STAGES),
}
_SMALLEST = 256
_FEWEST = 100
_SHARES = (1 / 64, 1 / 16, 1 / 4, 1)
_RINGS = (16, 32, 64, 128, 256, 384)
_BINS = (1, 2, 4, 8, 16)


@dataclass(frozen=True)
class Growth:
    """One case at one point of a series.  x: the value on the series' axis.  map_copies: None for
    synthesis."""

    series: str
    x: int
    case: str
    seconds: float
    map_copies: float | None = None


class Scaling:
    """Times series around one frame: `size`² texels with `wrinkles` wrinkles, on a device.

    mesh, deformed: the face; the series of triangles uses spheres.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        deformed: NDArray[np.float32],
        size: int,
        wrinkles: int,
        repeats: int,
    ) -> None:
        self._device, self._mesh, self._deformed = device, mesh, deformed
        self._size, self._wrinkles, self._repeats = size, wrinkles, repeats
        self._grown: dict[int, Grown] = {}

    def run(self, series: str) -> Iterator[Growth]:
        """Time one of SERIES; each growth as soon as it is there."""
        if series == "synthesis":
            yield from self._synthesis()
            return
        for x, bench in getattr(self, f"_{series}_series")():
            for case in SERIES[series][1]:
                cost = bench.cost(case, self._repeats)
                yield Growth(series, x, case, cost.seconds, cost.map_copies)
            bench.release()

    def _synthesis(self) -> Iterator[Growth]:
        for count in self._counts():
            clock, seconds = clocked(silent)
            start = time.perf_counter()
            grow(self._device, self._mesh, count, clock)
            seconds["all"] = time.perf_counter() - start
            yield from (Growth("synthesis", count, stage, seconds[stage]) for stage in STAGES)

    def _size_series(self) -> Iterator[tuple[int, FrameBench]]:
        size = max(self._size // 8, _SMALLEST)
        while size <= self._size:
            yield size, self._bench(size, self._face(self._share((size / self._size) ** 2)))
            size *= 2

    def _wrinkles_series(self) -> Iterator[tuple[int, FrameBench]]:
        for count in self._counts():
            yield count, self._bench(self._size, self._face(count))

    def _triangles_series(self) -> Iterator[tuple[int, FrameBench]]:
        for rings in _RINGS:
            mesh = sphere(rings)
            made = grow(self._device, mesh, self._share(1 / 16))
            bent = sphere_stretch(mesh, 1.25, 0.8)
            settings = _settings(self._size, made)
            yield len(mesh.faces), FrameBench(self._device, mesh, made.graph, bent, settings)

    def _bins_series(self) -> Iterator[tuple[int, FrameBench]]:
        for count in _BINS:
            yield count, self._bench(self._size, self._face(self._share(1 / 4)), count=count)

    def _bench(self, size: int, made: Grown, **bins: Any) -> FrameBench:
        settings = _settings(size, made, **bins)
        return FrameBench(self._device, self._mesh, made.graph, self._deformed, settings)

    def _counts(self) -> list[int]:
        return list(dict.fromkeys(self._share(share) for share in _SHARES))

    def _share(self, share: float) -> int:
        return max(round(share * self._wrinkles), _FEWEST)

    def _face(self, wrinkles: int) -> Grown:
        if wrinkles not in self._grown:
            self._grown[wrinkles] = grow(self._device, self._mesh, wrinkles)
        return self._grown[wrinkles]


def plot(found: Sequence[Growth]) -> Figure:
    """Plot one series."""
    heights = [g.seconds if g.map_copies is None else g.map_copies for g in found]
    points = [Point(g.x, y, g.case) for g, y in zip(found, heights, strict=True)]
    unit = "seconds" if found[0].map_copies is None else "map copies"
    return curves(points, SERIES[found[0].series][0], unit)


def _settings(size: int, made: Grown, **bins: Any) -> AssetSettings:
    given = {"resolution": size, "preset": "paper", "bins": bins}
    return AssetSettings.parse(given).resolved(made.spacing)
