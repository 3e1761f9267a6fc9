"""The arrays of a graph while it is put together, and long arrays in blocks of rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from rhytid.support import cancellation

Arrays = dict[str, NDArray[Any]]


ROWS = 1 << 19


def row_blocks(count: int) -> Iterator[slice]:
    """The rows 0 to count, ROWS at a time, unless the work is to stop."""
    for first in range(0, count, ROWS):
        cancellation.check()
        yield slice(first, min(first + ROWS, count))
