"""MDD and PC2 point caches, written here from their layouts."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rhytid.domain.mesh import ORIGIN
from rhytid.errors import FrameError, LimitError
from rhytid.formats.caches import read_cache
from rhytid.formats.frame_set import MOST_FRAMES, Clip

RNG = np.random.default_rng(3)
FRAMES = RNG.normal(size=(4, 5, 3)).astype(np.float32)
HUGE = 0x7FFFFFFF


def mdd(frames: Any, times: Sequence[float], counts: tuple[int, int] | None = None) -> bytes:
    head = struct.pack(">ii", *(counts or frames.shape[:2]))
    return head + np.asarray(times, ">f4").tobytes() + frames.astype(">f4").tobytes()


def pc2(
    frames: Any, start: float = 1.0, rate: float = 1.0, counts: tuple[int, int] | None = None
) -> bytes:
    samples, points = counts or frames.shape[:2]
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, points, start, rate, samples)
    return head + frames.astype("<f4").tobytes()


def written(folder: Path, name: str, data: bytes) -> Path:
    (folder / name).write_bytes(data)
    return folder / name


def seconds(numbers: Sequence[int], fps: float = 24.0) -> list[float]:
    return [number / fps for number in numbers]


def both(folder: Path) -> list[Path]:
    times = seconds([10, 11, 12, 13])
    files = {"a.mdd": mdd(FRAMES, times), "a.PC2": pc2(FRAMES, 10.0)}
    return [written(folder, name, data) for name, data in files.items()]


def test_frames_and_numbers(tmp_path: Path) -> None:
    for file in both(tmp_path):
        found = read_cache(file, 5)

        assert found.numbers == (10, 11, 12, 13)
        for i in (3, 0, 2, 1):
            positions = found.read(i)
            np.testing.assert_array_equal(positions, FRAMES[i])
            assert positions.dtype == np.dtype(np.float32)
            assert not positions.flags.writeable


def test_the_centre_of_the_mesh_is_subtracted(tmp_path: Path) -> None:
    centre = np.array([8.0, 0.0, -2.0])
    for file in both(tmp_path):
        found = read_cache(file, 5, centre)
        wanted = (FRAMES[1].astype(float) - centre).astype(np.float32)
        np.testing.assert_array_equal(found.read(1), wanted)


def test_times_of_an_mdd_are_frames_at_its_rate(tmp_path: Path) -> None:
    file = written(tmp_path, "a.mdd", mdd(FRAMES, seconds([0, 1, 2, 3], 25.0)))

    assert read_cache(file, 5, ORIGIN, Clip(fps=25.0)).numbers == (0, 1, 2, 3)
    told = r"at frame 0\.96, between whole frames; .* another number of frames per second than 24"
    with pytest.raises(FrameError, match=told):
        read_cache(file, 5)


def test_an_hour_later_times_are_still_frames(tmp_path: Path) -> None:
    numbers = [86_397, 86_398, 86_399, 86_400]
    file = written(tmp_path, "a.mdd", mdd(FRAMES, seconds(numbers)))

    assert read_cache(file, 5).numbers == tuple(numbers)


@pytest.mark.parametrize(
    ("start", "rate", "numbers", "samples"),
    [
        (101.0, 1.0, (101, 102, 103, 104), (0, 1, 2, 3)),
        (0.0, 2.0, (0, 2, 4, 6), (0, 1, 2, 3)),
        (1.0, 0.5, (1, 2), (0, 2)),
        (0.5, 0.5, (1, 2), (1, 3)),
    ],
)
def test_start_and_rate_of_a_pc2(
    tmp_path: Path,
    start: float,
    rate: float,
    numbers: tuple[int, ...],
    samples: tuple[int, ...],
) -> None:
    found = read_cache(written(tmp_path, "a.pc2", pc2(FRAMES, start, rate)), 5)

    assert found.numbers == numbers
    assert found.count == len(samples)
    for i, sample in enumerate(samples):
        np.testing.assert_array_equal(found.read(i), FRAMES[sample])


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (pc2(FRAMES, 1.0, 0.7), r"at frame 1\.7, between .* begins at frame 1 and steps by 0\.7"),
        (pc2(FRAMES, 0.5), r"at frame 0\.5, between whole frames"),
        (pc2(FRAMES, 1.0, 0.0), "sample 1 is at frame 1, not after 1"),
        (pc2(FRAMES, 1.0, -1.0), "sample 1 is at frame 0, not after 1"),
        (pc2(FRAMES, -2.0), "frame -2: the numbers of frames begin at 0"),
        (pc2(FRAMES, np.nan), "sample 0 has no finite time"),
        (pc2(FRAMES[:0]), "the PC2 header has 0 frames of 5 points"),
        (pc2(FRAMES[:, :4]), "4 points per frame, the neutral mesh has 5 vertices"),
        (pc2(FRAMES)[:31], "31 bytes are not a PC2 file: its header has 32"),
        (pc2(FRAMES)[:-1], r"promises 272 bytes \(4 frames of 5 points\), there are 271"),
        (pc2(FRAMES) + b"\0", "promises 272 bytes .*, there are 273"),
        (b"POINTCACHE1" + pc2(FRAMES)[11:], "not a PC2 file"),
        (pc2(FRAMES)[:12] + struct.pack("<i", 2) + pc2(FRAMES)[16:], "not a PC2 file of version 1"),
        (pc2(FRAMES, counts=(-4, -5)), "-4 frames of -5 points"),
    ],
)
def test_a_wrong_pc2(tmp_path: Path, data: bytes, told: str) -> None:
    with pytest.raises(FrameError, match=told):
        read_cache(written(tmp_path, "a.pc2", data), 5)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (mdd(FRAMES, seconds([1, 2, 4, 3])), "sample 3 is at frame 3, not after 4"),
        (mdd(FRAMES, [0.0, np.nan, 1.0, 2.0]), "sample 1 has no finite time"),
        (mdd(FRAMES[:, :4], seconds([1, 2, 3, 4])), "4 points per frame, .* 5 vertices"),
        (b"\0" * 7, "7 bytes are not an MDD file: its header has 8"),
        (mdd(FRAMES, seconds([1, 2, 3, 4]))[:-4], "promises 264 bytes .*, there are 260"),
        (mdd(FRAMES[:0], [], (-1, 5)), "-1 frames of 5 points"),
        (mdd(FRAMES[:0], [], (4, 0)), "4 frames of 0 points"),
    ],
)
def test_a_wrong_mdd(tmp_path: Path, data: bytes, told: str) -> None:
    with pytest.raises(FrameError, match=told):
        read_cache(written(tmp_path, "a.mdd", data), 5)


@pytest.mark.parametrize("counts", [(HUGE, 5), (4, HUGE), (HUGE, HUGE)])
def test_a_header_that_promises_the_world_takes_no_memory(
    tmp_path: Path, counts: tuple[int, int]
) -> None:
    files = {
        "a.mdd": mdd(FRAMES, seconds([1, 2, 3, 4]), counts),
        "a.pc2": pc2(FRAMES, counts=counts),
    }
    for name, data in files.items():
        file = written(tmp_path, name, data)
        tracemalloc.start()
        try:
            with pytest.raises(FrameError, match="header promises"):
                read_cache(file, counts[1])
            assert tracemalloc.get_traced_memory()[1] < 1_000_000
        finally:
            tracemalloc.stop()


def test_counts_beyond_int32_are_negative_and_refused(tmp_path: Path) -> None:
    head = struct.pack(">II", 4_000_000_000, 5)
    with pytest.raises(FrameError, match="-294967296 frames of 5 points"):
        read_cache(written(tmp_path, "a.mdd", head), 5)


def test_too_many_frames(tmp_path: Path) -> None:
    frames = np.zeros((MOST_FRAMES + 1, 1, 3), np.float32)
    with pytest.raises(LimitError, match=f"at most {MOST_FRAMES}"):
        read_cache(written(tmp_path, "a.pc2", pc2(frames)), 1)


def test_only_the_frame_that_is_wrong_is_refused(tmp_path: Path) -> None:
    frames = FRAMES.copy()
    frames[2, 4, 1] = np.inf
    found = read_cache(written(tmp_path, "a.pc2", pc2(frames, 7.0)), 5)

    np.testing.assert_array_equal(found.read(1), FRAMES[1])
    with pytest.raises(FrameError, match=r"frame 9: frame vertex 4 is \[.*inf"):
        found.read(2)


def test_frames_are_read_when_they_are_asked_for(tmp_path: Path) -> None:
    """What changes in the file after it was opened is what is read."""
    file = written(tmp_path, "a.pc2", pc2(FRAMES))
    found = read_cache(file, 5)
    file.write_bytes(pc2(FRAMES[::-1]))

    np.testing.assert_array_equal(found.read(0), FRAMES[3])
    file.write_bytes(pc2(FRAMES)[:100])
    with pytest.raises(FrameError, match="frame 4: the file has become shorter"):
        found.read(3)
