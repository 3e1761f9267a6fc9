"""What ended the process of the device, so that it does not do so again and again."""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass

from rhytid.engine.messages import Refusal
from rhytid.engine_process.ending import Ending
from rhytid.engine_process.envelope import Request
from rhytid.errors import FatalRequestError

# Endings after which the same is refused.
STRIKES = 2
# Seconds of a refusal whose last ending was a call of the driver that took too long, twice as many
# after each further one: the machine may have been busy, or asleep.
LATE, LONGEST_LATE = 600.0, 86_400.0
_REMEMBERED = 1000


@dataclass
class _Record:
    asset: str
    refusal: Refusal | None = None
    strikes: int = 0

    def strike(self, what: str, ending: Ending) -> None:
        self.strikes += 1
        if self.strikes < STRIKES:
            return
        reason = (
            f"the process of the device ended {self.strikes} times while it worked on {what}: "
            f"{ending.reason}"
        )
        until = math.inf
        if ending.kind == "late":
            seconds = min(LATE * 2 ** min(self.strikes - STRIKES, 10), LONGEST_LATE)
            until = time.monotonic() + seconds
            reason += f"; it may be tried again after {seconds / 60:.0f} minutes"
        self.refusal = Refusal(reason, until)


class Refusals:
    """Counts, by what was asked for, how often the process ended meanwhile."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # Names of calls that the process ended at: of others no digest has to be made.
        self._names: set[str] = set()
        self._requests: OrderedDict[str, _Record] = OrderedDict()
        self._builds: dict[str, _Record] = {}

    def check(self, request: Request) -> None:
        """Raise FatalRequestError where the process ended twice at such a request."""
        if request.operation.name not in self._names:
            return
        with self._lock:
            record = self._requests.get(request.digest)
        refusal = None if record is None else record.refusal
        if refusal is not None and refusal.holds:
            raise FatalRequestError(refusal.reason)

    def strike(self, request: Request, ending: Ending) -> None:
        """The process ended at this request."""
        with self._lock:
            self._names.add(request.operation.name)
            record = self._requests.setdefault(request.digest, _Record(request.asset))
            record.strike("this request", ending)
            self._requests.move_to_end(request.digest)
            while len(self._requests) > _REMEMBERED:
                self._requests.popitem(last=False)

    def strike_build(self, asset: str, ending: Ending) -> None:
        """The process ended at a job of an asset."""
        with self._lock:
            self._builds.setdefault(asset, _Record(asset)).strike("its build", ending)

    def absolve(self, request: Request) -> None:
        """The request was answered."""
        if request.operation.name in self._names:
            with self._lock:
                self._requests.pop(request.digest, None)

    def forget(self, asset: str) -> None:
        """The asset was changed or removed: what is asked of it may be tried again."""
        with self._lock:
            self._builds.pop(asset, None)
            for digest in [d for d, record in self._requests.items() if record.asset == asset]:
                del self._requests[digest]

    def builds(self) -> dict[str, Refusal]:
        """Ids of assets that are not to be built, and why."""
        with self._lock:
            found = {asset: record.refusal for asset, record in self._builds.items()}
        return {asset: one for asset, one in found.items() if one is not None and one.holds}
