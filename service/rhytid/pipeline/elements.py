"""The wrinkles, pores and events of one UDIM on the device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.launches import DrawingPace
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import ResponseSettings
from rhytid.pipeline.bins import scale
from rhytid.pipeline.cells import CellLists, Lists
from rhytid.pipeline.copies import OriginBuffers, sampled
from rhytid.pipeline.cushion_layer import CushionArrays
from rhytid.pipeline.element_arrays import PoreArrays, WrinkleArrays
from rhytid.pipeline.event_elements import EventArrays, EventElements
from rhytid.pipeline.nearby import NearbyElements, Numbers, elements_of
from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.pipeline.work import MapWork, Square


class UdimElements:
    """The wrinkles, pores and events of one UDIM on the device.

    work: of drawing any square of them.  pace, bins_pace, cushion_pace: at which that goes, of what
    a frame shows, of one precomputed map, and of one of the broad layer.  events: None where there
    are none.  wrinkle_rows: of the graph, and behind them -1.  nearby: what a square needs.
    """

    def __init__(
        self,
        device: Device,
        wrinkles: WrinkleArrays,
        pores: PoreArrays,
        bin_count: int,
        events: EventArrays | None = None,
    ) -> None:
        self.wrinkles, self.pores = len(wrinkles.segments), len(pores.centres)
        self.work = work_of(wrinkles, pores, events)
        self.nearby = NearbyElements(
            wrinkles.lists, pores.lists, self.wrinkles, wrinkles.partners, broad_lists(wrinkles)
        )
        paces = (DrawingPace(device.work_pace) for _ in range(3))
        self.pace, self.bins_pace, self.cushion_pace = paces
        self.segments = device.upload(wrinkles.segments)
        self.sizes = device.upload(wrinkles.sizes)
        self.bins = device.upload(orientation_bins(wrinkles.segments, bin_count))
        self.wrinkle_triangle = device.upload(wrinkles.triangle)
        self.wrinkle_stiffness = _upload(device, wrinkles.stiffness)
        self.wrinkle_lists = Lists.upload(device, wrinkles.lists)
        self.waves = _upload(device, wrinkles.waves)
        self.slopes = _upload(device, wrinkles.slopes)
        self.partners = _upload(device, wrinkles.partners)
        self.shares = _upload(device, wrinkles.shares)
        self.share_range = wrinkles.share_range
        self.skews = _upload(device, wrinkles.skews)
        self._even = wrinkles.even
        self.wrinkle_origins = OriginBuffers.upload(device, wrinkles.origins, wrinkles.even)
        self.cushion = CushionElements.upload(device, wrinkles.cushion)
        self.wrinkle_rows = _with_none(wrinkles.rows)
        self.centres = device.upload(pores.centres)
        self.roots = device.upload(pores.roots)
        self.pore_triangle = device.upload(pores.triangle)
        self.pore_stiffness = _upload(device, pores.stiffness)
        self.pore_lists = Lists.upload(device, pores.lists)
        self.pore_origins = OriginBuffers.upload(device, pores.origins, self.pores - pores.copies)
        self.events = None if events is None else EventElements(device, events)

    def triangles(self, device: Device, square: Square) -> Numbers:
        """The triangles whose stretch the wrinkles and pores that may be drawn in a square of level
        0 answer to, and more than once."""
        lines = elements_of(self.nearby.answering(square), self.wrinkles)
        pores = elements_of(self.nearby.pores(square), self.pores)
        kinds = [
            (lines, self.wrinkles, self.wrinkle_triangle, self.wrinkle_origins),
            (pores, self.pores, self.pore_triangle, self.pore_origins),
        ]
        return np.concatenate([sampled(device, *kind) for kind in kinds])

    def event_triangles(self, device: Device, square: Square) -> Numbers:
        """Likewise of events."""
        if (events := self.events) is None:
            return np.zeros(0, np.int32)
        return sampled(device, events.nearby(square), events.count, events.triangle, events.origins)

    @property
    def bent(self) -> bool:
        """Whether wrinkles have sizes and scales for each of their ends."""
        return self.slopes is not None

    @property
    def response_defines(self) -> dict[str, object]:
        """The defines of the kernels that find r of these wrinkles."""
        return {"BENT": 1} if self.bent else {}

    @property
    def line_arguments(self) -> tuple[Any, ...]:
        """The arguments LINES of line.clh."""
        even = np.int32(self._even)
        return (self.segments, self.sizes, self.slopes, self.waves, even, self.skews)

    @property
    def line_defines(self) -> dict[str, object]:
        """The defines of kernels that draw these wrinkles (line_kinds.clh)."""
        given = {"BENT": self.slopes, "WAVY": self.waves, "SKEWED": self.skews}
        return {name: 1 for name, buffer in given.items() if buffer is not None}

    @property
    def share_defines(self) -> dict[str, object]:
        """The defines of shared_sizes.clh."""
        return {} if self.shares is None else {"SHARED": 1, "SCALE_LIMIT": f"{SCALE_LIMIT}f"}

    def share_arguments(
        self, response: ResponseSettings, r: float, narrow: float = 1.0
    ) -> tuple[Any, ...]:
        """The arguments SHARES of shared_sizes.clh of a map at log stretch r.

        narrow: weights of the narrow layer over those of the layer that is drawn.
        """
        if self.shares is None:
            return ()
        return self.shares, np.array(_answer(response, r, narrow), np.float32)

    def stretches(
        self,
        device: Device,
        response: ResponseSettings,
        drawn: Sequence[DrawnStretch],
        narrow: float = 1.0,
    ) -> tuple[Buffer, ...]:
        """The arguments SHARES_OF_LINES and `stretches` of stretches.clh. The last is the caller's
        to release.  narrow: as in `share_arguments`."""
        shares = () if self.shares is None else (self.shares,)
        rows = [
            (one.width, one.depth, one.per_step, one.lean, *_answer(response, one.r, narrow))
            for one in drawn
        ]
        return (*shares, device.upload(np.array(rows, np.float32)))

    def release(self) -> None:
        """Give the memory back."""
        for value in vars(self).values():
            if isinstance(value, Lists | CushionElements | EventElements | Buffer | OriginBuffers):
                value.release()


class LinePlaces(NamedTuple):
    """Where K wrinkles of a UDIM sample stretch, copies where their originals do, on the host.

    places (K, 4): segments, texels.  triangle (K,).  stiffness (K,), or None: 1 throughout.
    """

    places: NDArray[np.float32]
    triangle: NDArray[np.int32]
    stiffness: NDArray[np.float32] | None

    @classmethod
    def read(cls, device: Device, elements: UdimElements) -> LinePlaces:
        """Of all wrinkles of a UDIM, from the device."""
        count, origins, stiffness = elements.wrinkles, elements.wrinkle_origins, None
        places = device.read(elements.segments, (count, 4), np.float32)
        triangle = device.read(elements.wrinkle_triangle, (count,), np.int32)
        if elements.wrinkle_stiffness is not None:
            stiffness = device.read(elements.wrinkle_stiffness, (count,), np.float32)
        if origins is not None:
            own, copies = slice(origins.first, origins.first + origins.count), (origins.count,)
            places[own] = device.read(origins.places, (*copies, 4), np.float32)
            triangle[own] = device.read(origins.triangle, copies, np.int32)
            if stiffness is not None and origins.stiffness is not None:
                stiffness[own] = device.read(origins.stiffness, copies, np.float32)
        return cls(places, triangle, stiffness)


@dataclass(frozen=True, eq=False)
class LineSources:
    """What K wrinkles of a UDIM answer to stretch by, copies as their originals do.

    rows (K,): of the graph.  triangle (K,).  directions (K, 2): unit vectors in UV.  partners
    (K, 2): which of the K continue at both ends, -1 for none.
    """

    rows: NDArray[np.int32]
    triangle: NDArray[np.int32]
    directions: NDArray[np.float64]
    partners: NDArray[np.int32]

    @classmethod
    def read(cls, device: Device, elements: UdimElements) -> LineSources:
        """Of all wrinkles of a UDIM, from the device."""
        count, sampled = elements.wrinkles, LinePlaces.read(device, elements)
        along = sampled.places[:, 2:].astype(np.float64)
        size = np.linalg.norm(along, axis=1, keepdims=True)
        partners = np.full((count, 2), -1, np.int32)
        if elements.partners is not None:
            partners = device.read(elements.partners, (count, 2), np.int32)
        along /= np.maximum(size, 1e-30)
        return cls(elements.wrinkle_rows[:-1], sampled.triangle, along, partners)


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


@dataclass(frozen=True)
class DrawnStretch:
    """A log stretch r at which lines are drawn, with width and depth times so much.

    per_step: codes for a mesh unit.  lean: depth is times 1 + this times where in its bin a line
    runs.
    """

    r: float
    width: float
    depth: float
    per_step: float = 0.0
    lean: float = 0.0


def _answer(response: ResponseSettings, r: float, narrow: float) -> tuple[float, ...]:
    """`answer` of shared_sizes.clh."""
    return response.alpha_d, r, scale(response, r, -response.alpha_d), narrow


def orientation_bins(segments: NDArray[np.float32], count: int) -> NDArray[np.uint8]:
    """The bin of each wrinkle (section 2.4): nearest, mod π, to θₙ = (sin(πn/N), cos(πn/N))."""
    angle = np.arctan2(segments[:, 2].astype(np.float64), segments[:, 3].astype(np.float64))
    return (np.rint(angle * (count / np.pi)).astype(np.int64) % count).astype(np.uint8)


def work_of(
    wrinkles: WrinkleArrays, pores: PoreArrays, events: EventArrays | None = None
) -> MapWork:
    """The work of drawing the wrinkles, pores and events of a UDIM."""
    lists = [wrinkles.lists, pores.lists, *(() if events is None else (events.lists,))]
    return MapWork(*lists, cushion=broad_lists(wrinkles))


def broad_lists(wrinkles: WrinkleArrays) -> tuple[CellLists, int] | None:
    """The lists of the broad layer and texels per sample of it; None where there is none."""
    broad = wrinkles.cushion
    return None if broad is None else (broad.lists, broad.factor)


def _with_none(rows: NDArray[np.int32] | None) -> NDArray[np.int32]:
    """Rows of a graph, and behind them -1 for none."""
    return np.append(np.zeros(0, np.int32) if rows is None else rows, np.int32(-1))


def _upload(device: Device, array: NDArray[Any] | None) -> Buffer | None:
    return None if array is None else device.upload(array)
