"""Frame positions in request bodies and in files of the command line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from formats.writers import SQUARE, SQUARE_ARRAYS, npy, npy_header, npz, obj
from rhytid.errors import FrameError, LimitError
from rhytid.formats.frames import NPY, RAW, read_frame_file, read_positions

FRAMES = np.stack([SQUARE, SQUARE * 2])
PROMISE = "{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3)}"


@pytest.mark.parametrize(
    ("body", "media_type"),
    [
        (SQUARE.tobytes(), RAW),
        (SQUARE.tobytes(), "Application/Octet-Stream; x=1"),
        (npy(SQUARE), NPY),
        (npy(SQUARE.astype(">f8")), NPY),
        (npy(np.asfortranarray(SQUARE.astype("f2"))), NPY),
    ],
)
def test_bodies_of_one_frame(body: bytes, media_type: str) -> None:
    frame = read_positions(body, media_type, 4)
    assert (frame.dtype, frame.flags.writeable, frame.flags.aligned) == (np.float32, False, True)
    np.testing.assert_array_equal(frame, SQUARE)


@pytest.mark.parametrize(
    ("body", "media_type", "message"),
    [
        (b"", RAW, "frame is 0 bytes: 4 vertices of 3 float32 are 48"),
        (SQUARE.tobytes()[:-1], RAW, "frame is 47 bytes: 4 vertices of 3 float32 are 48"),
        (FRAMES.tobytes(), RAW, "frame is 96 bytes"),
        ((SQUARE + np.float32(np.inf)).tobytes(), RAW, "frame vertex 0 is .*not finite"),
        (b"", NPY, "frame is not a .npy array"),
        (SQUARE.tobytes(), NPY, "frame is not a .npy array"),
        (npy(SQUARE[:3]), NPY, r"frame has shape \(3, 3\), not \(4, 3\)"),
        (npy(SQUARE.ravel()), NPY, r"frame has shape \(12,\)"),
        (npy(SQUARE)[:-1], NPY, "frame: the header promises 176 bytes, there are 175"),
        (npy(SQUARE) + b"\0", NPY, "promises 176 bytes, there are 177"),
        (npy(SQUARE.astype(object)), NPY, r"Python objects \(a pickle\)"),
        (npy(SQUARE.astype(complex)), NPY, "complex"),
        (npy(SQUARE.astype(float) * 1e39), NPY, "frame vertex 0 is .*not finite"),
        (npy(SQUARE), "text/plain", "media type 'text/plain': must be application/x-npy or"),
        (npy(SQUARE), "", "media type ''"),
    ],
)
def test_refused_bodies(body: bytes, media_type: str, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        read_positions(body, media_type, 4)


def test_a_header_that_promises_the_world_allocates_nothing() -> None:
    header = npy_header(PROMISE.replace("4, 3", "1000000000, 3"))
    with pytest.raises(LimitError, match="frame holds 3000000000 numbers: at most 200000000"):
        read_positions(header, NPY, 1_000_000_000)


@pytest.mark.parametrize(
    ("data", "name", "wanted"),
    [
        (npy(SQUARE), "a.npy", FRAMES[:1]),
        (npy(FRAMES), "a.NPY", FRAMES),
        (npz(frames=FRAMES), "a.npz", FRAMES),
        (npz(frames=FRAMES.astype(">f8"), names=np.array([None])), "a.npz", FRAMES),
        (obj(*SQUARE_ARRAYS), "dir.npy/a.Obj", FRAMES[:1]),
        (b"v 0 0 0.5\nv 1 0 0\nv 1 1 0\nv 0 1 0.25", "a.obj", FRAMES[:1]),
    ],
)
def test_files(data: bytes, name: str, wanted: Any) -> None:
    frames = read_frame_file(data, name, 4)
    assert (frames.dtype, frames.flags.writeable) == (np.float32, False)
    np.testing.assert_array_equal(frames, wanted)


@pytest.mark.parametrize(
    ("data", "name", "message"),
    [
        (npy(SQUARE[:3]), "a.npy", r"frames have shape \(1, 3, 3\), not \(N, 4, 3\)"),
        (npy(SQUARE.ravel()), "a.npy", r"frames have shape \(12,\)"),
        (npy(FRAMES * [[[1], [1], [np.nan], [1]]]), "a.npy", "frame 0001, vertex 2 is .*not fin"),
        (npz(offsets=FRAMES), "a.npz", "archive has no 'frames'; it has 'offsets'"),
        (npz(frames=SQUARE), "a.npz", r"frames have shape \(4, 3\)"),
        (npz(frames=FRAMES.astype(object)), "a.npz", "Python objects"),
        (b"", "a.npz", "not a readable .npz"),
        (b"v 0 0 0\n", "a.obj", "frame has 1 vertex, the neutral mesh has 4"),
        (b"v 0 0 0\nv 0 nan 0\n", "a.obj", "line 2: v has 'nan'"),
        (b"", "a.obj", "frame has 0 vertices"),
        (b"", "a.ply", "extension '.ply': must be one of .npy, .npz, .obj"),
        (b"", "npy", "extension ''"),
    ],
)
def test_refused_files(data: bytes, name: str, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        read_frame_file(data, name, 4)
