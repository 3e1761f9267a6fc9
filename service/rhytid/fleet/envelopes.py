"""What goes between an ingress and a replica: calls of the engine, and answers."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.figures import Span
from rhytid.engine_process.packing import pack
from rhytid.errors import RhytidError
from rhytid.support.build_identity import drawing_version

# Large arrays lie beside the pickle, so that Ray copies each once.
Arrays = tuple[NDArray[np.uint8], ...]


@dataclass(frozen=True)
class Envelope:
    """One call.

    name: such as `draw_tile`.  asset: what it is about; empty: any replica may answer.  to: the
    replica that has what is asked for; empty: one of those that the asset is placed on.
    spread: whether another than the first of these may answer.  version: of the frame that it
    reads, as far as the ingress knows.  request_id, traced, caller, live: as of `requests.Call`.
    drawing: `drawing_version` of the ingress.
    """

    name: str
    asset: str
    to: str
    spread: bool
    version: int
    body: bytes
    arrays: Arrays
    request_id: str = ""
    traced: bool = False
    caller: str = ""
    live: bool = False
    drawing: str = field(default_factory=drawing_version)

    def arguments(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Positional and named."""
        positional, named = unpacked(self.body, self.arrays)
        return positional, named


@dataclass(frozen=True)
class Answer:
    """What a call returned, or the error that it raised.

    version: of the frame that it stored or removed; 0 else.
    """

    good: bool
    body: bytes
    arrays: Arrays
    spans: Sequence[Span] = ()
    version: int = 0

    @classmethod
    def of(cls, value: Any, *, good: bool = True, **about: Any) -> Answer:
        """An answer with a value, or with an error where it is not good."""
        return cls(good, *packed(value), **about)

    def value(self) -> Any:
        """What was returned, or the error."""
        return unpacked(self.body, self.arrays)


class ElsewhereError(RhytidError):
    """Another replica has the asset; never seen outside of the fleet."""

    def __init__(self, replica: str) -> None:
        super().__init__(f"replica {replica} builds the asset")
        self.replica = replica

    def __reduce__(self) -> tuple[Any, ...]:
        return ElsewhereError, (self.replica,)


def packed(value: Any) -> tuple[bytes, Arrays]:
    """A value as a pickle and its large arrays."""
    found = pack(value)
    return found.body, tuple(np.frombuffer(array, np.uint8) for array in found.arrays)


def unpacked(body: bytes, arrays: Arrays) -> Any:
    """The value of `packed`; its large arrays are those that are given."""
    return pickle.loads(body, buffers=arrays)
