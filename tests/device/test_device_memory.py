"""Device memory: the budget with what lies spare, and the largest buffer of a driver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.device.budget import BufferPool, MemoryBudget
from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.errors import DeviceMemoryError


class Handle:
    """Memory of a driver that counts what is held of it."""

    held = 0

    def __init__(self, nbytes):
        self.nbytes = nbytes
        Handle.held += nbytes

    def release(self):
        Handle.held -= self.nbytes


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 40)), max_size=60))
def test_what_is_used_and_spare_never_passes_the_limit(steps):
    Handle.held = 0
    spares = BufferPool(60)
    budget = MemoryBudget(100, spares)
    used = []
    for take, size in steps:
        if take:
            try:
                spare = budget.reserve(size, reuse=True)
            except DeviceMemoryError:
                continue
            used.append(spare or Handle(size))
        elif used:
            handle = used.pop()
            budget.free(handle.nbytes)
            spares.leave(handle, handle.nbytes)
        assert Handle.held == budget.used + spares.held
        assert Handle.held <= 100
        assert spares.held <= 60


def test_sizes_that_are_used_again_leave_nothing_behind():
    spares = BufferPool()
    for size in range(1, 100):
        spares.leave(Handle(size), size)
        spares.take(size)
    assert (spares.held, len(spares._handles)) == (0, 0)


class Kept:
    def __init__(self, budget, nbytes):
        budget.reserve(nbytes)
        self._budget, self.nbytes, self.released = budget, nbytes, False

    def release(self):
        self.released = True
        self._budget.free(self.nbytes)


def test_spare_memory_goes_before_anything_that_is_kept():
    spares = BufferPool()
    budget = MemoryBudget(100, spares)
    kept = budget.keep("map", lambda: Kept(budget, 40))
    budget.new_task()
    budget.reserve(50)
    budget.free(50)
    spares.leave(Handle(50), 50)
    budget.reserve(60)
    assert spares.held == 0
    assert not kept.released
    budget.free(60)
    budget.reserve(61)
    assert kept.released


def test_what_is_dropped_to_make_room_is_used_again(device):
    small = Device(device.info, 1000)
    old = small.budget.keep("old", lambda: small.empty(600, np.uint8))
    small.budget.new_task()
    assert small.empty(600, np.uint8).handle is old.handle


def test_buffers_of_a_device_stay_within_its_budget(device):
    small = Device(device.info, 1000)
    for size in (600, 300, 900, 200, 700, 1000):
        buffer = small.empty(size, np.uint8)
        assert small.budget.used == size
        buffer.release()
        assert small.budget.used + small.pool.held <= 1000
        again = small.empty(size, np.uint8)
        assert again.handle is buffer.handle
        again.release()


def test_what_is_uploaded_again_takes_spare_memory_after_the_launches_that_read_it(device):
    count, values = 1 << 22, np.arange(1 << 22, dtype=np.float32)
    small, out = Device(device.info, 1 << 26), []
    spare = small.upload(values)
    for turn in range(3):
        out.append(small.empty(count, np.float32))
        small.launch("copy", "copy_map", (count // 16,), spare, out[-1])
        spare.release()
        again = small.upload_again(values + turn)
        assert again.handle is spare.handle
        spare = again
    for buffer, wanted in zip([*out[1:], spare], range(3), strict=True):
        np.testing.assert_array_equal(small.read(buffer, (count,), np.float32), values + wanted)
    assert small.upload_again(np.zeros((0, 3), np.float32)).nbytes == 0


def test_a_buffer_above_the_largest_of_the_driver_is_refused_with_both_numbers(device):
    limited = Device(replace(device.info, largest_buffer=4096), 1 << 20)
    limited.empty(4096, np.uint8).release()
    with (
        pytest.raises(DeviceMemoryError, match=r"4100 bytes.* 4096 bytes at most"),
        limited.task(),
    ):
        limited.empty(1025, np.float32)
    assert limited.budget.used == 0
    with pytest.raises(DeviceMemoryError, match=r"8192 bytes.* 4096 bytes"), limited.task():
        limited.upload(np.zeros(2048, np.float32))
    assert limited.budget.used == 0


def test_the_driver_says_what_its_largest_buffer_is(device):
    assert 0 < device.info.largest_buffer == device.info.handle.max_mem_alloc_size


def test_a_processor_reads_an_array_that_is_lent_where_it_lies(device):
    values = np.arange(1 << 12, dtype=np.int32)[::-1].copy()
    small = Device(device.info, 1 << 20)
    lent, out = small.lend(values), small.full(len(values), np.int32(0))
    assert small.budget.used == 2 * values.nbytes
    assert np.shares_memory(lent.host, values)
    count_up(small, lent, out, len(values))
    np.testing.assert_array_equal(small.read(out, values.shape, np.int32), 1)
    lent.release()
    lent.release()
    assert (small.budget.used, small.pool.held) == (values.nbytes, 0)
    small.full(len(values), np.int32(7))  # not in the memory of the array
    small.finish()
    np.testing.assert_array_equal(values, np.arange(1 << 12)[::-1])
    assert small.lend(np.zeros((0, 3), np.float32)).nbytes == 0


def count_up(device: Device, numbers: Buffer, counts: Buffer, count: int) -> None:
    """Add to the count of each number how often it is among `count`."""
    place = np.int32(0), np.int32(count)
    device.launch("incidence", "count_pairs", (count,), *place, numbers, counts)


def test_an_array_that_lies_off_the_bounds_of_vectors_is_copied(device):
    values = np.zeros(1001, np.int32)
    off = values[1:] if values.ctypes.data % 16 == 0 else values[:1000]
    small = Device(device.info, 1 << 20)
    lent, out = small.lend(off), small.full(1000, np.int32(0))
    assert lent.host is None
    count_up(small, lent, out, 1000)
    assert small.read(out, (1000,), np.int32)[0] == 1000


def test_what_a_processor_gives_back_is_memory_that_nothing_else_uses(device):
    values = np.arange(1 << 12, dtype=np.float32)
    small = Device(device.info, 1 << 20)
    spare = small.upload(values)
    for _ in range(2):
        out = small.readable(len(values), np.float32)
        small.launch("copy", "copy_map", (len(values) // 16,), spare, out)
        found = small.read(out, (64, 64), np.float32)
        assert np.shares_memory(out.host, found)
        out.release()
        assert (small.budget.used, small.pool.held) == (values.nbytes, 0)
        small.full(len(values), np.float32(7.0)).release()
        np.testing.assert_array_equal(found.ravel(), values)
        small.pool.shrink(0)
    none = small.read(small.readable(1000, np.int32, zero=True), (1000,), np.int32)
    np.testing.assert_array_equal(none, np.zeros(1000, np.int32))


def test_a_device_with_memory_of_its_own_takes_copies(device):
    values = np.arange(1 << 12, dtype=np.float32)
    card = Device(replace(device.info, kind="gpu"), 1 << 20)
    lent, out = card.lend(values), card.readable(len(values), np.float32, zero=True)
    np.testing.assert_array_equal(card.read(out, values.shape, np.float32), 0.0 * values)
    values[:] = -1.0
    card.launch("copy", "copy_map", (len(values) // 16,), lent, out)
    found = card.read(out, values.shape, np.float32)
    np.testing.assert_array_equal(found, np.arange(1 << 12))
    assert lent.host is None
    assert out.host is None
    lent.release()
    assert card.pool.held == lent.nbytes
