"""Launches are cut so that each work-item runs once and few sizes of work-groups occur."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.device.work_groups import launch_pieces


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
