"""The wrinkles and pores of one UDIM on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.launches import DrawingPace
from rhytid.device.runtime import Device
from rhytid.pipeline.cells import CellLists
from rhytid.pipeline.copies import OriginBuffers
from rhytid.pipeline.cushion_elements import CushionArrays
from rhytid.pipeline.element_arrays import PoreArrays, WrinkleArrays
from rhytid.pipeline.work import MapWork


def orientation_bins(segments: NDArray[np.float32], count: int) -> NDArray[np.uint8]:
    """The bin of each wrinkle (section 2.4): nearest, mod π, to θₙ = (sin(πn/N), cos(πn/N))."""
    angle = np.arctan2(segments[:, 2].astype(np.float64), segments[:, 3].astype(np.float64))
    return (np.rint(angle * (count / np.pi)).astype(np.int64) % count).astype(np.uint8)


@dataclass(frozen=True)
class Lists:
    """Block lists on the device."""

    offsets: Buffer
    members: Buffer

    @classmethod
    def upload(cls, device: Device, lists: CellLists) -> Lists:
        """The lists, on the device."""
        return cls(device.upload(lists.offsets), device.upload(lists.members))

    def release(self) -> None:
        """Give the memory back."""
        self.offsets.release()
        self.members.release()


@dataclass(frozen=True)
class CushionElements:
    """CushionArrays on the device."""

    factor: int
    sizes: Buffer
    lists: Lists

    @classmethod
    def upload(cls, device: Device, arrays: CushionArrays | None) -> CushionElements | None:
        """The arrays, on the device."""
        if arrays is None:
            return None
        return cls(arrays.factor, device.upload(arrays.sizes), Lists.upload(device, arrays.lists))

    def release(self) -> None:
        """Give the memory back."""
        self.sizes.release()
        self.lists.release()


class UdimElements:
    """The wrinkles and pores of one UDIM on the device.

    work: of drawing any square of them.  pace, bins_pace: at which that goes, of what a frame shows
    and of one precomputed map."""

    def __init__(
        self, device: Device, wrinkles: WrinkleArrays, pores: PoreArrays, bin_count: int
    ) -> None:
        self.wrinkles, self.pores = len(wrinkles.segments), len(pores.centres)
        self.work = work_of(wrinkles, pores)
        self.pace, self.bins_pace = DrawingPace(device.work_pace), DrawingPace(device.work_pace)
        self.segments = device.upload(wrinkles.segments)
        self.sizes = device.upload(wrinkles.sizes)
        self.bins = device.upload(orientation_bins(wrinkles.segments, bin_count))
        self.wrinkle_triangle = device.upload(wrinkles.triangle)
        self.wrinkle_stiffness = _upload(device, wrinkles.stiffness)
        self.wrinkle_lists = Lists.upload(device, wrinkles.lists)
        self.waves = _upload(device, wrinkles.waves)
        self.slopes = _upload(device, wrinkles.slopes)
        self.partners = _upload(device, wrinkles.partners)
        self.skews = _upload(device, wrinkles.skews)
        self._even = wrinkles.even
        self.wrinkle_origins = OriginBuffers.upload(device, wrinkles.origins, wrinkles.even)
        self.cushion = CushionElements.upload(device, wrinkles.cushion)
        self.centres = device.upload(pores.centres)
        self.roots = device.upload(pores.roots)
        self.pore_triangle = device.upload(pores.triangle)
        self.pore_stiffness = _upload(device, pores.stiffness)
        self.pore_lists = Lists.upload(device, pores.lists)
        self.pore_origins = OriginBuffers.upload(device, pores.origins, self.pores - pores.copies)

    @property
    def bent(self) -> bool:
        """Whether wrinkles have sizes and scales for each of their ends."""
        return self.slopes is not None

    @property
    def response_defines(self) -> dict[str, object]:
        """What the kernels that find r of wrinkles are compiled with for these."""
        return {"BENT": 1} if self.bent else {}

    @property
    def line_arguments(self) -> tuple[Any, ...]:
        """LINES of line.clh."""
        given = (self.segments, self.sizes, self.slopes, self.waves)
        found = tuple(buffer for buffer in given if buffer is not None)
        return found if self.skews is None else (*found, np.int32(self._even), self.skews)

    @property
    def line_defines(self) -> dict[str, object]:
        """What line.clh is compiled with for these wrinkles."""
        given = {"BENT": self.slopes, "WAVY": self.waves, "SKEWED": self.skews}
        return {name: 1 for name, buffer in given.items() if buffer is not None}

    def release(self) -> None:
        """Give the memory back."""
        for value in vars(self).values():
            if isinstance(value, Lists | CushionElements | Buffer | OriginBuffers):
                value.release()


def work_of(wrinkles: WrinkleArrays, pores: PoreArrays) -> MapWork:
    """What drawing the wrinkles and pores of a UDIM takes."""
    broad = None if wrinkles.cushion is None else (wrinkles.cushion.lists, wrinkles.cushion.factor)
    return MapWork(wrinkles.lists, pores.lists, cushion=broad)


def _upload(device: Device, array: NDArray[Any] | None) -> Buffer | None:
    return None if array is None else device.upload(array)
