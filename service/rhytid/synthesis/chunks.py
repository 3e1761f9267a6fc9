"""Long arrays in blocks, so that what is computed on the way stays small."""

from __future__ import annotations

from collections.abc import Iterator

ROWS = 1 << 19


def row_blocks(count: int) -> Iterator[slice]:
    """The rows 0 to count, ROWS at a time."""
    for first in range(0, count, ROWS):
        yield slice(first, min(first + ROWS, count))
