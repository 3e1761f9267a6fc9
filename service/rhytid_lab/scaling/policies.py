"""Where a request goes: policies of placement that a simulation compares."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from rhytid_lab.scaling.hashing import modulo, preference

# Devices of a head's order that are ever looked at.
_MOST = 128


class Policy(Protocol):
    """Chooses a device for a request."""

    @property
    def name(self) -> str:
        """As tables call it."""

    def home(self, head: int) -> int:
        """The device of a head that is used little."""

    def choose(self, head: int, now: float, waits: Callable[[int], float]) -> int:
        """The device of a request for `head` at `now`; waits: seconds of work that a device has
        before it."""


class Modulo:
    """Each head on one device, by its id modulo their number."""

    name = "id mod N"

    def __init__(self, devices: int) -> None:
        self._devices = range(devices)
        self._known: dict[int, int] = {}

    def choose(self, head: int, now: float, waits: Callable[[int], float]) -> int:
        """The device of the head."""
        return self.home(head)

    def home(self, head: int) -> int:
        """The device of the head."""
        if head not in self._known:
            self._known[head] = modulo(head, self._devices)
        return self._known[head]


class _Ordered:
    """Remembers the order of devices of each head."""

    def __init__(self, devices: int) -> None:
        self._devices = range(devices)
        self._known: dict[int, list[int]] = {}

    def order(self, head: int) -> list[int]:
        """The first devices that a head prefers."""
        if head not in self._known:
            self._known[head] = preference(head, self._devices, _MOST)
        return self._known[head]

    def home(self, head: int) -> int:
        """The device that a head prefers."""
        return self.order(head)[0]


class Rendezvous(_Ordered):
    """Each head on the device that it prefers."""

    name = "rendezvous"

    def choose(self, head: int, now: float, waits: Callable[[int], float]) -> int:
        """The device of the head."""
        return self.home(head)


class BoundedLoads(_Ordered):
    """The first device of the head's order that has less than `bound` seconds of work to do
    (consistent hashing with bounded loads, Mirrokni and others 2018, with a bound of time in place
    of a share of the mean)."""

    def __init__(self, devices: int, bound: float) -> None:
        super().__init__(devices)
        self.name = f"rendezvous, at most {bound:g} s of work"
        self._bound = bound

    def choose(self, head: int, now: float, waits: Callable[[int], float]) -> int:
        """The device that is not full, or else the one of the order with the least to do."""
        order = self.order(head)
        free = next((device for device in order if waits(device) < self._bound), None)
        return min(order, key=waits) if free is None else free


class Replicated(_Ordered):
    """Hot heads on as many devices as their rate needs, and each request to the better of two of
    them (Mitzenmacher 2001), at most `_MOST`.

    work: seconds of a request.  used: share of a device that one head may take.  memory: seconds
    over which a rate is measured.
    """

    name = "rendezvous, hot heads replicated"

    def __init__(self, devices: int, work: float, used: float, memory: float) -> None:
        super().__init__(devices)
        self._work, self._used, self._memory = work, used, memory
        self._rates: dict[int, tuple[float, float]] = {}
        self._turn = 0

    def choose(self, head: int, now: float, waits: Callable[[int], float]) -> int:
        """The one with less to do, of two of the head's devices that take turns."""
        count = self._replicas(head, now)
        order = self.order(head)
        if count == 1:
            return order[0]
        self._turn += 1
        first, step = self._turn % count, 1 + self._turn // count % (count - 1)
        return _lesser(order, first, (first + step) % count, waits)

    def _replicas(self, head: int, now: float) -> int:
        """Devices for a head, by a rate that old requests count less and less for."""
        rate, last = self._rates.get(head, (0.0, now))
        rate = rate * math.exp((last - now) / self._memory) + 1.0 / self._memory
        self._rates[head] = rate, now
        return min(max(math.ceil(rate * self._work / self._used), 1), _MOST, len(self._devices))


def _lesser(order: Sequence[int], one: int, other: int, waits: Callable[[int], float]) -> int:
    return order[one] if waits(order[one]) <= waits(order[other]) else order[other]
