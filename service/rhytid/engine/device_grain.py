"""The grain of an asset: its codes by tile, and its gain in a frame."""

from __future__ import annotations

from functools import partial

from rhytid.device.buffer import Buffer
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.grain import (
    Grain,
    GrainPlace,
    GrainPlanes,
    grain_codes,
    grain_gains,
    grain_place,
    relief,
    tiles_of_square,
)
from rhytid.pipeline.levels import Draw


class DeviceGrain:
    """Adds grain to what was drawn without. Every method runs in a task of the device."""

    def __init__(self, base: DeviceMesh, frames: DeviceFrames) -> None:
        self._base, self._frames = base, frames

    @property
    def shows(self) -> bool:
        """Whether the settings have any."""
        return relief(self._base.settings) > 0.0

    def added(self, draw: Draw, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """As `draw`, with the grain of a frame."""
        if not self.shows:
            return draw

        def grained(row: int, column: int, side: int) -> Buffer:
            out = draw(row, column, side)
            self.add(out, frame, query, udim, (row, column, side))
            return out

        return grained

    def add(
        self, out: Buffer, frame: Frame, query: MapQuery, udim: int, square: tuple[int, int, int]
    ) -> None:
        """Add the grain of a frame to a square of level 0: (row, column, texels per side)."""
        if not self.shows:
            return
        grain = self._of_frame(frame, query, udim)
        for at in tiles_of_square(*square, self._base.settings.tile_size):
            grain.add(out, square, self._place(udim, *at), self.codes(udim, *at))

    def codes(self, udim: int, row: int, column: int) -> Buffer:
        """Of the tile of level 0 whose first texel this is."""
        base = self._base
        square = (row, column, base.settings.tile_size)
        planes, located = self._planes(), base.located[udim]
        make = partial(grain_codes, base.device, planes, located, base.settings, square)
        return base.kept.keep("grain", udim, row, column, make=make)

    def _of_frame(self, frame: Frame, query: MapQuery, udim: int) -> Grain:
        base, model = self._base, query.stretch
        stretch = self._frames.stretch(frame, model)
        fields = self._frames.fields(frame, model) if query.sampling == "smooth" else None
        gains = base.kept.keep_of(
            frame, "gains", model, make=lambda: grain_gains(base.device, base.settings, stretch)
        )
        return Grain(base.device, base.settings, base.located[udim], stretch, gains, fields)

    def _planes(self) -> GrainPlanes:
        base, size = self._base, self._base.settings.shape.grain_size
        assert size is not None
        make = partial(GrainPlanes, base.device, base.mesh, size, base.grain_shares)
        return base.kept.keep("planes", make=make)

    def _place(self, udim: int, row: int, column: int) -> GrainPlace:
        base = self._base
        square, located = (row, column, base.settings.tile_size), base.located[udim]
        make = partial(grain_place, base.device, located, base.settings, base.stiffness, square)
        return base.kept.keep("grain place", udim, row, column, make=make)
