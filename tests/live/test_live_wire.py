"""Messages of a live connection, whatever they hold: read as they are, or refused with a code."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rhytid.api.live.wire import (
    CLOSE_CODES,
    LiveClosed,
    read_frame,
    read_opening,
    read_view,
    tile_message,
)
from rhytid.errors import QueryError
from rhytid.formats.tile_header import TileHeader

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=4,
)
KEYS = ("message", "tiles", "camera", "method", "format", "scale", "tolerance", "shapes")
GOOD: dict[str, Any] = {"message": "open", "tiles": [[1001, 0, 0, 0]], "method": "binned"}
HEADERS = st.dictionaries(st.sampled_from(KEYS), JSON).map(lambda some: json.dumps(GOOD | some))


def read_or_refused(read: Callable[..., Any], *arguments: Any) -> Any:
    """What is read; None where it is refused as it should be."""
    try:
        return read(*arguments)
    except LiveClosed as closed:
        end = closed
    assert end.code in CLOSE_CODES
    assert 0 < len(end.reason.encode()) <= 123
    return None


@settings(max_examples=40)
@given(HEADERS | JSON.map(json.dumps) | st.text(max_size=60))
def test_any_header_is_read_or_refused(text: str) -> None:
    for read in (read_opening, read_view):
        found = read_or_refused(read, text)
        assert found is None or (found.camera is None) == bool(found.addresses())


FRAMES = st.tuples(
    st.integers(0, 2**64 - 1), st.integers(0, 3), st.integers(0, 5), st.binary(max_size=60)
).map(lambda frame: struct.pack("<QII", *frame[:3]) + frame[3])


@given(FRAMES | st.binary(max_size=20), st.integers(-1, 2**64 - 1))
def test_any_frame_is_read_or_refused(message: bytes, after: int) -> None:
    found = read_or_refused(read_frame, message, after, 3, 2)
    if found is not None:
        assert found.number > after
        assert len(found.content) == {1: 36, 2: 8}[found.kind] == len(message) - 16


def header() -> TileHeader:
    return TileHeader("cm", "", "a", "binned", "tensor", "nearest", 1011, 2, 3, 4, 0.5)


@pytest.mark.parametrize("format", ["f32", "f16", "u16"])
def test_a_tile_is_written_as_it_is_described(format: str) -> None:
    tile = np.linspace(-0.25, 0.25, 16, dtype=np.float32).reshape(4, 4)
    message = tile_message(2**40, tile, header(), format, 0.5, dropped=2**40)
    fields = struct.unpack_from("<QIIIIIHHIf", message)
    assert fields[:6] == (2**40, 1011, 2, 3, 4, 4)
    assert fields[7:] == (0, 2**32 - 1, 0.5)
    kind = {"f32": "<f4", "f16": "<f2", "u16": "<u2"}[format]
    values = np.frombuffer(message, kind, offset=40).reshape(4, 4).astype(float)
    found = (values - 32768) / 32767 * 0.5 if format == "u16" else values
    bound = {"f32": 0, "f16": 2**-13, "u16": 0.5 / 65534}[format]
    assert np.abs(found - tile).max() <= 1.01 * bound


def test_a_tile_beyond_half_floats_is_refused() -> None:
    with pytest.raises(QueryError, match="does not fit half floats"):
        tile_message(1, np.full((2, 2), 7e4, np.float32), header(), "f16", 1.0, 0)
