"""The order in which devices are tried, which of several CPUs is taken, and what a device is tried
with: right results, and a time that tells slow drivers from fast."""

from __future__ import annotations

import json
import math

import pytest

from rhytid.device import driver, select
from rhytid.device.driver import cl
from rhytid.errors import NoDeviceError

POCL, OTHER = "Portable Computing Language", "Another platform"


def candidate(index, kind, platform=OTHER):
    return select.Candidate(
        index=index, name=f"{kind} {index}", platform=platform, kind=kind, version="1.2",
        compute_units=1, memory=1, largest_buffer=1, local_memory=1,
        largest_group=1, handle=None,
    )  # fmt: skip


FOUND = (
    candidate(0, "other"),
    candidate(1, "cpu", POCL),
    candidate(2, "cpu"),
    candidate(3, "gpu", POCL),
    candidate(4, "gpu"),
    candidate(5, "gpu"),
)


def chosen(monkeypatch, working, wanted=None):
    monkeypatch.setattr(select, "candidates", lambda: FOUND)
    monkeypatch.setattr(select, "computes", lambda c: c.index in working)
    monkeypatch.setattr(select, "pace", lambda c: 1.0)
    return select.choose(wanted).index


class Cpus:
    """CPU devices of a machine, each with the seconds that it takes; counts the measurements."""

    def __init__(self, monkeypatch, *seconds, pocl=None):
        names = [POCL if i == pocl else OTHER for i in range(len(seconds))]
        self.found = [candidate(i, "cpu", name) for i, name in enumerate(names)]
        self.seconds, self.asked = list(seconds), 0
        monkeypatch.setattr(select, "candidates", lambda: self.found)
        monkeypatch.setattr(select, "computes", lambda c: self.seconds[c.index] < math.inf)
        monkeypatch.setattr(select, "pace", self._pace)

    def _pace(self, candidate):
        self.asked += 1
        return self.seconds[candidate.index]


@pytest.mark.parametrize(
    ("seconds", "pocl", "best"),
    [
        ((16.0, 1.0), 1, 1),  # a driver that came first for not being PoCL
        ((1.0, 16.0), 1, 0),
        ((1.0, 0.5), 1, 0),  # twice may be noise: the usual order
        ((0.5, 1.0, 16.0), 0, 1),
        ((16.0, 5.0, 4.0), None, 1),
        ((math.inf, 16.0, 1.0), None, 2),
        ((math.inf, 1.0), 1, 1),
    ],
)
def test_a_cpu_driver_that_is_much_slower_is_not_taken(monkeypatch, seconds, pocl, best):
    Cpus(monkeypatch, *seconds, pocl=pocl)
    assert select.choose().index == best


def test_what_was_measured_is_remembered_for_these_devices(monkeypatch, tmp_path):
    folder = tmp_path / "new" / "folder"
    cpus = Cpus(monkeypatch, 16.0, 1.0, 9.0)
    assert [select.choose(cache=folder).index for _ in range(3)] == [1, 1, 1]
    assert cpus.asked == 3
    cpus.seconds = [1.0, 16.0, 9.0]  # a busy minute must not change the choice
    assert select.choose(cache=folder).index == 1
    cpus.found.pop()
    assert select.choose(cache=folder).index == 0  # other devices, another measurement
    assert cpus.asked == 5


@pytest.mark.parametrize("damage", ["", "[1]", "{", "unknown device", "number"])
def test_a_damaged_memory_is_measured_again(monkeypatch, tmp_path, damage):
    cpus = Cpus(monkeypatch, 16.0, 1.0)
    select.choose(cache=tmp_path)
    file = next(tmp_path.iterdir())
    key = next(iter(json.loads(file.read_text())))
    wrong = {"unknown device": "a device of yesterday", "number": 7}
    file.write_text(json.dumps({key: wrong[damage]}) if damage in wrong else damage)
    assert [select.choose(cache=tmp_path).index for _ in range(2)] == [1, 1]
    assert cpus.asked == 4


def test_a_remembered_device_that_fails_gives_way(monkeypatch, tmp_path):
    cpus = Cpus(monkeypatch, 16.0, 1.0, 9.0)
    select.choose(cache=tmp_path)
    cpus.seconds[1] = math.inf
    assert select.choose(cache=tmp_path).index == 0


def test_nothing_is_measured_where_there_is_no_choice(monkeypatch, tmp_path):
    cpus = Cpus(monkeypatch, 1.0)
    select.choose(cache=tmp_path)
    cpus.found = [*FOUND]
    monkeypatch.setattr(select, "computes", lambda c: True)
    assert select.choose(cache=tmp_path).kind == "gpu"
    assert select.choose("1", cache=tmp_path).index == 1
    assert (cpus.asked, list(tmp_path.iterdir())) == (0, [])


def test_gpus_come_first_then_cpus_other_than_pocl_then_pocl(monkeypatch):
    left, order = set(range(6)), []
    while left:
        order.append(chosen(monkeypatch, left))
        left.discard(order[-1])
    assert order == [4, 5, 3, 2, 1, 0]


def test_what_is_named_is_used_or_nothing(monkeypatch):
    assert chosen(monkeypatch, {1, 4}, "portable") == 1
    with pytest.raises(NoDeviceError, match="other 0"):
        chosen(monkeypatch, {1, 4}, "0")


def test_a_device_that_computes_is_told_from_one_that_does_not(device, monkeypatch):
    assert select.computes(device.info)
    assert 0 < select.pace(device.info) < 60
    for text in ("broken", "__kernel void probe(__global float *x) { x[get_global_id(0)] = 1; }"):
        monkeypatch.setattr(select.rhytid_kernels, "source", lambda name, text=text: text)
        assert not select.computes(device.info)
    monkeypatch.setattr(select.rhytid_kernels, "source", lambda name: "broken")
    assert math.isinf(select.pace(device.info))


def test_a_small_piece_of_drawing_takes_no_local_memory_worth_counting(device):
    program = driver.compile_program(
        device.context, select.rhytid_kernels.source(select.PROGRAM), ["-Werror"]
    )
    asked = cl.kernel_work_group_info.LOCAL_MEM_SIZE
    assert program.pace.get_work_group_info(asked, device.info.handle) <= 16 << 10


def test_the_time_is_that_of_a_warm_kernel(device, monkeypatch):
    ticks = iter([0.0, 9.0, 0.0, 0.5, 0.0, 0.2, 0.0, 0.3, 0.0, 0.4])
    monkeypatch.setattr(select.time, "perf_counter", lambda: next(ticks))
    assert select.pace(device.info) == pytest.approx(0.2)
