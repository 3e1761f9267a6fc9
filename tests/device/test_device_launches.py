"""Launches are cut so that each work-item runs once, few sizes of work-groups occur, and each keeps
the device for a short time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.device.launches import (
    FIRST_ITEMS,
    LAUNCH_SECONDS,
    LEAST_ITEMS,
    MOST_ITEMS,
    LaunchPacing,
    launch_pieces,
    whole_groups,
)
from rhytid.device.runtime import Device
from synthesis import sheets


@pytest.mark.parametrize("largest_group", [1, 8, 48, 4096])
@pytest.mark.parametrize("count", [1, 7, 63, 64, 65, 127, 128, 18_460])
def test_pieces_cover_a_line_once(count: int, largest_group: int) -> None:
    pieces = launch_pieces((count,), largest_group)
    ranges = [((p.offset or (0,))[0], p.size[0], p.group[0]) for p in pieces]
    assert ranges[0][0] == 0
    assert [a + n for a, n, _ in ranges] == [*(a for a, _, _ in ranges[1:]), count]
    assert all(n % group == 0 and group <= largest_group for _, n, group in ranges)


def test_lines_of_all_lengths_share_two_sizes_of_work_groups() -> None:
    found = {p.group for n in range(1, 1000) for p in launch_pieces((n,), 4096)}
    assert found == {(1,), (64,)}


@pytest.mark.parametrize("size", [(1, 3), (12, 5), (18, 144), (512, 64), (100, 2)])
def test_a_plane_stays_whole_with_groups_along_its_rows(size: tuple[int, int]) -> None:
    [piece] = launch_pieces(size, 4096)
    assert (piece.offset, piece.size) == (None, size)
    assert size[0] % piece.group[0] == 0
    assert piece.group[1] == 1


@pytest.mark.parametrize("count", [1, 63, 64, 65, 97, 1000])
def test_every_work_item_of_a_launch_runs(device: Device, count: int) -> None:
    texels = 16 * count  # a work-item copies 16
    values = np.random.default_rng(count).standard_normal(texels).astype(np.float32)
    out = device.full(texels + 1, np.float32(-9))
    device.launch("copy", "copy_map", (count,), device.upload(values), out)
    read = device.read(out, (texels + 1,), np.float32)
    np.testing.assert_array_equal(read[:-1], values)
    assert read[-1] == -9


def test_pacing_goes_by_what_a_launch_took() -> None:
    pacing = LaunchPacing()
    assert pacing.items("p", "k") == FIRST_ITEMS
    pacing.took("p", "k", FIRST_ITEMS, 10.0)  # it was compiled
    assert pacing.items("p", "k") == LEAST_ITEMS
    for _ in range(4):
        pacing.took("p", "k", pacing.items("p", "k"), 1e-5)
    assert pacing.items("p", "k") == MOST_ITEMS
    pacing.took("p", "k", 64, 1e-5)  # the end of a run says nothing
    assert pacing.items("p", "k") == MOST_ITEMS
    pacing.took("p", "k", 64, 4 * LAUNCH_SECONDS)  # unless even that is slow
    assert pacing.items("p", "k") == LEAST_ITEMS
    assert pacing.items("p", "other") == FIRST_ITEMS


@given(st.lists(st.tuples(st.integers(1, MOST_ITEMS), st.floats(0.0, 100.0)), max_size=20))
def test_launches_are_whole_groups_within_bounds(took: list[tuple[int, float]]) -> None:
    pacing = LaunchPacing()
    for items, seconds in took:
        pacing.took("p", "k", min(items, pacing.items("p", "k")), seconds)
        assert LEAST_ITEMS <= pacing.items("p", "k") <= MOST_ITEMS
        assert pacing.items("p", "k") % 64 == 0


def test_how_work_is_cut_changes_no_bit(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    def made(items: int) -> list[bytes]:
        sizes: list[int] = []

        def fixed(pacing: LaunchPacing, program: str, kernel: str) -> int:
            sizes.append(items)
            return items

        monkeypatch.setattr(LaunchPacing, "items", fixed)
        pores, edges = sheets.net(device, sheets.sheet(), 0.02)
        assert len(pores) > 1024
        return [a.tobytes() for a in (pores.position, pores.uv, edges.nodes, edges.length)]

    assert made(64) == made(256) == made(MOST_ITEMS)


@pytest.mark.parametrize("items", [1, 63, 64, 65, 4097])
@pytest.mark.parametrize("largest", [16, 100, 4096])
def test_whole_groups_are_one_piece(items, largest):
    size = whole_groups(items)
    assert items <= size < items + 64
    assert len(launch_pieces((size,), largest)) == 1
    assert whole_groups(0) == 0
