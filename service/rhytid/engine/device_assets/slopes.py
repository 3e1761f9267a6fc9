"""Moments of slopes of an asset on the device: what does not change with the frame, and tangent
frames and levels of the frames used last, under the memory budget. Level 0 is a square at a time
and is not kept.

Of a frame that is 7 bytes for each texel of level 0, or 2 where level 1 was not asked for; of a
UDIM it is 2 bytes.
"""

from __future__ import annotations

from rhytid.device.buffer import Buffer
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.tiles import udim_origin
from rhytid.engine.device_assets.levels import DeviceFinest
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery, Tile
from rhytid.exports.textures.slope_codes import neighbour_codes
from rhytid.exports.textures.tangents import joined
from rhytid.pipeline.levels import Part
from rhytid.pipeline.slopes import (
    Band,
    SlopeChart,
    SlopeLevels,
    SlopeWork,
    finest_moments,
    strip_rows,
)
from rhytid.pipeline.tangents import TangentMesh
from rhytid.pipeline.work import Square


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
