"""What gives out first as devices are added: what each device asks of what all of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rhytid.errors import InputError
from rhytid_lab.scaling.model import Head, Model

_FLOAT = 4  # bytes of a texel of an answer by `npy`
_POSITION = 12  # bytes of a vertex of a frame


@dataclass(frozen=True)
class Limits:
    """What devices share.  All of these are assumptions, to be replaced by your own.

    store_write, store_read: bytes per second of the file system or the object store.
    ingress_bytes: per second of one machine that answers requests.
    chunks: that a scheduler hands out per second.
    """

    store_write: float = 10e9
    store_read: float = 20e9
    ingress_bytes: float = 12.5e9
    chunks: float = 100.0


@dataclass(frozen=True)
class Shared:
    """Something that devices share.

    per_device: what one asks of it.  capacity: what it has, in the same `unit`.
    """

    name: str
    unit: str
    per_device: float
    capacity: float

    @property
    def full_at(self) -> float:
        """Devices that use all of it."""
        return self.capacity / self.per_device if self.per_device > 0.0 else float("inf")

    def used(self, devices: int) -> float:
        """The share that so many devices use; above 1 they wait."""
        return devices / self.full_at


def full(shared: Sequence[Shared], devices: int) -> list[Shared]:
    """What so many devices use up, that first which gives out first."""
    used_up = [one for one in shared if one.used(devices) > 1.0]
    return sorted(used_up, key=lambda one: one.full_at)


def film(
    model: Model, head: Head, method: str, processes: int, chunk: int, vertices: int, limits: Limits
) -> list[Shared]:
    """What a device asks for while it bakes chunks of `chunk` frames by `processes`."""
    rate = model.rate(head, method, processes)
    written, asked = rate * model.file_bytes(head), rate * vertices * _POSITION
    return [
        Shared("writing to the store", "B/s", written, limits.store_write),
        Shared("reading frames", "B/s", asked, limits.store_read),
        Shared("handing out chunks", "1/s", rate / chunk, limits.chunks),
    ]


@dataclass(frozen=True)
class Service:
    """A service that answers tiles.

    tile: texels per side.  used: share of its time that a device draws.  requests: that one
    process answers per second.  misses: share of the requests that load an asset.
    """

    head: Head
    method: str
    tile: int
    used: float
    requests: float
    misses: float

    def rate(self, model: Model) -> float:
        """Tiles per second of one device: drawn, and answered by the process it belongs to."""
        if not 0.0 < self.used <= 1.0:
            raise InputError(f"used is {self.used}: above 0, at most 1")
        drawn = self.head.texels / self.tile**2 / model.draw(self.head, self.method)
        return self.used * min(drawn, self.requests)

    def shared(self, model: Model, limits: Limits) -> list[Shared]:
        """What a device asks for, where one machine and one process of it take all requests."""
        rate = self.rate(model)
        answered = rate * self.tile**2 * _FLOAT
        loaded = rate * self.misses * model.asset_bytes(self.head)
        return [
            Shared("one process that passes requests on", "1/s", rate, self.requests),
            Shared("network of one machine in front", "B/s", answered, limits.ingress_bytes),
            Shared("reading assets from the store", "B/s", loaded, limits.store_read),
        ]
