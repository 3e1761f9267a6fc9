"""Implementations of the same cases: their results are compared, then they are timed in turn."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from rhytid_lab.bench import peers
from rhytid_lab.bench.frame import FrameBench
from rhytid_lab.bench.peers import Run, Unsupported
from rhytid_lab.bench.scene import Floats, Scene

OURS = "rhytid"
NAMES = (OURS, *peers.PEERS)
# Seconds from which on a run is not repeated.
_LONG = 5.0
# Seconds up to which waking up counts.
_SHORT = 0.5
# What is made once per asset is timed once.
_ONCE = ("precompute",)
# `stretch` in log stretch; maps in units of depth. A blur reads between texels: bilinear hardware
# rounds places to a 256th of a texel.
TOLERANCES = {"stretch": 1e-4, "convolved": 5e-3}
TOLERANCE = 1e-3


@dataclass(frozen=True)
class Timing:
    """One implementation of one case.

    map_copies: seconds over those of a map copy on the device that it runs on, which may be the
    host.  max_difference: from our result, see `worst_difference`.  processor_seconds: of all
    threads of this process; steadier than `seconds` on a processor that others use, too.
    """

    case: str
    implementation: str
    seconds: float
    map_copies: float
    max_difference: float
    processor_seconds: float


@dataclass(frozen=True)
class NotTimed:
    """An implementation of a case that was not timed.  reason: why.  off: whether its result was
    wrong."""

    case: str
    implementation: str
    reason: str
    off: bool = False


@dataclass
class Results:
    """All results.  copy_seconds: of one map copy on the device, the median over all rounds."""

    copy_seconds: float = 0.0
    timings: list[Timing] = field(default_factory=list)
    untimed: list[NotTimed] = field(default_factory=list)


@dataclass
class _Candidate:
    """An implementation of a case whose result is right, with the times of its runs so far."""

    name: str
    run: Callable[[], None]
    release: Callable[[], None]
    difference: float
    repeats: int
    on_host: bool = False
    short: bool = True
    seconds: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)

    def time(self) -> None:
        """Run it once, timed."""
        start, processor = time.perf_counter(), time.process_time()
        self.run()
        self.seconds.append(time.perf_counter() - start)
        self.processor.append(time.process_time() - processor)


class Comparison:
    """Compares and times cases of a frame, each by those implementations of `names` that do it."""

    def __init__(self, bench: FrameBench, names: Sequence[str], repeats: int) -> None:
        self._bench, self._names, self._repeats = bench, names, repeats
        self._scene = bench.scene()
        # By whether it is a copy on the host, where the device is another.
        self._copies: dict[bool, list[float]] = {False: [], True: []}
        self._host = None if self._scene.on_cpu else HostCopy(self._scene.size)
        self._timed: list[tuple[str, list[_Candidate]]] = []
        self._untimed: list[NotTimed] = []

    def run(self, cases: Iterable[str]) -> Results:
        """Compare and time every case; `results` has those that have ended, if this is
        cancelled."""
        for case in cases:
            candidates = self._candidates(case)
            self._time(candidates)
            self._timed.append((case, candidates))
            for candidate in candidates:
                candidate.release()
        return self.results

    @property
    def results(self) -> Results:
        """What has been found so far."""
        copies = {host: statistics.median(s) for host, s in self._copies.items() if s}
        results = Results(copies.get(False, 0.0), [], [*self._untimed])
        for case, candidates in self._timed:
            for candidate in candidates:
                seconds = statistics.median(candidate.seconds)
                share = seconds / copies[candidate.on_host]
                used = statistics.median(candidate.processor)
                entry = Timing(case, candidate.name, seconds, share, candidate.difference, used)
                results.timings.append(entry)
        return results

    def _candidates(self, case: str) -> list[_Candidate]:
        bench = self._bench
        ours = bench.result(case) if case != "precompute" else None
        found = []
        for name in self._names:
            if name == OURS:
                repeats = 1 if case in _ONCE else self._repeats
                short = bench.seconds(case) < _SHORT
                run = partial(bench.run, case)
                found.append(_Candidate(name, run, _nothing, 0.0, repeats, short=short))
            elif case in peers.cases_of(name) and ours is not None:
                candidate = self._candidate(name, case, ours)
                found += [candidate] if candidate else []
        return found

    def _candidate(self, name: str, case: str, ours: Floats) -> _Candidate | None:
        """Prepare a peer and check its result; None where it cannot be timed, which is noted."""
        try:
            run = peers.prepare(name, case, self._scene)
        except Unsupported as reason:
            self._untimed.append(NotTimed(case, name, str(reason)))
            return None
        start = time.perf_counter()
        run.run()
        first = time.perf_counter() - start
        repeats = 1 if first > _LONG else self._repeats
        difference = self._compared(name, case, run, ours)
        if difference is None:
            run.release()
            return None
        on_host = peers.runs_on_host(name) and self._host is not None
        return _Candidate(name, run.run, run.release, difference, repeats, on_host, first < _SHORT)

    def _compared(self, name: str, case: str, run: Run, ours: Floats) -> float | None:
        difference = worst_difference(case, self._scene, ours, run.result())
        if difference <= tolerance(case):  # not so where it is not a number
            return difference
        reason = f"refused: off by {difference:.2g}, over {tolerance(case):g}"
        self._untimed.append(NotTimed(case, name, reason, off=True))
        return None

    def _time(self, candidates: list[_Candidate]) -> None:
        """Time the candidates in turn, a map copy before each, so that other work of the machine
        slows all alike.

        Short ones run once more before, untimed, as from frame to frame: threads that slept share a
        core for their first milliseconds.
        """
        for number in range(max((candidate.repeats for candidate in candidates), default=0)):
            for candidate in candidates:
                if number < candidate.repeats and candidate.short:
                    candidate.run()
                self._copies[candidate.on_host].append(self._copy(candidate.on_host))
                if number < candidate.repeats:
                    candidate.time()

    def _copy(self, on_host: bool) -> float:
        if on_host and self._host is not None:
            return self._host.seconds()
        return self._bench.seconds("copy")


def _nothing() -> None:
    """Release nothing: the result stays on the device."""


def tolerance(case: str) -> float:
    """Return the worst difference that a case may have."""
    return TOLERANCES.get(case, TOLERANCE)


def worst_difference(case: str, scene: Scene, ours: Floats, theirs: Floats) -> float:
    """Return the worst difference of two results of `FrameBench.result`.

    Of maps it is in units of the depth. Of stretch it is in log stretch within the limit of the
    response: of the ratios, and of the axes by the change that their turning makes.
    """
    if ours.shape != theirs.shape:
        raise ValueError(f"{case}: a result of shape {theirs.shape} instead of {ours.shape}")
    if case == "stretch":
        return _stretch_difference(ours, theirs, scene.settings.response.log_stretch_limit)
    found = np.abs(theirs.astype(np.float64) - ours).max(initial=0.0)
    return float(found) / scene.depth


def _stretch_difference(ours: Floats, theirs: Floats, limit: float) -> float:
    logs, other = (np.clip(np.log(s[:, :2]), -limit, limit) for s in (ours, theirs))
    apart = logs[:, 0] - logs[:, 1]
    turned = [np.abs(ours[:, i] * theirs[:, i + 1] - ours[:, i + 1] * theirs[:, i]) for i in (2, 4)]
    axes = max(float((turn * apart).max(initial=0.0)) for turn in turned)
    return max(float(np.abs(logs - other).max(initial=0.0)), axes)


class HostCopy:
    """Copies a map of R² float32 by every thread of the host: the unit of cost of peers that run
    there beside a GPU."""

    def __init__(self, size: int) -> None:
        count = os.cpu_count() or 1
        self._from, self._to = (
            np.array_split(np.full(size * size, value, np.float32), count) for value in (1, 0)
        )
        self._threads = ThreadPoolExecutor(count)

    def seconds(self) -> float:
        """Seconds of one copy."""
        start = time.perf_counter()
        list(self._threads.map(np.copyto, self._to, self._from))
        return time.perf_counter() - start
