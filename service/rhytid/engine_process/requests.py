"""What the server asks the process of the device."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from rhytid.engine_process.packing import Packed, pack

_numbers = itertools.count(1)


@dataclass(frozen=True)
class Call:
    """One call of the engine, as it goes to the process.

    number: names the request in the process's report.  name: such as `tiles.draw`.
    """

    number: int
    name: str
    positional: tuple[Any, ...]
    named: Mapping[str, Any]


@dataclass(eq=False)
class Request:
    """One call of the engine; it may be sent more than once.

    room: bytes of arrays that its answer is expected to have.  sent: how often it was.
    """

    name: str
    positional: tuple[Any, ...] = ()
    named: Mapping[str, Any] = field(default_factory=dict)
    room: int = 0
    number: int = field(default_factory=lambda: next(_numbers))
    sent: int = 0

    @cached_property
    def packed(self) -> Packed:
        """As it is sent."""
        return pack(Call(self.number, self.name, self.positional, dict(self.named)))

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
