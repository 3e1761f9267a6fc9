"""Memory of an array that is gone is that of the next one, never that of one that is held."""

from __future__ import annotations

import gc

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from rhytid.engine.tiles.maps import MemoryAgain

SHAPE = (64, 32)


def place(array: NDArray[np.float32]) -> int:
    return array.__array_interface__["data"][0]


def test_the_memory_of_an_array_that_is_gone_is_that_of_the_next_one() -> None:
    memory = MemoryAgain()
    with memory.kept():
        first = memory.empty(SHAPE, np.float32)
        other = memory.empty(SHAPE, np.float32)
        assert first.shape == SHAPE
        assert first.dtype == np.float32
        assert first.flags.writeable
        assert place(first) != place(other)
        first.setflags(write=False)
        before = place(first)
        del first
        others = [np.empty(SHAPE, np.float32) for _ in range(3)]  # what malloc has freed
        again = memory.empty(SHAPE, np.float32)
        assert place(again) == before
        assert again.flags.writeable
        assert before not in map(place, others)
        assert place(memory.empty((2, *SHAPE), np.float32)) != before


def test_memory_of_which_a_part_is_held_is_not_used_again() -> None:
    parts = [
        lambda array: array[3:5, 7:],
        lambda array: array.reshape(-1)[5:].view(np.int32)[::2],
        lambda array: memoryview(array),
        lambda array: as_strided(array, (5,), (4,)),
    ]
    memory = MemoryAgain()
    for part_of in parts:
        with memory.kept():
            array = memory.empty(SHAPE, np.float32)
            array[...], before = 7.0, place(array)
            part = part_of(array)
            del array
            gc.collect()
            other = memory.empty(SHAPE, np.float32)
            other[...] = 1.0
            assert place(other) != before
            assert np.all(np.asarray(part).view(np.float32) == 7.0)
            del part
            assert place(memory.empty(SHAPE, np.float32)) == before


def test_nothing_is_kept_outside_of_a_block() -> None:
    memory = MemoryAgain()
    with memory.kept():
        with memory.kept():
            before = place(memory.empty(SHAPE, np.float32))
        held = memory.empty(SHAPE, np.float32)
        assert place(held) == before  # the outer block goes on
    assert not memory._spare
    held[...] = 2.0  # still its own
    del held
    assert not memory._spare
    assert memory.empty(SHAPE, np.float32).base is None
