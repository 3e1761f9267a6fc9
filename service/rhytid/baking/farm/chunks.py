"""What a cluster works on: chunks, and what becomes of them.

Nothing here depends on the cluster that is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rhytid.errors import (
    ConflictError,
    DiskFullError,
    InputError,
    KernelBuildError,
    LimitError,
    NoDeviceError,
    NotFoundError,
    RhytidError,
    StorageError,
)

# What stays as it is however often a chunk is tried again.
FINAL = (
    ConflictError,
    DiskFullError,
    InputError,
    LimitError,
    NotFoundError,
)
# What is wrong with the device of a worker, not with a chunk.
UNABLE = (KernelBuildError, NoDeviceError)


@dataclass(frozen=True)
class Chunk:
    """Frames that are baked by one task.

    numbers: of the frames, ascending.  text: the same to read, `1-10`.
    """

    numbers: tuple[int, ...]
    text: str


@dataclass(frozen=True)
class Failure:
    """Why a chunk cannot be baked, however often it is tried."""

    error: RhytidError


@dataclass(frozen=True)
class Unable:
    """A worker cannot bake, whatever the chunk. `error` names it."""

    worker: str
    error: RhytidError


@dataclass(frozen=True)
class FrameDone:
    """A frame is there, with all its files. `worker`: the address of the one that told it."""

    label: str
    worker: str


@dataclass(frozen=True)
class ChunkDone:
    """A chunk is baked. `report`: of its session."""

    chunk: Chunk
    report: Any


@dataclass(frozen=True)
class WorkerLost:
    """A worker has left; the chunk that it was at is given to another."""

    address: str


Event = FrameDone | ChunkDone | WorkerLost | Unable


def of_worker(error: Exception, worker: str) -> RhytidError:
    """The error with the worker before its message; what is no error of ours as a StorageError."""
    kind = type(error) if isinstance(error, RhytidError) else StorageError
    known = isinstance(error, RhytidError | OSError)
    return kind(f"worker {worker}: {error if known else f'{type(error).__name__}: {error}'}")
