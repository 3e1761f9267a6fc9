"""Which groups of wrinkles and pores a square needs, beside sets of what lists name."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.pipeline.cells import CellLists
from rhytid.pipeline.nearby import Groups, NearbyElements
from rhytid.pipeline.vectors import VECTOR, VectorTriangles
from rhytid.pipeline.work import BLOCK

COUNT, CELLS = 400, 8
SQUARES = [(0, 0, 64), (128, 64, 64), (448, 448, 64), (0, 256, 256), (128, 128, 128), (0, 0, 512)]


def random_lists(seed, cells, most):
    """Up to so many elements a cell; those of one cell may go on in the next."""
    random, members = np.random.default_rng(seed), []
    for _ in range(cells * cells):
        first, size = random.integers(0, COUNT - 40), random.integers(0, most)
        members.append(np.sort(first + random.permutation(40)[:size]).astype(np.int32))
    offsets = np.concatenate([[0], np.cumsum([len(some) for some in members])]).astype(np.int32)
    return CellLists(cells, offsets, np.concatenate(members))


def named(lists, square, side):
    """The members of every cell of a square."""
    row, column, texels = square
    found = set()
    for y in range(lists.cells):
        for x in range(lists.cells):
            inside = y * side < row + texels and row < (y + 1) * side
            if inside and x * side < column + texels and column < (x + 1) * side:
                cell = y * lists.cells + x
                found |= set(lists.members[lists.offsets[cell] : lists.offsets[cell + 1]].tolist())
    return found


def read(device, groups):
    return device.read(groups.numbers, (groups.count,), np.int32).tolist()


@pytest.mark.parametrize("square", SQUARES)
@pytest.mark.parametrize(("most", "count"), [(6, COUNT), (1, COUNT + 1), (30, COUNT)])
def test_groups_are_those_of_listed_elements_and_of_what_continues_them(
    device, square, most, count
):
    fine, coarse = random_lists(1, CELLS, most), random_lists(2, CELLS // 2, most)
    pores = random_lists(3, CELLS, most)
    partners = np.random.default_rng(4).integers(-1, count, (count, 2)).astype(np.int32)
    partners[::3] = -1
    nearby = NearbyElements(fine, pores, count, partners, (coarse, 2))
    found = nearby.of(device, square)
    lines = {i // VECTOR for i in named(fine, square, BLOCK) | named(coarse, square, 2 * BLOCK)}
    assert read(device, found.wrinkles) == sorted(lines | {count // VECTOR})
    if count % VECTOR:  # beside none there are wrinkles, which answer, too
        lines.add(count // VECTOR)
    whole = [i for i in range(count) if i // VECTOR in lines]
    beside = {int(i) // VECTOR for i in partners[whole].reshape(-1) if i >= 0}
    assert read(device, found.answering) == sorted(lines | beside)
    assert read(device, found.pores) == sorted({i // VECTOR for i in named(pores, square, BLOCK)})
    alone = NearbyElements(fine, pores, count, None).of(device, square)
    lines = {i // VECTOR for i in named(fine, square, BLOCK)}
    lines |= {count // VECTOR} if count % VECTOR else set()
    assert read(device, alone.answering) == sorted(lines)


def test_a_group_that_goes_on_in_the_next_block_is_of_both(device):
    lists = CellLists(2, np.array([0, 1, 2, 2, 4], np.int32), np.array([3, 5, 6, 40], np.int32))
    nearby = NearbyElements(lists, lists, 41, None)
    squares = [(row, column, BLOCK) for row in (0, BLOCK) for column in (0, BLOCK)]
    found = [read(device, nearby.of(device, square).pores) for square in squares]
    assert found == [[0], [0], [], [0, 2]]


def test_nothing_is_listed_where_there_is_nothing(device):
    none = CellLists(CELLS, np.zeros(CELLS**2 + 1, np.int32), np.zeros(0, np.int32))
    found = NearbyElements(none, none, 0, None).of(device, (0, 0, 512))
    assert [groups.count for groups in (found.wrinkles, found.answering, found.pores)] == [1, 0, 0]


@pytest.mark.parametrize("numbers", [[0], [15, 16, 400, 0, 16], [7, 40, 41, 40, 90, 333, 6]])
def test_groups_of_triangles_are_those_under_some_texel(device, numbers):
    members = np.array([(number, 1) for number in numbers], np.int32)
    firsts = np.array([0, len(members)], np.int32)
    held = VectorTriangles(device.upload(firsts), device.upload(members))
    found = Groups.of_triangles(device, held)
    assert read(device, found) == sorted({number // VECTOR for number in numbers})
