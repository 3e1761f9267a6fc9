"""What a device is tried with: right results, and a time that tells slow drivers from fast."""

from __future__ import annotations

import math

import pytest

from rhytid.device import trial
from rhytid.device.trial import cl


def test_a_device_that_computes_is_told_from_one_that_does_not(device, monkeypatch):
    assert trial.computes(device.info.handle)
    assert 0 < trial.pace(device.info.handle) < 60
    for text in ("broken", "__kernel void probe(__global float *x) { x[get_global_id(0)] = 1; }"):
        monkeypatch.setattr(trial.rhytid_kernels, "source", lambda name, text=text: text)
        assert not trial.computes(device.info.handle)
    monkeypatch.setattr(trial.rhytid_kernels, "source", lambda name: "broken")
    assert math.isinf(trial.pace(device.info.handle))


def test_a_small_piece_of_drawing_takes_no_local_memory_worth_counting(device):
    program = trial.compile_program(
        device.context, trial.rhytid_kernels.source(trial.PROGRAM), ["-Werror"]
    )
    asked = cl.kernel_work_group_info.LOCAL_MEM_SIZE
    assert program.pace.get_work_group_info(asked, device.info.handle) <= 16 << 10


def test_the_time_is_that_of_a_warm_kernel(device, monkeypatch):
    ticks = iter([0.0, 9.0, 0.0, 0.5, 0.0, 0.2, 0.0, 0.3, 0.0, 0.4])
    monkeypatch.setattr(trial.time, "perf_counter", lambda: next(ticks))
    assert trial.pace(device.info.handle) == pytest.approx(0.2)
