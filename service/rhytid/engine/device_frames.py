"""Stretch of the frames of an asset, and what follows from it for its wrinkles and triangles."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.blend import Coefficients
from rhytid.pipeline.redraw import ScaleBuffers, respond
from rhytid.pipeline.smooth import SmoothFields, respond_smooth
from rhytid.pipeline.stretch import StretchBuffers


class DeviceFrames:
    """What a tile of a frame is computed from; kept for the frames used last. Every method runs in
    a task of the device."""

    def __init__(self, base: DeviceMesh) -> None:
        self._base = base

    def ratios(self, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(ratios (F, 2) unclamped, axes (F, 2, 2)) of a frame."""
        return self._base.stretch.read(self.stretch(frame, "tensor"))

    def stretch(self, frame: Frame, model: str) -> StretchBuffers:
        """Log stretch and axes of each triangle."""
        base, response = self._base, self._base.settings.response
        limit, soft = response.log_stretch_limit, response.soft_limits
        return base.kept.keep_of(
            frame, "stretch", model,
            make=lambda: base.stretch.run(
                frame.positions, limit, model, base.settings.angles, soft
            ),
        )  # fmt: skip

    def fields(self, frame: Frame, model: str) -> SmoothFields:
        """Log stretch interpolated over the surface."""
        base, response = self._base, self._base.settings.response
        limit, soft = response.log_stretch_limit, response.soft_limits
        return base.kept.keep_of(
            frame, "fields", model,
            make=lambda: base.smooth.run(self.stretch(frame, model), limit, soft),
        )  # fmt: skip

    def scales(self, frame: Frame, query: MapQuery, udim: int) -> ScaleBuffers:
        """Width and depth scales of wrinkles and pores."""
        base = self._base
        device, elements, located = base.device, base.elements[udim], base.located[udim]
        model, sampling = query.stretch, query.sampling
        if sampling == "smooth":
            fields = self.fields(frame, model)
            make = partial(respond_smooth, device, elements, located, base.settings, fields)
        else:
            stretch = self.stretch(frame, model)
            make = partial(respond, device, elements, base.settings, stretch)
        return base.kept.keep_of(frame, "scales", udim, model, sampling, make=make)

    def coefficients(self, frame: Frame, model: str) -> Coefficients:
        """By which the fast method blends, of each triangle."""
        blend = self._base.blend
        return self._base.kept.keep_of(
            frame, "coefficients", model,
            make=lambda: blend.coefficients(self.stretch(frame, model)),
        )  # fmt: skip

    def bin_stretches(self, frame: Frame, model: str) -> Buffer:
        """Stretch across each bin, of each triangle, where stiffness differs by texel."""
        blend = self._base.blend
        return self._base.kept.keep_of(
            frame, "stretches", model, make=lambda: blend.stretches(self.stretch(frame, model))
        )

    def kernels(self, frame: Frame, model: str) -> Buffer:
        """By which `convolved` convolves, of each triangle."""
        base = self._base
        return base.kept.keep_of(
            frame, "kernels", model,
            make=lambda: base.convolve.kernels(self.stretch(frame, model), base.settings),
        )  # fmt: skip
