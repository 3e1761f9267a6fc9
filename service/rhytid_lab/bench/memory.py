"""How much memory a bench needs, printed before it starts: at 16384² it is many GiB."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from rhytid.device.memory import machine_memory
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import DeviceMemoryError
from rhytid.pipeline.bins import map_count
from rhytid.pipeline.cushion import cushion_map_count

GIB = 1 << 30
# Bytes on the device, measured on the built-in face at 1024² and 2048² with 5,000 to 300,000
# wrinkles. A texel: two maps that are copied; what a case draws into; the triangles beside the
# precomputed maps; the neutral tiles of `convolved` with their rims, at the widest blur.
_COPIES, _DRAWN, _PLACED, _NEUTRAL = 8.0, 4.5, 1.6, 11.5
# Of cushions, at half the resolution where it is finest: a map, and a code of grain.
_BROAD = 2.0
# A wrinkle with its pores, a triangle.
_WRINKLE, _TRIANGLE = 66, 240
# Bytes on the host: a map that is read in tiles and put together; a wrinkle while it is grown; what
# the process and its libraries take.
_READ, _GROWN, _PROCESS = 8.0, 210, 400_000_000


@dataclass(frozen=True)
class Need:
    """Bytes on the device and on the host, about."""

    device: int
    host: int

    @classmethod
    def of(
        cls, settings: AssetSettings, cases: Collection[str], wrinkles: float, triangles: int
    ) -> Need:
        """What `cases` of a frame need together: what one leaves for the next is kept."""
        a_texel = _COPIES + _DRAWN
        a_texel += _BROAD if settings.shape.cushion > 0.0 else 0.0
        if {"binned", "precompute"} & set(cases):
            bins, codes = settings.bins, settings.bins.bits / 8
            a_texel += map_count(bins) * codes + _PLACED
            if settings.shape.cushion > 0.0:
                a_texel += 0.25 * cushion_map_count(settings) * codes
        if "convolved" in cases:
            a_texel += _NEUTRAL
        texels = settings.resolution**2
        device = a_texel * texels + _WRINKLE * wrinkles + _TRIANGLE * triangles
        return cls(int(device), int(_READ * texels + _GROWN * wrinkles + _PROCESS))

    def check(self, device: Device) -> None:
        """Raise DeviceMemoryError where the budget, the device or the machine has less."""
        limit, cpu = device.budget.limit, device.info.kind == "cpu"
        if self.device > limit:
            raise DeviceMemoryError(
                f"{self.text()}: the budget is {_gib(limit)} of the {_gib(device.info.memory)} of "
                f"{device.info.name}; raise RHYTID_DEVICE_MEMORY_MB to {self.device // 2**20 + 1} "
                "where there is that much, or take fewer --methods or a smaller --size"
            )
        has, wanted = machine_memory(), self.host + (self.device if cpu else 0)
        if wanted > has:
            raise DeviceMemoryError(
                f"{self.text()}: the machine has {_gib(has)}; take fewer --methods or a smaller "
                "--size"
            )

    def text(self) -> str:
        """In words."""
        return f"needs about {_gib(self.device)} of device memory and {_gib(self.host)} beside it"


def _gib(count: int) -> str:
    return f"{count / GIB:.1f} GiB"
