"""The devices of a server, and which asset is on which."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

from rhytid.device.memory import usual_frame_memory
from rhytid.errors import NoDeviceError
from rhytid.support.settings import ServiceSettings


class Placement:
    """The device of each asset; an asset stays where it was placed.

    limits: bytes that each device has. What assets take is their mesh and their wrinkles; maps and
    what is drawn are dropped where memory is short.
    """

    def __init__(self, limits: Sequence[int]) -> None:
        self._lock = threading.Lock()
        self._limits, self._room = [max(limit, 1) for limit in limits], list(limits)
        self._placed: dict[str, tuple[int, int]] = {}

    def place(self, asset: str, nbytes: int) -> tuple[int, bool]:
        """The device of an asset, and whether it is new: then it goes where most room is left, as a
        share of what the device has, so that equal ones take turns."""
        with self._lock:
            known = self._placed.get(asset)
            if known is not None:
                return known[0], False
            device = max(range(len(self._room)), key=self._free)
            self._placed[asset] = (device, nbytes)
            self._room[device] -= nbytes
            return device, True

    def _free(self, device: int) -> tuple[float, int, int]:
        room = self._room[device]
        return room / self._limits[device], room, -device

    def of(self, asset: str) -> int | None:
        """The device of an asset, if it has one."""
        found = self._placed.get(asset)
        return None if found is None else found[0]

    def forget(self, asset: str) -> None:
        """The asset is gone."""
        with self._lock:
            device, nbytes = self._placed.pop(asset, (0, 0))
            self._room[device] += nbytes

    def on(self, device: int) -> frozenset[str]:
        """The assets of a device."""
        with self._lock:
            return frozenset(asset for asset, (at, _) in self._placed.items() if at == device)


ALL = "all"
# Seconds that trying all devices may take.
_LONGEST = 300.0
_CODE = (
    "import sys; sys.path[:] = sys.argv[1].split(sys.argv[2]); "
    "from rhytid.processes.placement import print_devices; print_devices()"
)


@dataclass(frozen=True)
class FoundDevice:
    """A device that computes.  index: its number.  memory: bytes that are taken of it, where no
    setting says how many."""

    index: int
    name: str
    kind: str
    memory: int


def print_devices() -> None:
    """Print the devices of this process that compute, as JSON."""
    from rhytid.device.memory import usual_device_memory
    from rhytid.device.select import candidates, computes

    found = [
        FoundDevice(one.index, one.name, one.kind, usual_device_memory(one))
        for one in candidates()
        if computes(one)
    ]
    print(json.dumps([asdict(one) for one in found]))  # noqa: T201 the server reads it


def found_devices() -> list[FoundDevice]:
    """Every device that computes; raises NoDeviceError where there is none."""
    command = [sys.executable, "-c", _CODE, os.pathsep.join(sys.path), os.pathsep]
    try:
        output = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_LONGEST, check=True
        ).stdout
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        raise NoDeviceError(f"the devices cannot be tried: {error}") from error
    # Drivers print, too.
    found = [FoundDevice(**one) for one in json.loads(output.splitlines()[-1])]
    if not found:
        raise NoDeviceError("no OpenCL device here computes")
    return found


def named_devices(wanted: Sequence[str], found: Sequence[FoundDevice]) -> list[FoundDevice]:
    """Those of the devices that numbers or `all` name; raises NoDeviceError naming what is not
    there."""
    if tuple(wanted) == (ALL,):
        return list(found)
    by_number = {str(one.index): one for one in found}
    for number in wanted:
        if number not in by_number:
            there = ", ".join(f"{one.index}: {one.name}" for one in found)
            raise NoDeviceError(f"no device {number!r} that computes. There is {there}")
    return [by_number[number] for number in dict.fromkeys(wanted)]


def settings_of(
    device: FoundDevice, among: Sequence[FoundDevice], settings: ServiceSettings
) -> ServiceSettings:
    """The settings of one device among several: processors share the memory of the machine, and
    all devices that of frames and the disk."""
    cpus = sum(one.kind == "cpu" for one in among)
    share = device.memory // cpus if device.kind == "cpu" else device.memory
    frames = settings.frame_memory or usual_frame_memory()
    limit = settings.store_limit
    return replace(
        settings,
        device=str(device.index),
        device_memory=settings.device_memory or share,
        frame_memory=frames // len(among),
        store_limit=None if limit is None else limit // len(among),
    )
