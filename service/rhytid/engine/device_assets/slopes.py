"""Moments of slopes of an asset on the device: what does not change with the frame, and tangent
frames and levels of the frames used last, under the memory budget. Level 0 is a square at a time
and is not kept.

Of a frame that is 7 bytes for each texel of level 0, or 2 where level 1 was not asked for; of a
UDIM it is 2 bytes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.engine.device_assets.levels import DeviceFinest
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery, Tile
from rhytid.exports.textures.frame_map import islands_of, local_edges, texels_inside
from rhytid.exports.textures.tangents import joined
from rhytid.pipeline.levels import Part
from rhytid.pipeline.slopes import (
    ABOVE,
    BELOW,
    INSIDE,
    LEFT,
    RIGHT,
    Band,
    SlopeChart,
    SlopeLevels,
    SlopeWork,
    finest_moments,
    strip_rows,
)
from rhytid.pipeline.tangents import TangentMesh
from rhytid.pipeline.work import Square

# Rows of codes that are worked on at once.
_ROWS = 512


class DeviceSlopes:
    """Moments of slopes of squares of any level. Every method runs in a task of the device unless
    it says otherwise."""

    def __init__(self, base: DeviceMesh, finest: DeviceFinest) -> None:
        self._base, self._finest = base, finest

    def has_chart(self, udim: int) -> bool:
        """Whether the chart of a UDIM is there."""
        return self._chart(udim) is not None

    def make_chart(self, udim: int) -> None:
        """Make and keep the chart of a UDIM; on a thread that uses the device in steps, see
        `Device.in_steps`."""
        base, device = self._base, self._base.device
        triangles = base.texel_triangles(udim)
        joined(base.mesh)  # which is kept: it takes long, and tangent frames need it
        codes = neighbour_codes(base.mesh, udim, triangles)
        made = SlopeChart.of(device, triangles, codes, udim_origin(udim), self._rows)
        device.step(lambda: base.cache.keep("slope chart", udim, make=lambda: made))
        device.hand_over()

    def kept(
        self, frame: Frame, query: MapQuery, udim: int, level: int, square: Square
    ) -> tuple[Tile, Tile] | None:
        """Sums (5, n, n) of a square of level 1 or coarser, and its coverage (n, n); None where
        they are not kept."""
        found = (
            self._base.cache.find_of(frame, *_key(query, udim, least))
            for least in range(1, min(level, 2) + 1)
        )
        levels: SlopeLevels | None = next((one for one in found if one is not None), None)
        chart = self._chart(udim)
        if levels is None or chart is None:
            return None
        device = self._base.device
        coverage = chart.coverage.buffers[level - 1]
        share = device.read_square(coverage, chart.side >> level, *square)
        return levels.read(device, level, *square), share

    def begin(self, level: int) -> SlopeWork:
        """Begin the levels of a UDIM, so that `level` is among them; to be released."""
        side = self._base.settings.resolution
        return SlopeWork(self._base.device, side, self._rows, min(level, 2))

    @property
    def _rows(self) -> int:
        """Rows of a strip."""
        return strip_rows(self._base.settings.resolution, self._base.tile_side)

    def put(self, work: SlopeWork, frame: Frame, query: MapQuery, udim: int, place: Square) -> None:
        """Draw a piece of level 0, unless it is kept, into the band of the work that it is of."""
        device = self._base.device
        with self._finest.parts(frame, query, udim, place) as parts:
            for part in parts:
                work.band_of(part.row).put(device, part)
            device.finish()

    def put_drawn(self, work: SlopeWork, place: Square, heights: Tile) -> None:
        """As `put`, of heights (n, n) that were drawn already."""
        device, (row, column, side) = self._base.device, place
        held = device.upload(heights)
        work.band_of(row).put(device, Part(row, column, side, held))
        device.finish()
        held.release()

    def take(self, work: SlopeWork, row: int, heights: Tile) -> None:
        """Take heights (rows, R) from a row on, drawn already, as a band of the work."""
        work.take(Band.of(self._base.device, row, heights))

    def add(self, work: SlopeWork, frame: Frame, udim: int) -> bool:
        """Make what the heights so far are enough for; False where the chart is not there any
        more."""
        chart = self._chart(udim)
        if chart is not None:
            work.add(chart, self._terms(frame))
            self._base.device.finish()
        return chart is not None

    def keep(
        self, work: SlopeWork, frame: Frame, query: MapQuery, udim: int, settings: AssetSettings
    ) -> bool:
        """Keep the levels that are complete, of heights drawn with `settings`. False where these
        are not the present ones."""
        if self._base.settings is not settings:
            return False
        self._base.cache.keep_of(frame, *_key(query, udim, work.least), make=work.finish)
        return True

    def finest(self, frame: Frame, udim: int, around: Tile, square: Square) -> Tile | None:
        """(5, n, n) moments of a square of level 0, a tile.  around: (n + 2, n + 2) heights of it
        and of what is around it. None where the chart is not there any more."""
        chart = self._chart(udim)
        if chart is None:
            return None
        row, column, _ = square
        return finest_moments(self._base.device, chart, self._terms(frame), around, row, column)

    def _chart(self, udim: int) -> SlopeChart | None:
        found: SlopeChart | None = self._base.cache.find("slope chart", udim)
        return found

    def _terms(self, frame: Frame) -> Buffer:
        """Of the triangles of a frame, for slopes.cl."""
        mesh, device = self._mesh(), self._base.device
        positions = self._base.neutral if frame.positions is None else frame.positions
        return self._base.cache.keep_of(
            frame, "slope terms", make=lambda: mesh.terms(device, positions)
        )

    def _mesh(self) -> TangentMesh:
        base = self._base
        mesh, side = base.mesh, base.settings.resolution
        return base.cache.keep(
            "slope mesh",
            make=lambda: TangentMesh.of(
                base.device, mesh.faces, mesh.triangle_uv() * side, *joined(mesh).numbers
            ),
        )


def _key(query: MapQuery, udim: int, least: int) -> tuple[str | int, ...]:
    return ("slopes", query.method, query.stretch, query.sampling, udim, least)


def neighbour_codes(mesh: Mesh, udim: int, triangles: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(R, R) codes of the texels of a UDIM, row 0 at the top: whether the centre lies in a
    triangle, and which neighbours count. Those of another island do not; of the same one, those
    outside of its triangles count where there is no other, as for normal maps.

    triangles: (R, R) the triangle of each texel, padding included; the number of triangles for
    none.
    """
    shown = triangles < len(mesh.faces)
    inside = texels_inside(np.where(shown, triangles, 0), local_edges(mesh, udim)) & shown
    if not inside.any():
        inside = shown
    island = np.append(islands_of(mesh), -1).astype(np.int32)
    side = len(triangles)
    out = np.zeros((side, side), np.uint8)
    for start in range(0, side, _ROWS):
        rows = np.arange(start - 1, min(start + _ROWS, side) + 1)
        near, held = rows.clip(0, side - 1), (rows >= 0) & (rows < side)
        here = np.where(held[:, None], island[triangles[near]], -1)
        out[start : start + _ROWS] = _codes(here, inside[near])
    return out


def _codes(island: NDArray[np.int32], inside: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(h, w) codes of the rows between the first and the last of (h + 2, w)."""
    island = np.pad(island, ((0, 0), (1, 1)), constant_values=-1)
    inside = np.pad(inside, ((0, 0), (1, 1)))
    middle = island[1:-1, 1:-1]
    code: NDArray[np.uint8] = inside[1:-1, 1:-1] * np.uint8(INSIDE)
    pairs = (
        (RIGHT, np.s_[1:-1, 2:], LEFT, np.s_[1:-1, :-2]),
        (ABOVE, np.s_[:-2, 1:-1], BELOW, np.s_[2:, 1:-1]),
    )
    for one, at_one, other, at_other in pairs:
        same = [(island[at] == middle) & (middle >= 0) for at in (at_one, at_other)]
        good = [part & inside[at] for part, at in zip(same, (at_one, at_other), strict=True)]
        any_good = good[0] | good[1]
        for bit, mine, best in zip((one, other), same, good, strict=True):
            code |= np.where(any_good, best, mine) * np.uint8(bit)
    return code
