"""Calls to an engine elsewhere, and what the caller keeps of them: it outlives that engine."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from rhytid.domain.frame import counted_frame
from rhytid.engine import call_context
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.frames import Frame, UnknownFrameError
from rhytid.engine.messages import AssetInfo, FollowedAsset, JobInfo, NewAsset
from rhytid.engine.operation import Operation
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import DeviceLostError, NotFoundError
from rhytid.processes.device_process import DeviceProcess
from rhytid.processes.envelope import Envelope, Request, Transport
from rhytid.processes.frame_ledger import FrameLedger, Positions
from rhytid.processes.job_ledger import JobLedger, resumed


class UploadHolds:
    """The bytes of frames that came with uploads, until the job that stores them has ended."""

    def __init__(self, memory: ByteBudget) -> None:
        self._memory = memory
        self._lock = threading.Lock()
        self._holds: dict[int, Hold] = {}
        self._sent: dict[int, object] = {}

    def take(self, number: int, nbytes: int, counted: Hold | None) -> None:
        """Hold so many bytes for the call of that number, as far as `counted` has any out of it.
        Raises HostBusyError and HostMemoryError."""
        hold = self._memory.hold("jobs") if counted is None else counted.split("jobs", nbytes)
        try:
            hold.grow(nbytes - hold.nbytes)
        except BaseException:
            hold.release()
            raise
        with self._lock:
            self._holds[number] = hold

    def sent(self, number: int, process: object) -> None:
        """The frames went to a process."""
        with self._lock:
            self._sent[number] = process

    def release(self, number: int) -> None:
        """The job has ended."""
        with self._lock:
            self._sent.pop(number, None)
            hold = self._holds.pop(number, None)
        if hold is not None:
            hold.release()

    def release_of(self, process: object) -> None:
        """A process has ended, and with it all of its jobs."""
        with self._lock:
            numbers = [number for number, to in self._sent.items() if to is process]
        for number in numbers:
            self.release(number)


# Answers that stay the same, and frames that were sent without being stored, that are remembered.
_CONSTANTS, _SENT_FRAMES = 10_000, 64


class RemoteCalls:
    """Makes the calls of an engine over a transport.

    Frames, jobs and the bytes of uploads are kept on this side: an engine that is started anew gets
    the frames again, and a job is found under its old id. What a call does to that follows from the
    row of its operation.

    own: operations that are done on this side, by name.
    """

    def __init__(
        self,
        transport: Transport,
        frames: FrameLedger,
        jobs: JobLedger,
        uploads: UploadHolds,
        own: Mapping[str, Callable[..., Any]] = MappingProxyType({}),
    ) -> None:
        self._transport, self._frames, self._jobs = transport, frames, jobs
        self._uploads, self._own = uploads, own
        self._constants: OrderedDict[tuple[str, str], Any] = OrderedDict()
        # Digests of frames that the other side has got, most likely.
        self._sent: OrderedDict[str, None] = OrderedDict()
        self._ways: dict[tuple[str, str], Callable[[Request], Any]] = {
            ("content", "create"): self._create,
            ("asset", "change"): self._change,
            ("asset", "remove"): self._remove,
            ("asset", "drop"): self._drop,
            ("frames", "read"): self._read_frames,
            ("frame", "read"): self._read_frames,
            ("frame", "change"): self._put_frame,
            ("frame", "remove"): self._delete_frame,
            ("job", "read"): self._job,
            ("job", "change"): self._cancel,
        }

    def __call__(self, operation: Operation, *positional: Any, **named: Any) -> Any:
        """The answer of the engine; raises what it raises, and what the transport does."""
        positional, named = operation.placed(positional, named)
        if operation.name in self._own:
            return self._noted(self._own[operation.name](*positional, **named))
        if operation.constant:
            return self._constant(operation, *positional)
        request = Request(operation, positional, named, hold=named.pop("hold", None))
        way = self._ways.get((operation.addresses, operation.effect), self._plain)
        return self._noted(way(request))

    def _noted(self, answer: Any) -> Any:
        """The answer; a job in it is remembered, for its id goes to a caller. The engine is not
        asked for the job of an asset: its build may have ended it, or keep it from answering."""
        if isinstance(answer, JobInfo):
            self._jobs.keep(answer)
        elif isinstance(answer, AssetInfo) and answer.state == "building" and answer.job:
            self._jobs.note(answer.job, answer.id)
        return answer

    def _plain(self, request: Request) -> Any:
        """The answer. A frame that is not stored is sent with the first of its calls alone."""
        frame = request.unstored
        if frame is None:
            return self._transport.call(request)
        if frame.positions is None or frame.digest in self._sent:
            try:
                return self._transport.call(request.bare)
            except UnknownFrameError:
                if frame.positions is None:
                    raise
        answer = self._transport.call(request)
        self._sent[frame.digest] = None
        while len(self._sent) > _SENT_FRAMES:
            self._sent.popitem(last=False)
        return answer

    def _constant(self, operation: Operation, asset: str) -> Any:
        key = (operation.name, asset)
        if (known := self._constants.get(key)) is not None:
            return known
        answer = self._transport.call(Request(operation, (asset,)))
        if answer.vertices:  # of an asset of which only the failure is known, another may be sent
            self._constants[key] = answer
            while len(self._constants) > _CONSTANTS:
                self._constants.popitem(last=False)
        return answer

    def _change(self, request: Request) -> Any:
        answer = self._transport.call(request)
        self._transport.forget(request.asset)
        return answer

    def _remove(self, request: Request) -> None:
        try:
            self._transport.call(request)
        except NotFoundError:
            self._forget(request.asset)
            if request.sent == 1:
                raise
        self._forget(request.asset)

    def _drop(self, request: Request) -> Any:
        try:
            answer = self._transport.call(request)
        except NotFoundError:  # it was removed elsewhere, and now here
            self._forget(request.asset)
            raise
        if answer is True or (isinstance(answer, FollowedAsset) and answer.replaced):
            # The process has the asset no more, or another in its place, without frames.
            self._frames.forget(request.asset)
        self._transport.forget(request.asset)
        return answer

    def _forget(self, asset: str) -> None:
        """The asset is gone, and its frames."""
        self._frames.forget(asset)
        for key in [key for key in list(self._constants) if key[1] == asset]:
            self._constants.pop(key, None)
        self._transport.forget(asset)

    def _create(self, request: Request) -> Any:
        """A new asset. What a process of this machine has of its frames is kept, and their bytes
        are held until the job that stores them has ended."""
        content, asked = request.positional[0], None
        frames = content.frames if isinstance(content, NewAsset) else None
        self._uploads.take(request.number, 0 if frames is None else frames.nbytes, request.hold)
        since = self._frames.mark()

        def note(process: DeviceProcess) -> None:
            nonlocal asked
            asked = process
            self._uploads.sent(request.number, process)

        try:
            answer = self._transport.call(request, note)
        except BaseException:
            self._uploads.release(request.number)
            raise
        if frames is None or asked is None:
            self._uploads.release(request.number)
        else:
            self._keep_frames(answer.id, frames, asked, since)
        return answer

    def _keep_frames(
        self, asset: str, frames: Positions, process: DeviceProcess, since: int
    ) -> None:
        for index, positions in enumerate(frames):
            name = counted_frame(index)
            with self._frames.sending(asset, name):
                # A copy: the whole upload lies in the memory that they are a part of.
                self._frames.keep(asset, name, np.array(positions), process, since)

    def _read_frames(self, request: Request) -> Any:
        """The answer of an engine that has the frame that is read, or all of the asset."""
        if request.unstored is not None:
            return self._plain(request)
        frame = request.frame
        # With what names the positions: where they are refused, others of the same name are not.
        request.version = self._frames.version(request.asset, frame) if frame else 0
        names = (frame,) if frame else None
        return self._transport.call(
            request, partial(self._frames.bring, asset=request.asset, names=names)
        )

    def _put_frame(self, request: Request) -> Any:
        """The positions are kept here, too."""
        asked = None

        def note(process: DeviceProcess) -> None:
            nonlocal asked
            asked = process

        asset, name = request.asset, request.frame
        with self._changing(asset, name):
            since = self._frames.mark()
            answer = self._transport.call(request, note)
            if asked is not None:
                sent: Envelope = request.packed.shared()
                given = sent.positional[2]
                given = given.positions if isinstance(given, Frame) else given
                positions = np.asarray(given, np.float32)
                self._frames.keep(asset, name, positions, asked, since)
        return answer

    def _delete_frame(self, request: Request) -> None:
        asset, name = request.asset, request.frame
        with self._changing(asset, name):
            try:
                self._read_frames(request)
            except NotFoundError:
                if request.sent == 1:
                    raise
            self._frames.forget(asset, name)

    @contextmanager
    def _changing(self, asset: str, frame: str) -> Iterator[None]:
        """Held while a frame is stored or deleted. Such a call is not given up where its client is
        gone: the process would do it later, after what is stored by then."""
        with self._frames.sending(asset, frame), call_context.never_abandoned():
            try:
                yield
            except DeviceLostError:
                self._frames.doubt(asset, frame)
                raise

    def _job(self, request: Request) -> JobInfo:
        """How far a job is. Of a process that has ended a build goes on under the same id, other
        jobs have failed."""
        id = request.positional[0]
        if (lost := self._jobs.lost(id)) is not None:
            return self._resumed(lost)
        try:
            return self._of_job(request)
        except NotFoundError:
            known = self._jobs.find(id)  # the process may have ended, since or before
            if known is None:
                raise
            return self._resumed(known)

    def _cancel(self, request: Request) -> JobInfo:
        id = request.positional[0]
        lost = self._jobs.lost(id)
        if lost is None:
            try:
                return self._of_job(request)
            except NotFoundError:
                lost = self._jobs.find(id)
                if lost is None:
                    raise
        now = self._resumed(lost)
        job = self._info(lost.asset).job if now.state in ("queued", "running") else None
        if job is None:
            return now
        found = self._of_job(Request(request.operation, (job,), of=lost.asset))
        return JobInfo(**{**vars(found), "id": id})

    def _of_job(self, request: Request) -> JobInfo:
        request.of = request.of or self._jobs.asset(request.positional[0])
        found: JobInfo = self._transport.call(request)
        return found

    def _resumed(self, lost: JobInfo) -> JobInfo:
        def now(id: str) -> JobInfo:
            return self._of_job(Request(OPERATIONS["jobs.info"], (id,), of=lost.asset))

        return resumed(lost, self._info, now)

    def _info(self, asset: str) -> AssetInfo:
        found: AssetInfo = self._transport.call(Request(OPERATIONS["assets.info"], (asset,)))
        return found
