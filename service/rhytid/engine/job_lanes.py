"""Which thread does which jobs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rhytid.engine.job import Job

# Kinds that wait for a shared store, and keep neither the device nor other jobs of their asset.
TRANSFERS = ("fetch", "push")


@dataclass(frozen=True, eq=False)
class Queued:
    """A job that waits, and its work.  small: whether it is short."""

    job: Job
    work: Callable[[Job], None]
    small: bool

    @property
    def asset(self) -> str:
        """The id of its asset."""
        return self.job.info.asset

    @property
    def kind(self) -> str:
        """One of `JOB_KINDS`."""
        return self.job.info.kind

    @property
    def transfers(self) -> bool:
        """Whether it waits for a shared store."""
        return self.kind in TRANSFERS

    @property
    def caller(self) -> str:
        """Who asked for it."""
        return self.job.caller

    @property
    def turn(self) -> tuple[str, bool]:
        """Jobs of one turn run one after the other."""
        return self.asset, self.transfers


@dataclass(frozen=True, eq=False)
class Lane:
    """Jobs that one thread takes.  transfers: those that wait for a shared store.  spare:
    only while one caller has all other lanes that do not transfer, for other callers."""

    name: str
    takes: Callable[[Queued], bool]
    spare: bool = False
    transfers: bool = False


LARGE = Lane("rhytid-jobs", lambda queued: not queued.transfers)
LANES = (
    LARGE,
    Lane("rhytid-small-jobs", lambda queued: queued.small and not queued.transfers),
    Lane("rhytid-spare-jobs", lambda queued: not queued.transfers, spare=True),
    Lane("rhytid-transfers", lambda queued: queued.transfers, transfers=True),
    Lane("rhytid-fetches", lambda queued: queued.kind == "fetch", transfers=True),
)
