"""How far a command is, on stderr: a bar on a terminal, elsewhere a line every ten seconds.

For a task of a render farm the same is printed on stdout, as the worker agents of Open Job
Description read it.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from typing import Any

from tqdm import tqdm  # type: ignore[import-untyped]

from rhytid.cli.voice import detail, job_line, voice

_SHARE_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}{postfix}"
_STEP_FORMAT = "{desc}: {elapsed}"
# Seconds between lines where there is no terminal, and between two looks of a bar on one.
_EVERY, _LOOK = 10.0, 1.0
# Steps by which the time of the next ones is estimated.
_LAST = 9


@contextmanager
def share_bar(what: str) -> Iterator[Callable[[float, str], None]]:
    """For work that knows its share from 0 to 1: call with the share and the stage."""
    last, pace = (0.0, ""), _Pace()

    def line(seconds: float) -> str:
        share, stage = last
        left = pace.left(seconds)
        return f"{what}: {100 * share:.0f} %{', ' if stage else ''}{stage}, {seconds:.0f} s{left}"

    with _shown(line, total=1.0, desc=what, bar_format=_SHARE_FORMAT) as bar:

        def show(share: float, stage: str) -> None:
            nonlocal last
            if stage != last[1]:
                if voice().for_job:
                    job_line("status", f"{what}: {stage}")
                detail(f"{what}: {stage}, after {pace.seconds():.1f} s")
            last = share, stage
            pace.reached(share)
            bar.set_postfix_str(stage, refresh=False)
            bar.update(share - bar.n)

        yield show


def counted(things: Sequence[Any], what: str, unit: str, opening: str = "") -> Iterable[Any]:
    """Yields the items, and shows which of them is worked on.

    opening: what is said in place of the first one, where it is not what takes the time.
    """
    many, steps = len(things), _Steps(len(things))

    def line(seconds: float) -> str:
        return f"{what}: {step()}, {seconds:.0f} s{steps.left()}"

    def step() -> str:
        if opening and not steps.done:
            return opening
        return f"{unit} {steps.done + 1} of {many}"

    with _shown(line, total=many, desc=what, unit=unit) as bar:
        bar.set_postfix_str(opening)
        for thing in things:
            if voice().for_job:
                job_line("status", f"{what}: {step()}")
            yield thing
            steps.ended()
            bar.set_postfix_str("", refresh=False)
            bar.update()
            if voice().for_job:
                job_line("progress", f"{100 * steps.done / many:.1f}")


@contextmanager
def working(what: str) -> Iterator[None]:
    """For one step that does not know how far it is: shows how long it has taken."""
    detail(what)
    with _shown(lambda s: f"{what}, {s:.0f} s", desc=what, bar_format=_STEP_FORMAT, leave=False):
        yield


@contextmanager
def _shown(line: Callable[[float], str], **bar: Any) -> Iterator[tqdm]:
    """A bar on a terminal; elsewhere what `line` says after so many seconds. A thread of its own
    keeps both going: a step may take long."""
    terminal, silent = sys.stderr.isatty(), voice().quiet or voice().for_job
    ended, start = threading.Event(), time.monotonic()
    with tqdm(disable=silent or not terminal, **bar) as shown:

        def tell() -> None:
            while not ended.wait(_LOOK if terminal else _EVERY):
                if terminal:
                    shown.refresh()
                else:
                    said = line(time.monotonic() - start)
                    print(f"rhytid: {said}", file=sys.stderr, flush=True)

        teller = threading.Thread(target=tell, daemon=True)
        if not silent:
            teller.start()
        try:
            yield shown
        finally:
            ended.set()
            if teller.is_alive():
                teller.join()


class _Pace:
    """Estimates how long work will take, from the time of its last step."""

    def __init__(self) -> None:
        self._start, self._all = time.monotonic(), 0.0

    def seconds(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start

    def reached(self, share: float) -> None:
        """Record the share that is done, from 0 to 1."""
        if share > 0:
            self._all = self.seconds() / share

    def left(self, seconds: float) -> str:
        """Words for what is left after so many seconds; none while nothing is done."""
        return _left(self._all - seconds) if self._all else ""


class _Steps:
    """Estimates how long steps that are alike will take, by the median of the last ones: the first
    does what is done once, and those that are there already take no time."""

    def __init__(self, many: int) -> None:
        self.done, self._many = 0, many
        self._last, self._start = deque[float](maxlen=_LAST), time.monotonic()

    def ended(self) -> None:
        """Record that a step is done, and that the next one begins."""
        now = time.monotonic()
        self._last.append(now - self._start)
        self.done, self._start = self.done + 1, now

    def left(self) -> str:
        """Words for what is left now; none while no step is done."""
        if not self._last:
            return ""
        usual, after = median(self._last), self._many - self.done - 1
        here = max(usual - (time.monotonic() - self._start), 0.0)
        return _left(here + after * usual)


def _left(seconds: float) -> str:
    left = max(seconds, 0.0)
    return f", {left:.0f} s left" if left < 100 else f", {left / 60:.0f} min left"
