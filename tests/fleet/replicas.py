"""The replicas of a fleet, looked at from outside."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from processes.served import alive


def replicas(fleet: Any) -> dict[str, int]:
    """Process ids by the names of the replicas that report and are there."""
    reports = fleet._reports.look()
    return {one.replica: one.pid for one in reports if alive(one.pid)}


def replica_of(job: str) -> str:
    return job.split("-")[3]


@contextmanager
def sent_to(fleet: Any, replica: str) -> Iterator[None]:
    """Calls that are made in the block go to a replica, whichever asset they are about."""
    caller = fleet._caller
    made = caller._addressed
    caller._addressed = lambda request, asset, to: replace(made(request, asset, to), to=replica)
    try:
        yield
    finally:
        caller._addressed = made
