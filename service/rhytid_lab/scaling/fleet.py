"""A simulation of many devices that hold few heads each: who waits how long, and what is loaded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid_lab.scaling.lru import Held
from rhytid_lab.scaling.policies import BoundedLoads, Modulo, Policy, Rendezvous, Replicated
from rhytid_lab.scaling.usage import Requests, zipf_requests


@dataclass(frozen=True)
class Fleet:
    """Devices and what they are asked.

    held: heads that a device holds.  work: seconds of a request.  load: seconds to load a head,
    during which its device does nothing else.  used: work over time of all devices, without loads.
    exponent: of Zipf's law.
    """

    devices: int = 1000
    heads: int = 10_000
    held: int = 20
    work: float = 0.1
    load: float = 1.0
    used: float = 0.5
    exponent: float = 1.0

    @property
    def rate(self) -> float:
        """Requests per second."""
        return self.used * self.devices / self.work

    def requests(self, count: int, seed: int = 1) -> Requests:
        """So many of them; the same for the same seed."""
        return zipf_requests(count, self.rate, self.heads, self.exponent, seed)

    def policies(self) -> list[Policy]:
        """What is compared."""
        return [
            Modulo(self.devices),
            Rendezvous(self.devices),
            BoundedLoads(self.devices, self.load),
            BoundedLoads(self.devices, 3.0 * self.load),
            Replicated(self.devices, self.work, 0.2, 10.0),
        ]


@dataclass(frozen=True)
class Outcome:
    """What came of a policy, once a part of the requests had gone before.

    hits: share of requests whose head was there.  balance: work of the busiest device over the
    mean, loads included.  median, p99: seconds that a request waits, its load included and its work
    not.  loads: heads that were loaded, per second.
    """

    policy: str
    hits: float
    balance: float
    median: float
    p99: float
    loads: float


def simulate(fleet: Fleet, policy: Policy, requests: Requests, warm: float = 0.5) -> Outcome:
    """Serve requests in their order, each device one after the other.

    warm: share of the requests that do not count, until queues are as long as they get.
    """
    free = [0.0] * fleet.devices
    busy = np.zeros(fleet.devices)
    kept = _filled(fleet, policy)
    first = int(warm * len(requests.times))
    waits = np.zeros(len(requests.times) - first)
    missed = 0
    now = 0.0

    def waiting(device: int) -> float:
        return max(free[device] - now, 0.0)

    pairs = zip(requests.times.tolist(), requests.heads.tolist(), strict=True)
    for turn, (now, head) in enumerate(pairs):
        device = policy.choose(head, now, waiting)
        there = kept[device].use(head)
        begin = max(free[device], now) + (0.0 if there else fleet.load)
        free[device] = begin + fleet.work
        if turn >= first:
            waits[turn - first] = begin - now
            busy[device] += fleet.work + (0.0 if there else fleet.load)
            missed += not there
    span = requests.times[-1] - requests.times[first]
    median, p99 = np.percentile(waits, (50, 99))
    return Outcome(
        policy.name,
        1.0 - missed / len(waits),
        float(busy.max() / busy.mean()),
        float(median),
        float(p99),
        float(missed / span),
    )


def _filled(fleet: Fleet, policy: Policy) -> list[Held]:
    """Devices that hold heads where an idle fleet would have them, the most used ones if not all
    fit: a fleet that has been used for long, and not one that was just started."""
    kept = [Held(fleet.held) for _ in range(fleet.devices)]
    for head in reversed(range(fleet.heads)):
        kept[policy.home(head)].use(head)
    return kept


def compare(fleet: Fleet, count: int, seed: int = 1) -> list[Outcome]:
    """Every policy with the same requests."""
    requests = fleet.requests(count, seed)
    return [simulate(fleet, policy, requests) for policy in fleet.policies()]
