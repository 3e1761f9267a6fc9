"""Lists of what overlaps each cell of a grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.errors import LimitError
from rhytid.pipeline import cells
from rhytid.pipeline.cells import list_by_cell


def overlapping(low, high, count, top_down):
    """The same lists, a cell at a time; a box that ends at a border counts in both cells."""
    found = []
    for cell in range(count * count):
        row, column = divmod(cell, count)
        corner = np.array([column, count - 1 - row if top_down else row])
        touches = (low * count < corner + 1).all(axis=1) & (high * count >= corner).all(axis=1)
        found.append(np.flatnonzero(touches).tolist())
    return found


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 5]), st.booleans())
def test_lists_hold_what_overlaps_in_ascending_order(seed, count, top_down):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-0.6, 1.4, (20, 2))
    high = low + rng.uniform(0, 0.7, (20, 2))
    low[3], high[3] = np.inf, -np.inf  # a box of nothing
    lists = list_by_cell(low, high, count, top_down=top_down)
    found = [m.tolist() for m in np.split(lists.members, lists.offsets[1:-1])]
    assert found == overlapping(low, high, count, top_down)
    assert (lists.offsets[0], lists.offsets[-1]) == (0, len(lists.members))


def test_no_boxes_give_empty_lists():
    lists = list_by_cell(np.zeros((0, 2)), np.zeros((0, 2)), 3, top_down=True)
    np.testing.assert_array_equal(lists.offsets, np.zeros(10))
    assert len(lists.members) == 0


def test_more_entries_than_can_be_counted_are_refused(monkeypatch):
    monkeypatch.setattr(cells, "MOST_ENTRIES", 7)
    with pytest.raises(LimitError, match=r"8 entries .* 7"):
        list_by_cell(np.zeros((2, 2)), np.ones((2, 2)) * 0.99, 2, top_down=True)
