"""Half floats that the device makes are those that numpy finds."""

from __future__ import annotations

import numpy as np
import pyopencl as cl
import pytest

from rhytid.formats.half_floats import OVERFLOW
from rhytid.pipeline.levels import Part, read_halves, read_parts


def read(device, values):
    """Half floats of any numbers, fewer than 512²."""
    flat = np.zeros(512 * 512, np.float32)
    flat[: values.size] = values.reshape(-1)
    found = read_halves(device, device.upload(flat), 512)
    return None if found is None else found.reshape(-1)[: values.size]


def same(device, values):
    found = read(device, values)
    return found.dtype == np.float16 and np.array_equal(
        found.view(np.uint16), values.astype(np.float16).view(np.uint16)
    )


def test_every_half_float_and_what_lies_between_two_is_rounded_as_numpy_does(device):
    every = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    here = every[np.isfinite(every)]
    low = here[here < here.max()]
    between = (low.astype(np.float32) + np.nextafter(low, here.max())) / np.float32(2)
    beside = [np.nextafter(between, np.float32(end)) for end in (-np.inf, np.inf)]
    assert same(device, here.astype(np.float32))
    assert all(same(device, values) for values in (between, *beside))
    assert same(device, np.nextafter(np.float32([OVERFLOW, -OVERFLOW]), np.float32(0)))


def test_numbers_of_any_size_are_rounded_as_numpy_does(device):
    bits = np.random.default_rng(1).integers(0, 1 << 32, 1 << 18, dtype=np.uint32)
    values = bits.view(np.float32)
    assert same(device, values[np.abs(values) < OVERFLOW])


@pytest.mark.parametrize("value", [OVERFLOW, -OVERFLOW, 3e38, -3e38, np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("place", [0, 17, 512 * 512 - 1])
def test_what_half_floats_cannot_hold_is_found(device, value, place):
    values = np.full(512 * 512, -0.125, np.float32)
    values[place] = value
    assert read(device, values) is None


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_parts_are_put_together_and_cut(device, dtype):
    whole = np.random.default_rng(2).normal(0.0, 0.01, (128, 128)).astype(np.float32)
    parts = [
        Part(64 + y, 192 + x, 32, device.upload(whole[y : y + 32, x : x + 32]))
        for y in range(0, 128, 32)
        for x in range(0, 128, 32)
    ]
    together = np.full((130, 160), 7.0, dtype)
    read_parts(device, parts, (64, 192, 128), together[1:129, 16:144])
    cut = np.empty((16, 16), dtype)
    read_parts(device, [Part(0, 64, 128, device.upload(whole))], (48, 96, 16), cut)

    wanted = np.full((130, 160), 7.0, dtype)
    wanted[1:129, 16:144] = whole
    np.testing.assert_array_equal(together, wanted)
    np.testing.assert_array_equal(cut, whole[48:64, 32:48].astype(dtype))


def test_other_threads_run_while_squares_are_read(device, monkeypatch):
    """pyopencl waits for a copy whose event goes, and lets no other thread run meanwhile."""
    waited, lost, enqueue = [], [], cl.enqueue_copy

    class Event:
        def __init__(self, event):
            self.event = event

        def wait(self):
            waited.append(self)
            self.event.wait()

        def __del__(self):
            if self not in waited:
                lost.append(self)

    monkeypatch.setattr(cl, "enqueue_copy", lambda *a, **named: Event(enqueue(*a, **named)))
    buffers = [device.upload(np.full((16, 16), n, np.float32)) for n in range(3)]
    waited.clear()
    out = np.empty((16, 48), np.float32)
    device.read_squares(
        [(buffer, 16, 0, 0) for buffer in buffers], [out[:, n : n + 16] for n in (0, 16, 32)]
    )

    assert len(waited) == 3
    assert not lost
    np.testing.assert_array_equal(out[0, ::16], [0, 1, 2])
