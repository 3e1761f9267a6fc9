"""Answers that were encoded, kept by their ETag while there is memory, so that many clients who ask
for a tile share the work and the bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future

from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.formats.tiles import Encoded

# The share of the budget of small answers that is kept, at most, and that one answer may have.
_KEPT, _LARGEST = 2, 32


class EncodedTiles:
    """Encoded tiles and maps. Safe from any thread.

    budget: what they are counted in. They leave it when a request waits for bytes of it.
    """

    def __init__(self, budget: ByteBudget) -> None:
        self._budget = budget
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, tuple[Encoded, Hold]] = OrderedDict()
        self._made: dict[str, Future[Encoded]] = {}
        self._nbytes = 0
        budget.on_shortage = self.clear

    def get(self, tag: str, make: Callable[[], Encoded]) -> Encoded:
        """The answer with this ETag, encoded by `make` unless it is kept. Who asks while another
        makes it waits for the same. Raises what `make` raises."""
        with self._lock:
            if (kept := self._kept.get(tag)) is not None:
                self._kept.move_to_end(tag)
                return kept[0]
            others = self._made.get(tag)
            mine = self._made[tag] = Future() if others is None else others
        if others is not None:
            return others.result()
        try:
            found = make()
            self._keep(tag, found)
        except BaseException as error:
            self._forget(tag)
            mine.set_exception(error)
            raise
        self._forget(tag)
        mine.set_result(found)
        return found

    def clear(self) -> None:
        """Let everything go."""
        with self._lock:
            holds = [hold for _, hold in self._kept.values()]
            self._kept.clear()
            self._nbytes = 0
        for hold in holds:
            hold.release()

    def _forget(self, tag: str) -> None:
        with self._lock:
            del self._made[tag]

    def _keep(self, tag: str, found: Encoded) -> None:
        """Keep an answer if there is room without waiting, and let those go that were used longest
        ago."""
        size = len(found.body)
        if size > self._budget.limit // _LARGEST:
            return
        left = []
        # Who begins to wait for bytes after they are taken finds the answer here, in `clear`.
        with self._lock:
            if (hold := self._budget.taken("encoded", size)) is None:
                return
            self._kept[tag] = found, hold
            self._nbytes += size
            while self._nbytes > self._budget.limit // _KEPT:
                _, (old, its) = self._kept.popitem(last=False)
                self._nbytes -= len(old.body)
                left.append(its)
        for its in left:
            its.release()
