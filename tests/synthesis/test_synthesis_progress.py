"""Work over rows on several threads."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np
import pytest

from rhytid.errors import CancelledError
from rhytid.support import cancellation
from rhytid.synthesis.incidence import starts_of
from rhytid.synthesis.progress import (
    gathered,
    masked,
    nth_largest,
    over_block,
    over_rows,
    row_blocks,
    rows_where,
    together,
)


@pytest.mark.parametrize("count", [0, 1, 999, 1000, 4321])
def test_every_row_has_its_turn_once(count: int) -> None:
    seen = np.zeros(count, np.int64)

    def add(rows: slice) -> None:
        seen[rows] += 1

    over_rows(count, add, each=100)
    assert (seen == 1).all()


def test_an_error_of_a_block_is_raised() -> None:
    def fail(rows: slice) -> None:
        if rows.start == 300:
            raise ValueError("row 300")

    with pytest.raises(ValueError, match="row 300"):
        over_rows(1000, fail, each=100)


def test_long_work_within_a_block_is_cancelled() -> None:
    asked = threading.Event()

    def check() -> None:
        if threading.current_thread() is not threading.main_thread():
            asked.set()
            raise CancelledError("no longer wanted")

    def look(rows: slice) -> None:
        for _ in row_blocks(rows.stop - rows.start):
            pass

    with cancellation.scope(check), pytest.raises(CancelledError):
        over_rows(20, look, each=10)
    assert asked.is_set()


def test_a_single_block_is_done_on_this_thread() -> None:
    threads = set()

    def look(rows: slice) -> None:
        threads.add(threading.current_thread())

    over_rows(10, look, each=10)
    assert threads == {threading.current_thread()}


def test_the_rows_of_a_block_have_their_turn_alone() -> None:
    seen = np.zeros(300_000, np.int64)

    def add(rows: slice) -> None:
        seen[rows] += 1

    over_block(slice(1000, 250_000), add)
    assert (seen[1000:250_000] == 1).all()
    assert seen.sum() == 249_000


@pytest.mark.parametrize("count", [0, 1, 65_536, 300_001])
def test_rows_of_an_index_are_gathered(count: int) -> None:
    array = np.arange(3.0 * 70_000).reshape(-1, 3)
    index = np.random.default_rng(count).integers(0, len(array), count)
    np.testing.assert_array_equal(gathered(array, index), array[index], strict=True)


@pytest.mark.parametrize("count", [0, 1, 65_536, 300_001])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_rows_of_a_mask_keep_their_order(count: int, share: float) -> None:
    numbers, pairs = np.arange(count, dtype=np.int32), np.arange(2.0 * count).reshape(-1, 2)
    mask = np.random.default_rng(count).random(count) < share
    mask[60_000:140_000] = False  # the second block has none
    found = masked(mask, numbers, pairs)
    for some, array in zip(found, (numbers, pairs), strict=True):
        np.testing.assert_array_equal(some, array[mask], strict=True)


def test_tasks_run_together_and_what_they_return_is_in_their_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    met = threading.Barrier(2)  # each waits for the other

    def meet(number: int) -> int:
        met.wait(timeout=20)
        return number

    assert together(partial(meet, 1), partial(meet, 2)) == [1, 2]
    assert together() == []


def test_what_a_task_raises_ends_all() -> None:
    def fail() -> None:
        raise CancelledError("enough")

    with pytest.raises(CancelledError, match="enough"):
        together(list, fail, list)


@pytest.mark.parametrize("count", [0, 1, 65_536, 200_001])
def test_rows_that_are_good_are_found_in_their_order(count: int) -> None:
    good = np.random.default_rng(count).random(count) < 0.3
    found = rows_where(count, lambda rows: good[rows])
    np.testing.assert_array_equal(found, np.flatnonzero(good))
    assert found.dtype == np.int32


@pytest.mark.parametrize("values", ["by chance", "few", "ascending", "alike", "unlike the sample"])
@pytest.mark.parametrize("count", [1, 64, 150_000])
def test_the_nth_largest_is_that_of_all_in_order(values: str, count: int) -> None:
    rng, row = np.random.default_rng(7), np.arange(count)
    given = {
        "by chance": rng.random(count),
        "few": rng.integers(0, 3, count).astype(np.float64),
        "ascending": row / count,
        "alike": np.ones(count),
        "unlike the sample": np.where(row % 64 == 0, 2.0 + row, rng.random(count)),
    }[values]
    ordered = np.sort(given)[::-1]
    for n in {1, 2, count // 3, count // 64, count - 1, count} - {0}:
        if n <= count:
            assert nth_largest(given, n) == ordered[n - 1]


@pytest.mark.parametrize("count", [0, 1, 1 << 18, 700_001])
def test_lists_start_where_those_before_them_end(count: int) -> None:
    lengths = np.random.default_rng(count).integers(0, 9, count).astype(np.int32)
    found = starts_of(lengths)
    np.testing.assert_array_equal(found, np.append(0, np.cumsum(lengths)))
    assert found.dtype == np.int32
