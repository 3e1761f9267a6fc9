"""What the server asks the process of the device."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from rhytid.device.figures import spans_are_kept
from rhytid.engine.callers import caller
from rhytid.engine.worker import is_live
from rhytid.engine_process.packing import Packed, pack
from rhytid.support.logs import request_id

_numbers = itertools.count(1)


@dataclass(frozen=True)
class Call:
    """One call of the engine, as it goes to the process.

    number: names the request in the process's report.  name: such as `tiles.draw`.  request_id: of
    the HTTP request.  traced: whether its stages are wanted with the answer.  live: whether it is
    for a live connection.  caller: who asks.
    """

    number: int
    name: str
    positional: tuple[Any, ...]
    named: Mapping[str, Any]
    request_id: str = ""
    traced: bool = False
    live: bool = False
    caller: str = ""


@dataclass(eq=False)
class Request:
    """One call of the engine; it may be sent more than once.

    room: bytes of arrays that its answer is expected to have.  sent: how often it was.  of: the
    asset of a job that is asked for, where it is known; empty else.
    """

    name: str
    positional: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)
    room: int = 0
    number: int = field(default_factory=lambda: next(_numbers))
    sent: int = 0
    of: str = ""

    @cached_property
    def packed(self) -> Packed:
        """As it is sent."""
        named, traced = dict(self.named), spans_are_kept()
        about = (self.number, self.name, self.positional, named, request_id.get(), traced)
        return pack(Call(*about, is_live(), caller.get()))

    @cached_property
    def digest(self) -> str:
        """Names what is asked for: two with the same digest are the same call."""
        packed = pack((self.name, self.positional, dict(self.named)))
        digest = hashlib.sha256(packed.body)
        for array in packed.arrays:
            digest.update(array)
        return digest.hexdigest()

    @property
    def asset(self) -> str:
        """The id of the asset that it is about; empty where it is about none that is known."""
        first = self.positional[0] if self.positional else ""
        return first if isinstance(first, str) else ""

    def __str__(self) -> str:
        return self.name
