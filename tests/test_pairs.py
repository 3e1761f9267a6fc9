"""What `pairs` promises to the tests that use it."""

from __future__ import annotations

from itertools import combinations, product

import pytest

from pairs import pairs


@pytest.mark.parametrize("sizes", [(3,), (2, 2), (3, 3, 2, 4, 2), (1, 5, 2), (2,) * 6])
def test_every_two_values_of_different_choices_meet(sizes: tuple[int, ...]) -> None:
    choices = [[f"{name}{i}" for i in range(size)] for name, size in enumerate(sizes)]
    rows = pairs(*choices)
    for one, other in combinations(range(len(sizes)), 2):
        met = {(row[one], row[other]) for row in rows}
        assert met == set(product(choices[one], choices[other]))
    assert {row[0] for row in rows} == set(choices[0])
    assert rows == pairs(*choices)


def test_many_choices_need_few_rows() -> None:
    assert len(pairs(*[[0, 1]] * 6)) <= 10  # of 64
    assert len(pairs([1, 4, 16], [3, 5, 7], [8, 16], range(4), [0, 1])) <= 16  # of 144
