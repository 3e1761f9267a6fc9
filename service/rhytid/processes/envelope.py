"""Calls and answers as they go from one process to another."""

from __future__ import annotations

import hashlib
import itertools
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

from rhytid.device.figures import Span, keep_spans, spans_are_kept, spans_of_request
from rhytid.engine import call_context
from rhytid.engine.byte_budget import Hold
from rhytid.engine.call_context import caller, drawn_live, is_live
from rhytid.engine.frames import Frame
from rhytid.engine.operation import Operation
from rhytid.engine.operations import OPERATIONS
from rhytid.errors import RhytidError
from rhytid.processes.packing import Packed, pack
from rhytid.storage.snapshots import PIECE, OpenFile
from rhytid.support.build_identity import drawing_version
from rhytid.support.logs import request_id

_numbers = itertools.count(1)
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Envelope:
    """One call of an engine, and what goes with it.

    number: names the call among those of its sender.  name: of the operation.  version: of the
    frame that it reads, as far as the sender knows; 0 where it knows none.  request_id: of the HTTP
    request.  traced: whether its stages are wanted with the answer.  live: whether it is for a live
    connection.  caller: who asks.  drawing: `drawing_version` of the sender.
    """

    number: int
    name: str
    positional: tuple[Any, ...]
    named: Mapping[str, Any]
    version: int = 0
    request_id: str = ""
    traced: bool = False
    live: bool = False
    caller: str = ""
    drawing: str = field(default_factory=drawing_version)

    @property
    def operation(self) -> Operation:
        """Its row."""
        return OPERATIONS[self.name]

    def perform(self, engine: Any) -> Any:
        """What an engine answers; raises what it raises."""
        return self.operation.of(engine)(*self.positional, **self.named)


@dataclass(frozen=True, eq=False)
class Answer:
    """What a call returned, or the error that it raised where it is not good.

    spans: its stages, where they are wanted.  version: of the frame that it stored or removed, in a
    fleet; 0 else.
    """

    good: bool
    value: Any
    spans: Sequence[Span] = ()
    version: int = 0

    def open(self) -> Any:
        """The value; raises the error."""
        keep_spans(self.spans)
        if self.good:
            return self.value
        error: BaseException = self.value
        try:
            raise error
        finally:  # else its traceback and this frame hold each other, and all that frames hold
            del error


@dataclass(eq=False)
class Request:
    """One call of an engine by its sender; it may be sent more than once.

    version: as of `Envelope`.  of: the asset of a job that is asked for, where it is known.  hold:
    counts bytes that the call holds on this side.  sent: how often it was sent.
    """

    operation: Operation
    positional: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)
    version: int = 0
    of: str = ""
    hold: Hold | None = None
    number: int = field(default_factory=lambda: next(_numbers))
    sent: int = 0

    @property
    def envelope(self) -> Envelope:
        """As it is sent, with what is known of the sender now."""
        return Envelope(
            self.number, self.operation.name, self.positional, dict(self.named), self.version,
            request_id.get(), spans_are_kept(), is_live(), caller.get(),
        )  # fmt: skip

    @cached_property
    def packed(self) -> Packed:
        """The envelope, packed once however often it is sent."""
        return pack(self.envelope)

    @cached_property
    def digest(self) -> str:
        """Names what is asked for: two with the same digest are the same call."""
        packed = pack((self.operation.name, self.bare.positional, dict(self.named), self.version))
        digest = hashlib.sha256(packed.body)
        for array in packed.arrays:
            digest.update(array)
        for descriptor in packed.files:  # of which the pickle has the number alone
            file = OpenFile(descriptor)
            while piece := file.read(PIECE):
                digest.update(piece)
        return digest.hexdigest()

    @property
    def asset(self) -> str:
        """The id of the asset that it is about; empty where it is about none that is known."""
        if self.operation.addresses in ("asset", "frames", "frame"):
            return str(self.positional[0])
        return ""

    @property
    def frame(self) -> str:
        """The name of the stored frame that it is about; empty where it is about none."""
        named = self.operation.addresses == "frame" and isinstance(self.positional[1], str)
        return str(self.positional[1]) if named else ""

    @property
    def unstored(self) -> Frame | None:
        """The frame that it brings along and does not store."""
        if self.operation.effect != "read" or len(self.positional) < 2:
            return None
        return self.positional[1] if isinstance(self.positional[1], Frame) else None

    @property
    def bare(self) -> Request:
        """The same where that frame is named by its digest alone."""
        frame = self.unstored
        if frame is None:
            return self
        asset, _, *others = self.positional
        return replace(self, positional=(asset, frame.bare, *others))

    def __str__(self) -> str:
        return self.operation.name


class Transport(Protocol):
    """What carries requests to engines: to the processes of this machine's devices, to a fleet."""

    def call(self, request: Request, prepare: Callable[[Any], None] | None = None) -> Any:
        """The answer to a request; raises what the engine raises, DeviceLostError where none
        answers in time.

        prepare: called with each process of this machine that is asked, before.
        """

    def forget(self, asset: str) -> None:
        """An asset was changed or removed: what was refused of it may be tried again."""


def answered(
    envelope: Envelope, perform: Callable[[Envelope], Any], gone: Callable[[], bool]
) -> Answer:
    """The answer to a call: what `perform` returns or raises, in the context of its sender.

    gone: whether nobody waits for it any more. Where `perform` returns an `Answer`, that is it.
    """
    request_id.set(envelope.request_id)
    caller.set(envelope.caller)
    kept = spans_of_request() if envelope.traced else nullcontext(())
    with kept as spans, call_context.abandoned_when(gone), drawn_live(envelope.live):
        try:
            value = perform(envelope)
        except RhytidError as error:
            return Answer(False, error, tuple(spans))
        except OSError as error:
            _log.exception("%s failed", envelope.name)  # the sender gets no traceback
            return Answer(False, error, tuple(spans))
        except Exception as error:  # noqa: BLE001 the sender raises it
            _log.exception("%s failed", envelope.name)
            return Answer(False, RuntimeError(f"{type(error).__name__}: {error}"), tuple(spans))
        if isinstance(value, Answer):
            return replace(value, spans=tuple(spans))
        return Answer(True, value, tuple(spans))
