"""Long work: reports of its progress, and arrays in blocks of rows, between which it may stop."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.support import cancellation

Progress = Callable[[float, str], None]
ROWS = 1 << 19
# Rows of a thread at a time: what is computed on the way stays in the cache.
_EACH = 1 << 16
# One of so many values is in a sample; how far off ranks in it may be, in square roots of its size.
_SAMPLE, _OFF = 64, 4


def silent(fraction: float, stage: str) -> None:
    """Report nothing."""


def part(progress: Progress, low: float, high: float) -> Progress:
    """The progress, from 0 to 1, of a part that runs from `low` to `high` of the whole."""

    def report(fraction: float, stage: str) -> None:
        progress(low + (high - low) * fraction, stage)

    return report


def rising(progress: Progress) -> Progress:
    """A progress that passes reports on to another, none below the one before."""
    reached = 0.0

    def report(fraction: float, stage: str) -> None:
        nonlocal reached
        reached = max(fraction, reached)
        progress(reached, stage)

    return report


def clocked(progress: Progress) -> tuple[Progress, dict[str, float]]:
    """A progress that passes reports on to another, and the seconds of each stage by its name,
    which fill as reports come."""
    seconds: dict[str, float] = {}
    last: list[tuple[str, float]] = []

    def report(fraction: float, stage: str) -> None:
        now = time.perf_counter()
        if last:
            before, since = last.pop()
            seconds[before] = round(seconds.get(before, 0.0) + now - since, 6)
        last.append((stage, now))
        progress(fraction, stage)

    return report, seconds


def row_blocks(count: int, each: int | None = None) -> Iterator[slice]:
    """The rows 0 to `count`, ROWS or `each` at a time. Raises what `cancellation.check` does,
    before each block."""
    each = each or ROWS
    for first in range(0, count, each):
        cancellation.check()
        yield slice(first, min(first + each, count))


def over_rows(count: int, task: Callable[[slice], None], each: int = _EACH) -> None:
    """Run a task for the rows 0 to `count`, `each` at a time, on as many threads as there are
    cores; a single block on this thread, so that a block may ask for one more.

    Raises what the task raises, and what `cancellation.check` does between blocks.
    """
    check = cancellation.current_check()

    def run(rows: slice) -> None:
        with cancellation.scope(check):
            task(rows)

    blocks = [slice(first, min(first + each, count)) for first in range(0, count, each)]
    if len(blocks) == 1:
        cancellation.check()
        task(blocks[0])
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        try:
            for _ in pool.map(run, blocks):
                cancellation.check()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def together(*tasks: Callable[[], Any]) -> list[Any]:
    """What tasks return, which run side by side on as many threads as there are cores."""
    found: list[Any] = [None] * len(tasks)

    def run(rows: slice) -> None:
        found[rows.start] = tasks[rows.start]()

    over_rows(len(tasks), run, each=1)
    return found


def gathered(array: NDArray[Any], index: NDArray[np.integer]) -> NDArray[Any]:
    """The rows of an array at an index, on as many threads as there are cores."""
    found = np.empty((len(index), *array.shape[1:]), array.dtype)

    def gather(rows: slice) -> None:
        found[rows] = array[index[rows]]

    over_rows(len(index), gather)
    return found


def rows_where(count: int, good: Callable[[slice], NDArray[np.bool_]]) -> NDArray[np.int32]:
    """The numbers, ascending, of those of the rows 0 to `count` that are good, as this says of
    some rows; on as many threads as there are cores."""
    found: dict[int, NDArray[np.int32]] = {}

    def look(rows: slice) -> None:
        found[rows.start] = (np.flatnonzero(good(rows)) + rows.start).astype(np.int32)

    over_rows(count, look)
    return np.concatenate([np.empty(0, np.int32), *(found[first] for first in sorted(found))])


def nth_largest(values: NDArray[np.float64], n: int) -> float:
    """The n-th largest of values, counted from 1. Of many those are sorted alone that a sample says
    it may be among, on as many threads as there are cores."""
    some = np.sort(values[::_SAMPLE])[::-1]
    at, off = n // _SAMPLE, _OFF * int(np.sqrt(len(some)) + 1)
    high = some[at - off] if off <= at else np.inf
    low = some[at + off] if at + off < len(some) else -np.inf
    above = len(rows_where(len(values), lambda rows: values[rows] > high))
    near = rows_where(len(values), lambda rows: (values[rows] >= low) & (values[rows] <= high))
    among = values[near]
    if not above < n <= above + len(among):
        above, among = 0, values
    rank = len(among) - (n - above)
    return float(np.partition(among, rank)[rank])


def masked(mask: NDArray[np.bool_], *arrays: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """The rows of arrays where a mask is true, on as many threads as there are cores. Arrays
    themselves where it is true throughout."""
    ends = np.zeros(-(-len(mask) // _EACH) + 1, np.int64)

    def count(rows: slice) -> None:
        ends[rows.start // _EACH + 1] = np.count_nonzero(mask[rows])

    over_rows(len(mask), count)
    np.cumsum(ends, out=ends)
    if ends[-1] == len(mask):
        return arrays
    found = tuple(np.empty((ends[-1], *array.shape[1:]), array.dtype) for array in arrays)

    def take(rows: slice) -> None:
        block = rows.start // _EACH
        for array, some in zip(arrays, found, strict=True):
            some[ends[block] : ends[block + 1]] = array[rows][mask[rows]]

    over_rows(len(mask), take)
    return found


def over_block(block: slice, task: Callable[[slice], None], each: int = _EACH) -> None:
    """`over_rows` for the rows of a block."""
    first = block.start

    def run(rows: slice) -> None:
        task(slice(first + rows.start, first + rows.stop))

    over_rows(block.stop - first, run, each)
