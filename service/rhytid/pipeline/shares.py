"""Sizes of wrinkles for precomputed maps where they take shares of their own of the shortening of
skin: what a share makes of a depth is drawn into each sample, between which it is linear, as maps
are blended. Kernel: shares.cl."""

from __future__ import annotations

import numpy as np

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.reach import response_defines


class SharedSizes:
    """Sizes of the elements of a UDIM at any log stretch; each is made once, until `release`."""

    def __init__(self, device: Device, elements: UdimElements, settings: AssetSettings) -> None:
        self._device, self._elements, self._settings = device, elements, settings
        self._made: dict[tuple[float, int], Buffer] = {}

    def at(self, r: float, sizes: Buffer) -> Buffer:
        """`sizes`, those of the wrinkles or of their broad layer, with the weights that shares make
        of them at log stretch r; themselves where there are no shares."""
        shares = self._elements.shares
        if shares is None or r == 0.0:
            return sizes
        key = r, id(sizes)
        if key not in self._made:
            self._made[key] = self._scaled(r, sizes, shares)
        return self._made[key]

    def _scaled(self, r: float, sizes: Buffer, shares: Buffer) -> Buffer:
        response, count = self._settings.response, self._elements.wrinkles
        found = self._device.empty(4 * count, np.float32)
        self._device.launch(
            "shares", "shared_sizes", (count,), sizes, shares, np.float32(r),
            np.float32(response.alpha_d), found, defines=response_defines(response.soft_limits),
        )  # fmt: skip
        return found

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self._made.values():
            buffer.release()
        self._made.clear()
