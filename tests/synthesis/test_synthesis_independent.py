"""The rounds of the greedy independent set give what the loop gives."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rhytid.device.runtime import Device
from rhytid.synthesis.incidence import independent_set
from rhytid.synthesis.workspace import Workspace

COUNT = 12
items = st.integers(0, COUNT - 1)
conflicts = st.lists(st.tuples(items, items).filter(lambda pair: pair[0] != pair[1]), max_size=40)


keys = st.lists(st.integers(0, 5), min_size=COUNT, max_size=COUNT)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(key=keys, pairs=conflicts)
def test_rounds_equal_the_loop(
    device: Device, key: list[int], pairs: list[tuple[int, int]]
) -> None:
    kept: list[int] = []
    for item in sorted(range(COUNT), key=lambda i: (key[i], i)):
        if not any((item, k) in pairs or (k, item) in pairs for k in kept):
            kept.append(item)
    with Workspace(device) as work:
        found = independent_set(
            work, np.array(key, np.float32), np.array(pairs, np.int32).reshape(-1, 2)
        )
    assert np.flatnonzero(found).tolist() == sorted(kept)
