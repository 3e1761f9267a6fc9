"""What Ray carries between an ingress and a replica."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import RhytidError
from rhytid.processes.envelope import Envelope
from rhytid.processes.packing import pack


@dataclass(frozen=True)
class Parcel:
    """A packed value. Its large arrays lie beside the pickle, so that Ray copies each once."""

    body: bytes
    arrays: tuple[NDArray[np.uint8], ...]

    @classmethod
    def of(cls, value: Any) -> Parcel:
        """Pack a value of plain classes."""
        found = pack(value)
        return cls(found.body, tuple(np.frombuffer(array, np.uint8) for array in found.arrays))

    def open(self) -> Any:
        """The value; its large arrays are those of the parcel."""
        return pickle.loads(self.body, buffers=self.arrays)


@dataclass(frozen=True)
class Addressed:
    """A call, and what the router reads of it.

    asset: what it is about; empty: any replica may answer.  to: the replica that has what is asked
    for; empty: one of those that the asset is placed on.  spread: whether another than the first of
    these may answer.
    """

    asset: str
    to: str
    spread: bool
    parcel: Parcel

    @classmethod
    def of(cls, envelope: Envelope, asset: str, to: str) -> Addressed:
        """Address a call."""
        return cls(asset, to, envelope.operation.spread, Parcel.of(envelope))


class ElsewhereError(RhytidError):
    """Another replica has the asset; never seen outside of the fleet."""

    def __init__(self, replica: str) -> None:
        super().__init__(f"replica {replica} builds the asset")
        self.replica = replica

    def __reduce__(self) -> tuple[Any, ...]:
        return ElsewhereError, (self.replica,)
