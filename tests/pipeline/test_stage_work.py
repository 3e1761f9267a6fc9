"""The work of drawing a square, as it is known from the lists, and how squares are cut by it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pipeline.scenes import random_graph, settings_of
from rhytid.device.launches import PIECE_SECONDS, DrawingPace
from rhytid.errors import LimitError
from rhytid.pipeline import measured_shape, work
from rhytid.pipeline.cells import list_by_cell
from rhytid.pipeline.element_arrays import check_cover, wrinkle_arrays
from rhytid.pipeline.measured_shape import remembered_pace
from rhytid.pipeline.work import BLOCK, DrawLimit, MapWork, work_around, work_by_cell

CELLS = 8
RESOLUTION = CELLS * BLOCK


def boxes(count, seed=1):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-0.2, 1.1, (count, 2))
    return low, low + rng.uniform(0, 0.4, (count, 2)) ** 2


def brute(low, high):
    """Work of each cell, box by box."""
    found = np.zeros((CELLS, CELLS))
    lists = list_by_cell(low, high, CELLS, top_down=True)
    for cell, (first, last) in enumerate(pairwise(lists.offsets)):
        row, column = divmod(cell, CELLS)
        corner = np.array([column, CELLS - 1 - row]) * BLOCK
        for member in lists.members[first:last]:
            start = np.clip(low[member] * RESOLUTION - corner, 0, BLOCK)
            stop = np.clip(high[member] * RESOLUTION - corner, 0, BLOCK)
            sides = np.clip(stop - start + 1, 1, BLOCK)
            found[row, column] += sides.prod() + work._ELEMENT
    return lists, found


@pytest.mark.parametrize("chunk", [1 << 20, 7])
def test_the_work_of_a_block_is_the_texels_that_its_elements_cover(monkeypatch, chunk):
    monkeypatch.setattr(work, "_CHUNK", chunk)
    low, high = boxes(60)
    lists, wanted = brute(low, high)
    assert wanted.max() > 0
    np.testing.assert_allclose(work_by_cell(lists, low, high), wanted, rtol=1e-5)


@pytest.fixture(scope="module")
def map_work():
    graph = random_graph(2, 300, (0.001, 0.05))
    lists = wrinkle_arrays(graph, np.zeros(300, np.int32), settings_of(resolution=1024), 1001).lists
    assert lists.work is not None
    return MapWork(lists)


def test_squares_have_the_work_of_their_blocks(map_work):
    blocks = [map_work.of(r, c, BLOCK) for r in range(0, 1024, 64) for c in range(0, 1024, 64)]
    assert map_work.of(0, 0, 1024) == pytest.approx(sum(blocks)) == pytest.approx(map_work.total)
    assert map_work.densest == pytest.approx(max(blocks))
    assert map_work.of(-512, -512, 2048) == pytest.approx(map_work.total)


@pytest.mark.parametrize("side", [1024, 704, 64])
@pytest.mark.parametrize("share", [2.0, 0.3, 0.02, 0.0])
def test_cut_squares_cover_everything_within_the_work(map_work, side, share):
    most, covered = share * map_work.total, np.zeros((side, side), np.int32)
    for row, column, part in map_work.cut((0, 0, side), most, 512):
        assert part == BLOCK or (map_work.of(row, column, part) <= most and part <= 512)
        covered[row : row + part, column : column + part] += 1
    assert covered.min() == 1
    assert side == 704 or covered.max() == 1


@pytest.mark.parametrize("share", [2.0, 0.1, 0.0])
def test_every_cut_square_is_found_from_what_lies_in_it(map_work, share):
    most = share * map_work.total
    for piece in map_work.cut((0, 0, 1024), most, 512):
        assert map_work.is_piece(piece, most, 512)
        row, column, side = piece
        inside = (row + side - BLOCK, column, BLOCK)
        assert map_work.around(inside, most, 512) == piece


def test_blocks_of_a_broad_layer_count_whole():
    none = np.zeros((0, 2))
    blank = list_by_cell(none, none, 16, top_down=True)
    coarse = replace(
        list_by_cell(none, none, 4, top_down=True), work=np.full((4, 4), 1e6, np.float32)
    )
    both, fine, factor = MapWork(blank, cushion=(coarse, 4)), MapWork(blank), 4
    alone = both.of(0, 0, BLOCK)
    assert alone == pytest.approx(1e6, rel=0.01)
    assert both.of(BLOCK, BLOCK * 3, BLOCK) == alone
    assert both.of(0, 0, BLOCK * factor) - fine.of(0, 0, BLOCK * factor) == pytest.approx(
        alone - fine.of(0, 0, BLOCK)
    )
    # What cannot be halved is no reason to cut.
    assert both.is_piece((0, 0, BLOCK * factor), 0.5 * alone, 512)
    assert not both.is_piece((0, 0, 2 * BLOCK * factor), 0.5 * alone, 512)


def test_a_pace_follows_what_takes_too_long_and_what_is_much_faster():
    pace = DrawingPace(1e6)
    assert pace.most == pytest.approx(PIECE_SECONDS * 1e6)
    pace.took(pace.most, 1.5 * PIECE_SECONDS)  # within a factor of two nothing changes
    pace.took(pace.most, PIECE_SECONDS / 1.5)
    assert pace.per_second == 1e6
    pace.took(pace.most, 3 * PIECE_SECONDS)
    assert pace.per_second == pytest.approx(1e6 / 3)
    pace.took(pace.most, 100.0)  # a compiler, perhaps
    assert pace.per_second == pytest.approx(1e6 / 12)
    pace.took(pace.most, PIECE_SECONDS / 100)
    assert pace.per_second == pytest.approx(1e6 / 6)
    pace.took(1.0, PIECE_SECONDS / 2)  # so little says nothing
    assert pace.per_second == pytest.approx(1e6 / 6)


def test_the_work_of_boxes_is_about_that_of_their_lists():
    low, high = boxes(200, 3)
    inside = (high > 0).all(axis=1) & (low < 1).all(axis=1)
    low, high = low[inside], high[inside]
    wanted = brute(low, high)[1][::-1]
    found = work_around(low, high, RESOLUTION)
    assert found.sum() == pytest.approx(wanted.sum(), rel=0.15)
    assert found.max() == pytest.approx(wanted.max(), rel=0.3)


def test_graphs_that_take_too_long_are_refused():
    graph, settings = random_graph(5), settings_of()
    check_cover(graph, settings, 1001, DrawLimit(60, 5e8))
    with pytest.raises(
        LimitError,
        match=r"drawing 80 wrinkles of UDIM 1001 would take about \S+ s on this device at 256² "
        r"texels: more than 0.01 s \(RHYTID_DRAW_SECONDS\)",
    ):
        check_cover(graph, settings, 1001, DrawLimit(0.01, 1e5))
    with pytest.raises(LimitError, match=r"where they are densest, in 64² of 256² texels: more"):
        check_cover(graph, settings, 1001, DrawLimit(600, 1e5))
    check_cover(graph, settings, 1003, DrawLimit(0.01, 1e5))  # of which the graph has no part


def test_a_pace_is_measured_once_and_remembered(device, tmp_path, monkeypatch):
    pace = remembered_pace(device, tmp_path)
    assert pace > 0
    monkeypatch.setattr(measured_shape, "patch_pace", lambda device: 7.0)
    assert remembered_pace(device, tmp_path) == pace
    (tmp_path / "draw_paces.json").write_text("{")
    assert remembered_pace(device, tmp_path) == remembered_pace(device, tmp_path) == 7.0
