"""What frames cost: seconds of devices and hosts, bytes and money, as a formula.

    frame = put + draw + beyond + texels · write
    draw  = a · texels + b · wrinkles        by redraw
          = c · texels                       by binned
    once  = start + load · wrinkles, and by binned the precomputed maps
    bake  = once + ⌈frames / workers⌉ · frame

The constants are those of `Constants`. What the model leaves out: workers that share memory, a
processor or a disk slow each other down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rhytid.errors import InputError
from rhytid_lab.scaling.constants import Constants

METHODS = ("redraw", "binned")
_HOUR = 3600.0


@dataclass(frozen=True)
class Head:
    """A head as it is drawn.  size: texels per side of a map.  wrinkles: in all UDIMs."""

    size: int
    wrinkles: int
    udims: int = 1

    @property
    def texels(self) -> int:
        """Of all maps of a frame."""
        return self.udims * self.size**2


@dataclass(frozen=True)
class Cost:
    """Of a job.

    seconds: from its start to its end.  device_seconds: that devices are held, all together.
    nbytes: written.  money: in the unit of the price.  frame_money: of one frame.
    """

    seconds: float
    device_seconds: float
    nbytes: float
    money: float
    frame_money: float


@dataclass(frozen=True)
class Model:
    """The formula with the constants of one kind of device and host."""

    constants: Constants

    def draw(self, head: Head, method: str) -> float:
        """Seconds that the device is busy with a frame, without its stretch."""
        known = self.constants
        if method == "binned":
            return known.binned * head.texels
        return _plane(known.redraw, head)

    def frame(self, head: Head, method: str) -> float:
        """Seconds of a frame in one process, from its positions to its file."""
        return self.host(head) + self.draw(head, method)

    def host(self, head: Head) -> float:
        """Seconds of a frame in which one core of the host is busy, and the device need not be."""
        known = self.constants
        return known.put + known.beyond + known.write * head.texels

    def once(self, head: Head, method: str) -> float:
        """Seconds of a process before its first frame."""
        if method not in METHODS:
            raise InputError(f"method {method!r}: one of {', '.join(METHODS)}")
        fixed, of_wrinkle = self.constants.start
        ahead = _plane(self.constants.precompute, head) if method == "binned" else 0.0
        return fixed + of_wrinkle * head.wrinkles + ahead

    def bake(self, head: Head, method: str, frames: int, workers: int = 1) -> float:
        """Seconds in which so many workers, with a device each, write the frames of one head."""
        longest = math.ceil(frames / _positive(workers, "workers"))
        return self.once(head, method) + longest * self.frame(head, method)

    def rate(self, head: Head, method: str, processes: int = 1) -> float:
        """Frames per second of one device that so many processes share, with a core each: until the
        device itself is full they draw while others write."""
        own = _positive(processes, "processes") / self.frame(head, method)
        return min(own, 1.0 / self.draw(head, method))

    def file_bytes(self, head: Head) -> float:
        """Bytes of the files of a frame."""
        return self.constants.file_bytes * head.texels

    def asset_bytes(self, head: Head) -> float:
        """Bytes of a head in the store."""
        return self.constants.asset_bytes * head.wrinkles

    def job(
        self,
        head: Head,
        method: str,
        frames: int,
        *,
        heads: int = 1,
        devices: int = 1,
        processes: int = 1,
        price: float = 1.0,
        store: float = math.inf,
    ) -> Cost:
        """What `frames` of each of `heads` cost, on `devices` that `processes` share each.

        price: of one device and its host for an hour.  store: bytes per second that all devices
        together may write.
        """
        count = _positive(frames, "frames") * _positive(heads, "heads")
        workers = _positive(devices, "devices") * processes
        # A worker changes heads no more often than it must: all its frames but few are of one.
        changes = max(math.ceil(heads / workers), 1)
        drawn = count / (self.rate(head, method, processes) * devices)
        nbytes = count * self.file_bytes(head)
        seconds = changes * self.once(head, method) + max(drawn, nbytes / store)
        money = devices * seconds * price / _HOUR
        return Cost(seconds, devices * seconds, nbytes, money, money / count)


def _plane(constants: tuple[float, float], head: Head) -> float:
    return constants[0] * head.texels + constants[1] * head.wrinkles


def _positive(count: int, name: str) -> int:
    if count < 1:
        raise InputError(f"{name} is {count}: at least 1")
    return count
