"""Long work of a host, step by step, so that it can show how far it is and be cancelled."""

from __future__ import annotations

from collections.abc import Callable, Generator
from time import sleep
from typing import TypeVar

# Share that is done, what is done now, and seconds until the next step makes sense.
Step = tuple[float, str, float]
# Told the share and what is done now; False where the user wants it to end.
Progress = Callable[[float, str], bool]
R = TypeVar("R")


class Cancelled(Exception):
    """The user ended the work; what was written until then is whole."""


def finish(steps: Generator[Step, None, R], progress: Progress) -> R:
    """Do all of the work and return its result; raises Cancelled.

    The work leaves things sound where it is closed, whether it ends or not.
    """
    try:
        while True:
            share, text, seconds = next(steps)
            if not progress(share, text):
                raise Cancelled(text)
            sleep(seconds)
    except StopIteration as end:
        result: R = end.value
        return result
    finally:
        steps.close()
