"""What is deflated is read back by zlib, and follows from the data alone."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.formats.deflate import deflated

# Runs of two bytes after a first one, as blocks of constant texels are.
RUNS = [bytes([n]) + bytes([n + 1, 255 - n]) * 400 for n in range(60)]
# A stretch of memory by which the state of ISA-L lies elsewhere.
PLACE = 1 << 16


@given(st.binary(max_size=64))
def test_short_data_are_read_back(data: bytes) -> None:
    assert zlib.decompress(deflated(data)) == data


@pytest.mark.parametrize("size", [15, 16, 17, 300, 100_000])
def test_arrays_are_read_back(size: int) -> None:
    data = np.random.default_rng(size).integers(0, 9, size).astype(np.uint8)
    assert zlib.decompress(deflated(data.data)) == data.tobytes()


def test_the_bytes_are_the_same_at_any_place_in_memory() -> None:
    expected = [deflated(data) for data in RUNS]
    kept = []
    for _ in range(300):
        kept.append(bytearray(PLACE))
        assert [deflated(data) for data in RUNS] == expected
