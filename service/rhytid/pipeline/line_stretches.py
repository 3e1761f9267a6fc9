"""Log stretch at the ends of lines, by which the fast method blends their broad layer: of all lines
of a UDIM, or of those alone that own samples of one tile. Kernels: respond.cl, ends.cl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.cushion import CushionTile
from rhytid.pipeline.elements import LinePlaces, UdimElements
from rhytid.pipeline.nearby import Groups, Numbers, united
from rhytid.pipeline.reach import response_defines
from rhytid.pipeline.redraw import R_ALONE, Responder, take_over


@dataclass
class LineStretches(BufferGroup):
    """r of K wrinkles of a UDIM in one frame, on the device, to be filled for frame after frame:
    fresh memory takes as long as what is written to it.

    ends: (K + 1, 2) float32 at both ends, then that of none, 0.
    frame: digest of the frame that they are of; "" for none.
    """

    ends: Buffer
    frame: str = ""

    @classmethod
    def allocate(cls, device: Device, elements: UdimElements) -> LineStretches:
        """Buffers for the wrinkles of `elements`, not initialised."""
        return cls(device.empty(2 * (elements.wrinkles + 1), np.float32))

    def fill(
        self, device: Device, elements: UdimElements, settings: AssetSettings, wrinkles: Responder
    ) -> None:
        """Alg. 1 finds r in the middle; `response.ends` says how far ends go to that of the next.

        wrinkles: launches Alg. 1 with the defines R_ALONE.
        """
        count = elements.wrinkles
        given = (elements.segments, elements.wrinkle_triangle, elements.wrinkle_stiffness)
        r = device.empty(count, np.float32)  # in the middle of each
        wrinkles(count, *given, r)
        take_over(device, elements.wrinkle_origins, wrinkles, r, R_ALONE)
        _find_ends(device, settings, count, r, elements.partners, self.ends)
        r.release()

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.ends,)


@dataclass(frozen=True)
class OwnerLines(BufferGroup):
    """The N lines that own samples of the broad layer of a tile, and after them those that continue
    them, M in all: a third of the lines that may be drawn there. Copies are as their originals.

    owners: as of CushionTile, by their numbers here.  places (M, 4), triangle (M,), stiffness (M,):
    as of WrinkleArrays.  partners (N, 2): likewise, by their numbers here.
    r (M,), ends (N + 1, 2): of the last frame that was asked for, as of LineStretches.
    """

    count: int
    owners: Buffer
    places: Buffer
    triangle: Buffer
    stiffness: Buffer | None
    partners: Buffer | None
    r: Buffer
    ends: Buffer

    @classmethod
    def of(cls, device: Device, elements: UdimElements, cushion: CushionTile) -> OwnerLines:
        """The owners of a tile of a UDIM."""
        count, (owners, marked) = elements.wrinkles, cushion.read_marked(device)
        owning = united([owners[owners < count]])
        partners: Numbers | None = None
        every = owning
        if elements.partners is not None:
            partners = device.read(elements.partners, (count, 2), np.int32)[owning]
            every = np.concatenate([owning, _others(partners, owning)])
        # Of each line; of none; and, from behind, of no partner.
        number = np.full(count + 2, -1, np.int32)
        number[every], number[count] = np.arange(len(every)), len(owning)
        own = number[owners]
        own[marked] ^= -1  # as CushionTile marks them
        sampled = LinePlaces.read(device, elements)
        return cls(
            len(owning),
            device.upload(own),
            device.upload(sampled.places[every]),
            device.upload(sampled.triangle[every]),
            None if sampled.stiffness is None else device.upload(sampled.stiffness[every]),
            None if partners is None else device.upload(number[partners]),
            device.empty(len(every), np.float32),
            device.empty(2 * (len(owning) + 1), np.float32),
        )

    def fill(self, device: Device, settings: AssetSettings, wrinkles: Responder) -> None:
        """As that of LineStretches."""
        wrinkles(self.triangle.nbytes // 4, self.places, self.triangle, self.stiffness, self.r)
        _find_ends(device, settings, self.count, self.r, self.partners, self.ends)

    def triangles(self, device: Device) -> Numbers:
        """Those that they sample."""
        found: Numbers = device.read(self.triangle, (self.triangle.nbytes // 4,), np.int32)
        return found

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        sampled = (self.places, self.triangle, self.stiffness, self.partners)
        return (self.owners, *sampled, self.r, self.ends)


def _find_ends(
    device: Device, settings: AssetSettings, count: int, r: Buffer, partners: Buffer | None,
    ends: Buffer,
) -> None:  # fmt: skip
    """r at both ends of the first `count` lines, from r of each."""
    device.launch(
        "ends", "end_stretches", (Groups.of(count + 1).items,),
        r, partners, np.int32(count), np.float32(settings.response.ends), ends,
        defines=response_defines(settings.response.soft_limits),
    )  # fmt: skip


def _others(partners: Numbers, lines: Numbers) -> Numbers:
    """The partners, -1 for none, that are not among some lines."""
    found = united([partners[partners >= 0]])
    return np.setdiff1d(found, lines, assume_unique=True)
