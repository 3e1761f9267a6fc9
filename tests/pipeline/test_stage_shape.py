"""The launch shape of a device: measured once, and remembered."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from rhytid.device.runtime import Device
from rhytid.device.shape import LaunchShape, launch_shapes
from rhytid.errors import DeviceMemoryError
from rhytid.pipeline.measured_shape import remembered_shape, shape_seconds

USUAL, OTHER = LaunchShape(64, 64, 64), LaunchShape(32, 32, 64)


@pytest.fixture
def gpu(device):
    """The device, as if it were a GPU with room for whole blocks."""
    return Device(replace(device.info, kind="gpu", local_memory=1 << 16), 1 << 28)


class Clock:
    """In place of measuring: seconds of two shapes, and how often they were asked for."""

    def __init__(self, usual, other):
        self.seconds, self.asked = {USUAL: usual, OTHER: other}, 0

    def __call__(self, device):
        self.asked += 1
        return self.seconds


def test_a_faster_shape_is_taken_and_remembered(gpu, tmp_path):
    clock = Clock(1.0, 0.5)
    for _ in range(2):
        assert remembered_shape(gpu, tmp_path / "new" / "folder", clock) == OTHER
    assert clock.asked == 1


def test_what_saves_little_is_not_taken(gpu, tmp_path):
    assert remembered_shape(gpu, tmp_path, Clock(1.0, 0.96)) == USUAL


def test_every_device_and_driver_has_its_own(gpu, tmp_path):
    updated = Device(replace(gpu.info, version="another"), 1 << 28)
    assert remembered_shape(gpu, tmp_path, Clock(1.0, 0.5)) == OTHER
    assert remembered_shape(updated, tmp_path, Clock(1.0, 2.0)) == USUAL
    assert remembered_shape(gpu, tmp_path, Clock(1.0, 2.0)) == OTHER


@pytest.mark.parametrize("damage", ["", "[1]", "{", '{"rows": 1}', "shape", "unfit"])
def test_a_damaged_file_is_measured_again(gpu, tmp_path, damage):
    remembered_shape(gpu, tmp_path, Clock(1.0, 0.5))
    file = next(tmp_path.iterdir())
    wrong = {"shape": 7, "unfit": {"rows": 999, "lanes": 1, "vectors": 64}}
    key = next(iter(json.loads(file.read_text())))
    file.write_text(json.dumps({key: wrong[damage]}) if damage in wrong else damage)
    clock = Clock(1.0, 0.5)
    assert remembered_shape(gpu, tmp_path, clock) == OTHER
    assert remembered_shape(gpu, tmp_path, clock) == OTHER
    assert clock.asked == 1


def test_a_folder_that_cannot_be_written_stops_nothing(gpu, tmp_path):
    (tmp_path / "file").touch()
    assert remembered_shape(gpu, tmp_path / "file", Clock(1.0, 0.5)) == OTHER


def test_a_device_that_cannot_be_measured_keeps_its_shape(gpu, tmp_path):
    def fail(device):
        raise DeviceMemoryError("no room")

    assert remembered_shape(gpu, tmp_path, fail) == USUAL
    tight = Device(gpu.info, 1 << 10)
    assert remembered_shape(tight, tmp_path) == USUAL
    assert list(tmp_path.iterdir()) == []


def test_measuring_times_every_shape_and_leaves_the_device_as_it_was(device):
    own = Device(device.info, 1 << 28)
    seconds = shape_seconds(own)
    assert list(seconds) == launch_shapes(device.info.kind, device.info.local_memory)
    assert all(0 < s < 60 for s in seconds.values())
    assert own.shape == next(iter(seconds))
    assert own.budget.used == 0
