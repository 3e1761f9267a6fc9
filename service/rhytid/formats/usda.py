"""The head of a USD layer as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rhytid.domain.lengths import millimetres


def usda_header(unit: str, metadata: Sequence[str]) -> list[str]:
    """Lines of the head of a layer, Y up.

    unit: length unit of the layer; without metersPerUnit where it has no known length.  metadata:
    further rows, `name = value`.
    """
    rows = sorted(metadata)
    if (length := millimetres(unit)) is not None:
        rows = sorted([*rows, f"metersPerUnit = {length / 1000!r}"])
    return ["#usda 1.0", "(", *indented([*rows, 'upAxis = "Y"']), ")"]


def indented(rows: Sequence[str]) -> Iterator[str]:
    """Rows of a block of a layer, four spaces to the right."""
    yield from (f"    {row}" if row else "" for row in rows)
