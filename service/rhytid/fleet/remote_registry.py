"""The frame registry as an actor of Ray, asked from a thread of an ingress or a replica."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import TimeoutError as FutureTimeout
from contextlib import suppress
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import ray
from ray.exceptions import ActorDiedError, RayError

from rhytid.errors import DeviceLostError
from rhytid.fleet.frame_registry import PRESENT, FrameRegistry, Positions, Report, Stamp

# Seconds for an answer.
PATIENCE = 10.0
# Seconds after which a registry ends that nobody asks any more: its fleet is gone.
LEFT = 600.0
# Of the names of registries. The number is that of the calls of `FrameRegistry`: an update of a
# fleet keeps its registry where both versions of this package have the same.
NAMESPACE = "rhytid-2"
# Seconds between two times that the registry is asked.
LOOK = 1.0
P = ParamSpec("P")
T = TypeVar("T")
_log = logging.getLogger(__name__)


class FrameRegistryActor(FrameRegistry):
    """A registry in a process of its own, which ends when nobody has asked it for long.

    left: seconds.
    """

    def __init__(self, left: float) -> None:
        super().__init__()
        self._left, self._asked = left, time.monotonic()
        threading.Thread(target=self._end_when_left, name="rhytid-left", daemon=True).start()

    async def reports(self) -> list[Report]:
        """As of `FrameRegistry`; every ingress asks once a second."""
        self._asked = time.monotonic()
        return await super().reports()

    async def report(self, report: Report) -> None:
        """As of `FrameRegistry`; every replica reports."""
        self._asked = time.monotonic()
        await super().report(report)

    def _end_when_left(self) -> None:
        while (rest := self._asked + self._left - time.monotonic()) > 0:
            time.sleep(rest)
        # Not by an exit of the process, after which Ray would start it again.
        ray.kill(ray.get_runtime_context().current_actor)


def _call(
    call: Callable[Concatenate[Any, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[RemoteFrameRegistry, P], T]:
    """The method that asks the registry what one of `FrameRegistry` answers."""

    @wraps(call)
    def asked(self: RemoteFrameRegistry, /, *arguments: P.args, **named: P.kwargs) -> T:
        found: T = self._ask(call.__name__, *arguments, **named)
        return found

    made: Callable[Concatenate[RemoteFrameRegistry, P], T] = cast(Any, asked)
    return made


class RemoteFrameRegistry:
    """The calls of `FrameRegistry`; each raises DeviceLostError where it does not answer.

    The registry is an actor of its own: a deployment of Ray Serve would be started again with every
    change of the application, and frames would be lost. The process that asks first starts it;
    where the process of the registry ends, Ray starts it again.

    application: of Ray Serve, whose registry it is.  limit: bytes of positions of all frames.
    left: seconds as of `FrameRegistryActor`, of a registry that is started.
    """

    def __init__(self, application: str, limit: int = 0, left: float = LEFT) -> None:
        self._application, self._limit, self._left = application, limit, left
        self._lock = threading.Lock()
        self._known: Any = None

    missing = _call(FrameRegistry.missing)
    remove = _call(FrameRegistry.remove)
    forget = _call(FrameRegistry.forget)
    remember = _call(FrameRegistry.remember)
    news = _call(FrameRegistry.news)
    versions = _call(FrameRegistry.versions)
    frame = _call(FrameRegistry.frame)
    report = _call(FrameRegistry.report)
    reports = _call(FrameRegistry.reports)

    def keep(self, asset: str, name: str, positions: Positions, after: int) -> Stamp:
        """As `FrameRegistry.keep`, within the limit."""
        found: Stamp = self._ask("keep", asset, name, positions, self._limit, after)
        return found

    def give(self, asset: str, name: str, version: int, positions: Positions) -> str:
        """As `FrameRegistry.give`, within the limit."""
        found: str = self._ask("give", asset, name, version, positions, self._limit)
        return found

    def end(self) -> None:
        """End the registry, and lose what it has: the fleet ends."""
        with suppress(ValueError, RayError):  # there is none
            ray.kill(ray.get_actor(self._application, namespace=NAMESPACE))

    def _ask(self, name: str, *arguments: Any, **named: Any) -> Any:
        try:
            try:
                return self._asked(name, arguments, named)
            except ActorDiedError:  # it had ended itself; another is started
                with self._lock:
                    self._known = None
                return self._asked(name, arguments, named)
        except (RayError, TimeoutError, FutureTimeout) as error:
            raise DeviceLostError("the board of the fleet does not answer; try later") from error

    def _asked(self, name: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        answer = getattr(self._registry(), name).remote(*arguments, **named)
        try:
            return answer.future().result(PATIENCE)
        except (TimeoutError, FutureTimeout):
            ray.cancel(answer)
            raise

    def _registry(self) -> Any:
        with self._lock:
            if self._known is None:
                actor: Any = ray.remote(FrameRegistryActor)
                made = actor.options(
                    name=self._application,
                    namespace=NAMESPACE,
                    get_if_exists=True,
                    lifetime="detached",  # it outlives the replica that has started it
                    max_restarts=-1,
                    num_cpus=0,
                )
                self._known = made.remote(self._left)
            return self._known


class ReplicaReports:
    """The reports of the replicas, asked for once a second by a thread of its own: figures are read
    where nothing may block."""

    def __init__(self, registry: RemoteFrameRegistry) -> None:
        self._registry = registry
        self._closing = threading.Event()
        self._heard: tuple[float, list[Report]] = (0.0, [])
        self._thread = threading.Thread(target=self._run, name="rhytid-presence", daemon=True)
        self._thread.start()

    @property
    def reports(self) -> list[Report]:
        """Of the replicas that are there; none where the registry has not answered for long."""
        at, reports = self._heard
        return reports if time.monotonic() - at < PRESENT else []

    def look(self) -> list[Report]:
        """As `reports`, asked for now; what was heard before where the registry does not answer."""
        with suppress(DeviceLostError):
            self._heard = (time.monotonic(), self._registry.reports())
        return self.reports

    def close(self) -> None:
        """Ask no more."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._closing.is_set():
            self.look()
            self._closing.wait(LOOK)
