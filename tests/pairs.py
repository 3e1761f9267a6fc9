"""Few combinations of many choices."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from typing import Any

_Meeting = tuple[tuple[int, int], ...]


def pairs(*choices: Sequence[Any]) -> list[tuple[Any, ...]]:
    """One value of each choice per row; every two values of different choices meet in some row.

    In place of the whole product where a mistake would show in one choice or between two. Always
    the same rows: each is the first of those that bring most new pairs together.
    """
    rows = list(product(*(range(len(values)) for values in choices)))
    missing = {pair for row in rows for pair in _meeting(row)}
    taken = []
    while missing:
        best = max(rows, key=lambda row: len(missing.intersection(_meeting(row))))
        missing.difference_update(_meeting(best))
        taken.append(tuple(values[i] for values, i in zip(choices, best, strict=True)))
    return taken


def _meeting(row: tuple[int, ...]) -> set[_Meeting]:
    """The pairs of (choice, value) of a row; of a single choice its values."""
    placed = list(enumerate(row))
    return set(combinations(placed, min(2, len(placed))))
