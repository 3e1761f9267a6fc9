"""Chunks of a bake on a cluster, and the events of a run. Nothing here depends on Dask."""

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
    """Frames that one task bakes.

    numbers: of the frames, ascending.  text: the numbers as a range, `1-10`.
    """

    numbers: tuple[int, ...]
    text: str


@dataclass(frozen=True)
class ChunkFailed:
    """A chunk cannot be baked, however often it is tried."""

    error: RhytidError


@dataclass(frozen=True)
class WorkerUnable:
    """A worker cannot bake any chunk.  error: the reason, which names the worker."""

    worker: str
    error: RhytidError


@dataclass(frozen=True)
class FrameDone:
    """All files of a frame are there.  worker: address of the worker that said so.  worked: whether
    it had written one."""

    label: str
    worker: str
    worked: bool = True


@dataclass(frozen=True)
class ChunkDone:
    """A chunk is baked.  report: what its session returned."""

    chunk: Chunk
    report: Any


@dataclass(frozen=True)
class WorkerLost:
    """A worker has left. Its chunk is given to another."""

    address: str


Event = FrameDone | ChunkDone | WorkerLost | WorkerUnable


def of_worker(error: Exception, worker: str) -> RhytidError:
    """The error with the worker before its message. Errors of other packages become
    StorageError."""
    kind = type(error) if isinstance(error, RhytidError) else StorageError
    known = isinstance(error, RhytidError | OSError)
    return kind(f"worker {worker}: {error if known else f'{type(error).__name__}: {error}'}")
