"""Calls as generators that do no input or output: they yield steps and are sent what came of them.

The two clients take each step in their own way; everything else is here and in `calls`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, TypeVar

from rhytid_client.parse import Response
from rhytid_client.requests import Request
from rhytid_client.warned import tell_notice

T = TypeVar("T")

# The least pause, so that a server that says "0 seconds" is not asked in a tight loop.
LEAST_PAUSE = 0.1


@dataclass(frozen=True)
class Pause:
    """Do nothing for that many seconds."""

    seconds: float


@dataclass(frozen=True)
class Listen:
    """Hand each chunk of a streamed answer to `feed` until it returns true.

    Ends without an error where the answer is refused, breaks off or is silent for `timeout`
    seconds: the call that listens asks for itself afterwards.
    """

    request: Request
    feed: Callable[[bytes], bool]
    timeout: float


Step = Request | Pause | Listen
# A Request is answered with a Response, the other steps with None.
Flow = Generator[Step, Any, T]


def patient(flow: Flow[T], max_wait: float) -> Flow[T]:
    """`flow`, whose requests are repeated while the server is busy, the asset is building or the
    caller asks too often.

    Only where the server refused with Retry-After, which says that it did nothing, and for at
    most `max_wait` seconds of pauses per request: repeating is safe for every method.
    """
    answer: Response | None = None
    while True:
        try:
            step = flow.send(answer)
        except StopIteration as end:
            result: T = end.value
            return result
        answer = yield step
        waited = 0.0
        while answer is not None and (pause := _pause(answer)) <= max_wait - waited:
            yield Pause(pause)
            waited += pause
            answer = yield step
        if answer is not None:
            tell_notice(answer.headers)


def _pause(response: Response) -> float:
    """Seconds to wait before asking again; infinity for an answer that stands."""
    if response.status not in (409, 429, 503) or response.retry_after is None:
        return float("inf")
    return max(response.retry_after, LEAST_PAUSE)
