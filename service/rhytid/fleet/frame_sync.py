"""Frames of the registry that a replica lacks, and those that the registry lacks."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from rhytid.domain.frame import NEUTRAL
from rhytid.engine.operations import Frames
from rhytid.errors import ConflictError, DeviceLostError, FrameMemoryError, NotFoundError
from rhytid.fleet.frame_registry import Positions, Stamp
from rhytid.fleet.frame_versions import ALL, Removals
from rhytid.fleet.remote_registry import RemoteFrameRegistry
from rhytid.processes.keyed_locks import KeyedLocks

# Seconds for which what the registry has said of an asset is taken as it was.
FRESH = 1.0
# Seconds for which a registry that did not answer is asked nothing: each call would wait for it.
AWAY = 3.0
# Seconds after which a frame that nobody used may go where there is no room.
IDLE = 60.0
T = TypeVar("T")
_log = logging.getLogger(__name__)


class RegistryFullError(FrameMemoryError):
    """The registry has no room for a frame; what a replica drops makes none."""

    def __init__(self, asset: str, name: str) -> None:
        super().__init__(
            f"frame {name} of {asset} does not fit into the memory for frames of all replicas "
            "(RHYTID_FRAME_MEMORY_MB for each): delete some"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return FrameMemoryError, self.args


@dataclass
class _Held:
    """A frame that the engine has.

    stamp: of the registry that has it, too; its life is empty where none has.  looked: when the
    engine had it as the registry had it.
    """

    stamp: Stamp
    looked: float = float("-inf")


class FrameSync:
    """Which version of each frame the engine of this replica has.

    A frame is fetched where the ingress knows of a newer one, or where the registry does: it is
    asked once a second for each asset that is in use. Where the engine has no room, frames of
    assets go that were not used of late: the registry has them. A registry that was started again
    is given the frames of the engine, by `exchange`, and the removals: no removed frame comes back.
    """

    def __init__(self, frames: Frames, registry: RemoteFrameRegistry) -> None:
        self._frames, self._registry = frames, registry
        self._held: dict[str, dict[str, _Held]] = {}
        self._removed = Removals()
        # The registry that was exchanged with last, and how many of its removals were heard.
        self._life, self._heard = "", 0
        self._away = -AWAY
        self._locks = KeyedLocks()
        self._lock = threading.Lock()

    def changing(self, asset: str) -> AbstractContextManager[None]:
        """Held while a frame of an asset is stored: the engine and the registry get them in one
        order."""
        return self._locks.holding(asset)

    def forget(self, asset: str) -> None:
        """The engine does not have the asset any more."""
        with self._lock:
            self._held.pop(asset, None)

    def only_here(self, asset: str) -> bool:
        """Whether the engine has frames of the asset that the registry is not known to have."""
        return bool(self._not_given(asset))

    def bring(self, asset: str, name: str, wanted: int) -> None:
        """See that the engine has a frame as it is now.  wanted: the version that there is at
        least, as far as the caller knows."""
        if name == NEUTRAL or self._good(asset, name, wanted):
            return

        def bring() -> None:
            with self.changing(asset):
                if not self._good(asset, name, wanted):  # it may have come while this one waited
                    self._fetch(asset, [name], wanted)

        self.with_room(asset, bring)

    def keep(self, asset: str, name: str, positions: Positions) -> int:
        """Give the registry a frame that the engine has taken; its version.

        Raises RegistryFullError where there is no room: the engine then fetches the frame that was
        there before. Raises DeviceLostError where the registry does not answer: it gets the frame
        later.
        """
        known = self._version(asset, name)
        try:
            stamp = self._registry.keep(asset, name, positions, known)
        except DeviceLostError:
            self._hold(asset, name, Stamp("", known + 1))
            raise
        if not stamp.version:
            self._drop(asset, name)
            raise RegistryFullError(asset, name)
        self._hold(asset, name, stamp)
        return stamp.version

    def remove(self, asset: str, name: str) -> int:
        """Remove a frame from the registry and from the engine, which has it as it is now; the
        version of its absence. To be called while `changing` is held."""
        # In this order: where the registry does not answer, nothing has changed. Where the engine
        # does not, the registry has the later version, so that the frame goes when it is asked for.
        version = self._registry.remove(asset, name, self._version(asset, name))
        with suppress(NotFoundError):
            self._frames.delete(asset, name)
        self._note_removal(asset, name, version)
        return version

    def remove_all(self, asset: str) -> None:
        """The asset was removed for all replicas, and its frames with it."""
        with self.changing(asset):
            held = self._held.get(asset, {}).values()
            known = max((one.stamp.version for one in held), default=0)
            try:
                version = self._registry.forget(asset, known)
            except DeviceLostError:
                version = max(time.time_ns(), known + 1)
                self._life = ""  # the registry is told with the next exchange
            self._note_removal(asset, ALL, version)

    def bring_all(self, asset: str) -> None:
        """See that the engine has every frame of an asset."""

        def bring() -> None:
            with self.changing(asset):
                self._fetch(asset, None, 0)

        self.with_room(asset, bring)

    def with_room(self, asset: str, work: Callable[[], T]) -> T:
        """Do work that puts frames of an asset into the engine, and return its result; frames of
        other assets go where there is no room. Not to be called while `changing` is held."""
        while True:
            try:
                return work()
            except FrameMemoryError as error:  # noqa: PERF203
                others = () if isinstance(error, RegistryFullError) else self._idle(asset)
                if not any(map(self._drop_unused, others)):
                    raise

    def exchange(self) -> None:
        """Hear what was removed, and give a registry that was started again what it lacks. To be
        called now and then, by one thread; raises DeviceLostError, after which it is done again."""
        news = self._registry.news(self._life, self._heard)
        for (asset, name), version in news.removed.items():
            self._hear_removal(asset, name, version)
        if news.life != self._life:
            with self._lock:
                removed, _ = self._removed.since(0)
            self._registry.remember(removed)
        if not news.whole:
            self._compare(news.life)
        self._life, self._heard = news.life, news.count
        for asset in list(self._held):
            self._give(asset)

    def _hear_removal(self, asset: str, name: str, version: int) -> None:
        for one in list(self._held.get(asset, {})) if name == ALL else [name]:
            with self.changing(asset):
                found = self._held.get(asset, {}).get(one)
                if found is not None and found.stamp.version < version:
                    self._drop(asset, one)
        with self._lock:
            self._removed.note(asset, name, version)

    def _compare(self, life: str) -> None:
        """Drop what the registry had and has no more: more was removed than it knows of."""
        for asset in list(self._held):
            with self.changing(asset):
                there = self._registry.versions(asset)
                for name, one in list(self._held.get(asset, {}).items()):
                    if one.stamp.life == life and name not in there:
                        self._drop(asset, name)

    def _give(self, asset: str) -> None:
        """Give the registry the frames of an asset that it lacks. A frame that the engine does not
        have yet is given later."""
        mine = self._not_given(asset)
        if not mine:
            return
        wanted = set(self._registry.missing(asset, mine))
        stored: set[str] = set()
        with suppress(NotFoundError, ConflictError):  # the asset is built, or has gone
            stored = {info.name for info in self._frames.all(asset)} if wanted else set()
        for name, version in mine.items():
            if (name in stored or name not in wanted) and not self._gave(
                asset, name, version, wanted=name in wanted
            ):
                _log.warning("the board has no room for frame %s of %s", name, asset)
                return

    def _gave(self, asset: str, name: str, version: int, *, wanted: bool) -> bool:
        """Give the registry a frame of this version, if it wants it; False where it has no room."""
        with self.changing(asset):
            held = self._held.get(asset, {}).get(name)
            if held is None or held.stamp.version != version:
                return True  # it has changed since
            if wanted:
                try:
                    positions = self._frames.positions(asset, name)
                except NotFoundError:
                    return True
                if not self._registry.give(asset, name, version, positions):
                    return False
            held.stamp = Stamp(self._life, version)
        return True

    def _not_given(self, asset: str) -> dict[str, int]:
        """By name, versions of the frames that were not given to the registry of now."""
        with self._lock:
            held = list(self._held.get(asset, {}).items())
        return {name: one.stamp.version for name, one in held if one.stamp.life != self._life}

    def _idle(self, asset: str) -> list[str]:
        """Other assets, none of whose frames was used of late; the least recently used first."""
        with self._lock:
            used = {
                name: max((one.looked for one in held.values()), default=0.0)
                for name, held in self._held.items()
                if name != asset
            }
        before = time.monotonic() - IDLE
        return sorted((name for name in used if used[name] < before), key=used.__getitem__)

    def _drop_unused(self, asset: str) -> bool:
        """Drop frames of an asset that the registry has; whether there were any."""
        with self.changing(asset):
            there = self._versions_there(asset)
            here = dict(self._held.get(asset, {}))
            known = [name for name, one in here.items() if there.get(name) == one.stamp.version]
            for name in known:
                self._drop(asset, name)
        return bool(known)

    def _fetch(self, asset: str, names: list[str] | None, wanted: int) -> None:
        try:
            there = self._versions_there(asset, names)
            for name in there if names is None else names:
                if there.get(name, 0) > self._version(asset, name):
                    self._take(asset, name)
                held = self._held.get(asset, {}).get(name)
                if held is not None:  # not names of frames that there are not
                    held.looked = time.monotonic()
        except DeviceLostError:
            if names is None or any(self._version(asset, name) < wanted for name in names):
                raise

    def _versions_there(self, asset: str, names: list[str] | None = None) -> dict[str, int]:
        if time.monotonic() - self._away < AWAY:
            raise DeviceLostError("the board of the fleet did not answer; try later")
        try:
            return self._registry.versions(asset, names)
        except DeviceLostError:
            self._away = time.monotonic()
            _log.warning("frames of %s are taken as they are here: no board answers", asset)
            raise

    def _take(self, asset: str, name: str) -> None:
        stamp, positions = self._registry.frame(asset, name)
        if positions is not None:
            self._frames.put(asset, name, positions)
            self._hold(asset, name, stamp)
        elif stamp.version:
            self._drop(asset, name)
            self._note_removal(asset, name, stamp.version)

    def _hold(self, asset: str, name: str, stamp: Stamp) -> None:
        """The engine has this version of a frame now."""
        with self._lock:
            self._removed.undo(asset, name)
            self._held.setdefault(asset, {})[name] = _Held(stamp, time.monotonic())

    def _note_removal(self, asset: str, name: str, version: int) -> None:
        """The engine has a frame no more, or with ALL none of the asset."""
        with self._lock:
            self._removed.note(asset, name, version)
            held = self._held.get(asset, {})
            held.pop(name, None)
            if name == ALL or not held:
                self._held.pop(asset, None)

    def _drop(self, asset: str, name: str) -> None:
        """Remove a frame from the engine alone."""
        with suppress(NotFoundError):
            self._frames.delete(asset, name)
        with self._lock:
            held = self._held.get(asset, {})
            held.pop(name, None)
            if not held:
                self._held.pop(asset, None)

    def _version(self, asset: str, name: str) -> int:
        """Of the frame that the engine has, or of its removal."""
        held = self._held.get(asset, {}).get(name)
        return self._removed.version(asset, name) if held is None else held.stamp.version

    def _good(self, asset: str, name: str, wanted: int) -> bool:
        held = self._held.get(asset, {}).get(name)
        if held is None or time.monotonic() - held.looked >= FRESH:
            return False
        return held.stamp.version >= max(wanted, 1)
