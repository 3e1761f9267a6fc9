"""The rounds of the greedy independent set give what the loop gives."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rhytid.synthesis.independent import independent_set

COUNT = 12
items = st.integers(0, COUNT - 1)
conflicts = st.lists(st.tuples(items, items).filter(lambda pair: pair[0] != pair[1]), max_size=40)


@given(conflicts)
def test_rounds_equal_the_loop(pairs: list[tuple[int, int]]) -> None:
    kept: list[int] = []
    for item in range(COUNT):
        if not any((item, k) in pairs or (k, item) in pairs for k in kept):
            kept.append(item)
    found = independent_set(COUNT, np.array(pairs, np.int64).reshape(-1, 2))
    assert np.flatnonzero(found).tolist() == kept
