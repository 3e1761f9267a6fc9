"""Calls to replicas, made again where a replica is lost."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from ray.exceptions import ObjectLostError, RayActorError, RayError, WorkerCrashedError
from ray.serve.exceptions import BackPressureError, RayServeException

from rhytid.engine import call_context
from rhytid.engine.assets.upload import content_id
from rhytid.engine.messages import NewAsset
from rhytid.errors import BusyError, CancelledError, DeviceLostError
from rhytid.fleet.envelopes import Addressed, ElsewhereError
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.jobs import JobNames
from rhytid.processes.device_process import DeviceProcess
from rhytid.processes.envelope import Answer, Request
from rhytid.storage.homes import checked_id

# How often a call is made in all, where its replica is lost each time.
SENT = 5
# Seconds between two looks whether somebody still waits, and until it is asked whether there are
# replicas at all.
LOOK, PATIENCE = 0.2, 15.0
_LOST = (RayActorError, ObjectLostError, WorkerCrashedError)
_log = logging.getLogger(__name__)


class FleetCaller:
    """Carries calls to replicas of Ray, and makes them again where a replica is lost.

    handle: of the deployment of the replicas.  present: whether any has reported of late.
    """

    def __init__(
        self,
        handle: Any,
        versions: FrameVersions,
        names: JobNames,
        present: Callable[[], bool],
    ) -> None:
        self._handle, self._versions, self._present = handle, versions, present
        self._names = names
        self._lock = threading.Lock()
        self.waiting = 0
        # Actors of replicas that were lost with a call of this ingress.
        self._gone: set[str] = set()

    def call(self, request: Request, prepare: Callable[[DeviceProcess], None] | None = None) -> Any:
        """As `Supervisors.call`; replicas see to frames and assets, so that nothing is prepared."""
        with self._lock:
            self.waiting += 1
        try:
            return self._called(request)
        finally:
            with self._lock:
                self.waiting -= 1

    @property
    def lost(self) -> int:
        """Replicas that ended while they worked on a call of this ingress."""
        return len(self._gone)

    def forget(self, asset: str) -> None:
        """Nothing: processes of the replicas keep what was refused."""

    def _called(self, request: Request) -> Any:
        request.sent += 1
        asset, to = self._place(request)
        for _ in range(SENT):
            try:
                return self._opened(request, self._sent(self._addressed(request, asset, to)))
            except ElsewhereError as error:  # noqa: PERF203
                to = error.replica
            except _LOST as error:
                request.sent += 1
                self._gone.add(str(getattr(error, "actor_id", "")))
                reason = type(error).__name__
                _log.warning("%s is sent again: its replica is lost (%s)", request, reason)
        raise DeviceLostError(f"{request}: its replica ended {SENT} times; try later")

    def _place(self, request: Request) -> tuple[str, str]:
        """The asset that a call is about, and the replica that is asked; empty where it is none.
        Raises NotFoundError for what is no id: it would become the name of a file."""
        if request.operation.addresses == "content":
            content = request.positional[0]
            return content_id(content) if isinstance(content, NewAsset) else content.asset, ""
        if request.operation.addresses == "job":
            job = self._names.read(request.positional[0])
            return job.asset, job.replica
        return request.asset and checked_id(request.asset), ""

    def _addressed(self, request: Request, asset: str, to: str) -> Addressed:
        if request.frame:
            request.version = self._versions.version(asset, request.frame)
        # Packed for each way: what is asked for may have another version by then.
        return Addressed.of(request.envelope, asset, to)

    def _sent(self, call: Addressed) -> Answer:
        response: Any = None
        began = time.monotonic()
        while True:
            try:
                if response is None:
                    response = self._handle.call.remote(call)
                answer: Answer = response.result(timeout_s=LOOK).open()
                return answer
            except TimeoutError:  # noqa: PERF203
                began = self._still_wanted(response, began)
            except BackPressureError as error:
                raise BusyError("too many calls wait for the replicas") from error
            except _LOST:
                raise
            except (RayError, RayServeException) as error:
                raise DeviceLostError(f"the fleet does not answer: {error}") from error

    def _still_wanted(self, response: Any, began: float) -> float:
        """When the wait began, or now; raises CancelledError where nobody waits any more, and
        DeviceLostError where there is no replica."""
        try:
            call_context.check_abandoned()
            if time.monotonic() - began > PATIENCE:
                began = time.monotonic()
                if not self._present():
                    raise DeviceLostError("no replica is running; try later")
        except (CancelledError, DeviceLostError):
            response.cancel()
            raise
        return began

    def _opened(self, request: Request, answer: Answer) -> Any:
        if answer.version:
            removed = request.operation.effect == "remove"
            self._versions.note(request.asset, request.frame, answer.version, removed=removed)
        return answer.open()
