"""The launch shape of a device: measured once, and remembered."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from rhytid.device.launches import LaunchShape, launch_shapes
from rhytid.device.runtime import Device
from rhytid.errors import DeviceError, DeviceMemoryError
from rhytid.pipeline import measured_shape
from rhytid.pipeline.measured_shape import remembered_shape, shape_seconds

USUAL, OTHER = LaunchShape(64, 64, 64), LaunchShape(32, 32, 64)


@pytest.fixture
def gpu(device):
    """The device, as if it were a GPU with room for whole blocks."""
    return Device(replace(device.info, kind="gpu", local_memory=1 << 16), 1 << 28)


def test_shapes_stay_within_the_local_memory_and_the_groups_of_a_device():
    assert launch_shapes("cpu", 1 << 16, 4096)[0] == LaunchShape(64, 1, 1024)
    assert launch_shapes("cpu", 32 << 10, 100)[0] == LaunchShape(32, 1, 64)
    assert launch_shapes("gpu", 1 << 16, 1024)[0] == LaunchShape(64, 64, 64)
    for shape in launch_shapes("gpu", 1 << 16, 32):
        assert shape.rows in (64, 32, 16)
        assert max(shape.lanes, shape.vectors) <= 32
    with pytest.raises(DeviceError, match="8192 bytes of local memory: drawing needs 16256"):
        launch_shapes("gpu", 8 << 10, 1024)


class Clock:
    """In place of measuring: seconds of two shapes in each of eight turns, and how often they were
    asked for.  usual, other: seconds of all turns, or of each."""

    def __init__(self, usual, other):
        turns = [
            [seconds] * 8 if isinstance(seconds, float) else seconds for seconds in (usual, other)
        ]
        self.seconds, self.asked = dict(zip((USUAL, OTHER), turns, strict=True)), 0

    def __call__(self, device):
        self.asked += 1
        return self.seconds


def test_a_faster_shape_is_taken_and_remembered(gpu, tmp_path):
    clock = Clock(1.0, 0.5)
    for _ in range(2):
        assert remembered_shape(gpu, tmp_path / "new" / "folder", clock) == OTHER
    assert clock.asked == 1


@pytest.mark.parametrize(("cores", "asked"), [(2, 0), (4, 0), (5, 1)])
def test_a_processor_of_few_cores_is_not_measured(device, tmp_path, cores, asked):
    own = Device(replace(device.info, kind="cpu", compute_units=cores), 1 << 28)
    clock = Clock(1.0, 2.0)
    remembered_shape(own, tmp_path, clock)
    assert clock.asked == asked


def test_what_saves_little_is_not_taken(gpu, tmp_path):
    assert remembered_shape(gpu, tmp_path, Clock(1.0, 0.96)) == USUAL


def test_the_usual_shape_is_remembered_where_the_other_saves_by_chance_alone(gpu, tmp_path):
    clock = Clock(1.0, [1.5, 0.5, 1.5, 1.5, 1.5, 0.1, 1.5, 1.5])
    for _ in range(2):
        assert remembered_shape(gpu, tmp_path, clock) == USUAL
    assert clock.asked == 1


@pytest.mark.parametrize(
    "other",
    [[0.5, 0.5, 0.5, 0.5, 0.97, 0.5, 0.5, 0.5], [0.1, 0.1, 1.5, 1.5, 1.5, 0.1, 1.5, 1.5]],
    ids=["saves but once", "saves now and then"],
)
def test_what_other_work_of_the_machine_has_blurred_is_not_remembered(gpu, tmp_path, other):
    assert remembered_shape(gpu, tmp_path, Clock(1.0, other)) == USUAL
    assert remembered_shape(gpu, tmp_path, Clock(1.0, 0.5)) == OTHER
    blurred = Clock(1.0, other)
    assert remembered_shape(gpu, tmp_path, blurred) == OTHER
    assert blurred.asked == 0


def test_of_several_that_save_in_every_turn_the_fastest_is_taken(gpu, tmp_path):
    third = LaunchShape(16, 16, 64)
    clock = Clock(1.0, [0.6, 0.2, *[0.6] * 6])
    clock.seconds[third] = [0.5] * 8
    assert remembered_shape(gpu, tmp_path, clock) == third


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


def test_a_shape_that_fails_does_not_stay(device, tmp_path, monkeypatch):
    own = Device(replace(device.info, compute_units=16), 1 << 28)
    usual, timed = own.shape, measured_shape._seconds

    def fail_at_others(device, shape, draw):
        seconds = timed(device, shape, draw)
        if shape != usual:
            raise DeviceError("too large a work-group")
        return seconds

    monkeypatch.setattr(measured_shape, "_seconds", fail_at_others)
    assert remembered_shape(own, tmp_path) == usual
    assert own.shape == usual
    assert own.budget.used == 0


def test_measuring_times_every_shape_and_leaves_the_device_as_it_was(device):
    own = Device(device.info, 1 << 28)
    seconds = shape_seconds(own)
    assert list(seconds) == own.shapes
    assert len({len(turns) for turns in seconds.values()}) == 1
    assert all(0 < s < 60 for turns in seconds.values() for s in turns)
    assert own.shape == next(iter(seconds))
    assert own.budget.used == 0
