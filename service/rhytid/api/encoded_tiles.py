"""Answers that were encoded, kept by their ETag while there is memory, so that many clients who ask
for a tile share the work and the bytes; and what was asked for, so that the engine is not asked
again."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import NamedTuple

from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.changes import Mark
from rhytid.engine.messages import MapQuery
from rhytid.formats.tiles import Encoded

# The share of the budget of small answers that is kept, at most, and that one answer may have.
_KEPT, _LARGEST = 2, 32
# What was asked for that is remembered.
_ASKED = 10_000


class Asked(NamedTuple):
    """What a request for displacement names."""

    format: str
    asset: str
    frame: str
    query: MapQuery
    place: TileAddress | MapAddress


@dataclass(frozen=True)
class Known:
    """What is answered to it as long as the engine gives the same mark.

    validators: headers of every answer, the ETag among them.  about: headers of those with a body
    or to HEAD.
    """

    mark: Mark
    validators: Mapping[str, str]
    about: Mapping[str, str]


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
        self._known: OrderedDict[Asked, Known] = OrderedDict()
        budget.on_shortage = self.clear

    def note(self, asked: Asked, known: Known) -> None:
        """Remember what is answered to a request. The mark is from before the engine was asked."""
        if not known.mark.settled:
            return
        with self._lock:
            self._known[asked] = known
            self._known.move_to_end(asked)
            if len(self._known) > _ASKED:
                self._known.popitem(last=False)

    def known(self, asked: Asked, mark: Mark | None) -> Known | None:
        """What is answered to a request, where that is certain with the mark that the engine gives
        now."""
        found = self._known.get(asked)
        return found if found is not None and found.mark == mark else None

    def kept(self, tag: str) -> Encoded | None:
        """The answer with this ETag, where it is kept."""
        with self._lock:
            if (kept := self._kept.get(tag)) is None:
                return None
            self._kept.move_to_end(tag)
            return kept[0]

    def get(self, tag: str, make: Callable[[], Encoded]) -> Encoded:
        """The answer with this ETag, encoded by `make` unless it is kept. Who asks while another
        makes it waits for the same. Raises what `make` raises."""
        if (kept := self.kept(tag)) is not None:
            return kept
        with self._lock:
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
