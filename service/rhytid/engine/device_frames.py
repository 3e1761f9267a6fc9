"""What is made of a frame, and the grain that it shows. Every method runs on the device thread."""

from __future__ import annotations

from functools import partial

from rhytid.device.runtime import Buffer
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
from rhytid.pipeline.smooth import SmoothFields
from rhytid.pipeline.stretch_buffers import StretchBuffers


class DeviceFrames(DeviceMesh):
    """Stretch and grain of the frames of an asset, kept for those used last."""

    def _fields(self, frame: Frame, model: str) -> SmoothFields:
        response = self.settings.response
        limit, soft = response.log_stretch_limit, response.soft_limits
        return self._keep_of(
            frame, "fields", model,
            make=lambda: self._smooth.run(self._stretch_buffers(frame, model), limit, soft),
        )  # fmt: skip

    def _stretch_buffers(self, frame: Frame, model: str) -> StretchBuffers:
        response, angles = self.settings.response, self.settings.angles
        limit, soft = response.log_stretch_limit, response.soft_limits
        return self._keep_of(
            frame, "stretch", model,
            make=lambda: self._stretch.run(frame.positions, limit, model, angles, soft),
        )  # fmt: skip

    @property
    def _shows_grain(self) -> bool:
        return relief(self.settings) > 0.0

    def _grained(self, draw: Draw, frame: Frame, query: MapQuery, udim: int) -> Draw:
        """As `draw`, with the grain of a frame added."""
        if not self._shows_grain:
            return draw

        def grained(row: int, column: int, side: int) -> Buffer:
            out = draw(row, column, side)
            self._add_grain(out, frame, query, udim, (row, column, side))
            return out

        return grained

    def _add_grain(
        self, out: Buffer, frame: Frame, query: MapQuery, udim: int, square: tuple[int, int, int]
    ) -> None:
        grain = self._grain(frame, query, udim)
        for at in tiles_of_square(*square, self.settings.tile_size):
            grain.add(out, square, self._grain_place(udim, *at), self._grain_codes(udim, *at))

    def _grain(self, frame: Frame, query: MapQuery, udim: int) -> Grain:
        stretch = self._stretch_buffers(frame, query.stretch)
        fields = self._fields(frame, query.stretch) if query.sampling == "smooth" else None
        gains = self._gains(frame, query.stretch)
        return Grain(self._device, self.settings, self._located[udim], stretch, gains, fields)

    def _gains(self, frame: Frame, model: str) -> Buffer:
        return self._keep_of(
            frame, "gains", model,
            make=lambda: grain_gains(
                self._device, self.settings, self._stretch_buffers(frame, model)
            ),
        )  # fmt: skip

    def _grain_planes(self) -> GrainPlanes:
        size = self.settings.shape.grain_size
        assert size is not None
        make = partial(GrainPlanes, self._device, self._mesh, size, self._grain_shares)
        return self._keep("planes", make=make)

    def _grain_codes(self, udim: int, row: int, column: int) -> Buffer:
        """Of a tile of level 0."""
        square = (row, column, self.settings.tile_size)
        planes, located = self._grain_planes(), self._located[udim]
        make = partial(grain_codes, self._device, planes, located, self.settings, square)
        return self._keep("grain", udim, row, column, make=make)

    def _grain_place(self, udim: int, row: int, column: int) -> GrainPlace:
        square = (row, column, self.settings.tile_size)
        located, stiffness = self._located[udim], self._stiffness
        make = partial(grain_place, self._device, located, self.settings, stiffness, square)
        return self._keep("grain place", udim, row, column, make=make)
