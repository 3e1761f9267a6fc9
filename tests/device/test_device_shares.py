"""Memory follows the machine, the device and the container, unless it is set."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rhytid.api.request_memory import small_budget
from rhytid.device import memory
from rhytid.device.memory import (
    machine_memory,
    usual_device_memory,
    usual_frame_memory,
    usual_host_memory,
)
from rhytid.device.runtime import Device
from rhytid.device.select import Candidate
from rhytid.engine.byte_budget import ByteBudget
from rhytid.errors import SettingsError
from rhytid.support.settings import MIB, ServiceSettings

GIB = 1 << 30
CPU = Candidate(0, "a", "b", "cpu", "1.2", 2, 64 * GIB, GIB, 1 << 15, 64, None)


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """16 GiB; the file that limits a container is not there yet."""
    pages = {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 16 * GIB // 4096}
    monkeypatch.setattr(memory.os, "sysconf", pages.__getitem__)
    limit = tmp_path / "memory.max"
    monkeypatch.setattr(memory, "_LIMITS", (limit,))
    return limit


def test_a_cpu_gives_half_of_the_machine_and_a_gpu_most_of_its_own(machine: Path) -> None:
    assert usual_device_memory(CPU) == 8 * GIB
    assert usual_device_memory(replace(CPU, memory=4 * GIB)) == 2 * GIB
    assert usual_device_memory(replace(CPU, kind="gpu")) == int(0.8 * 64 * GIB)
    assert usual_frame_memory() == int(1.6 * GIB)


def test_all_limits_leave_a_seventh_of_the_machine(machine: Path) -> None:
    """Those of a server that computes on the processor, with all that requests hold."""
    host = ByteBudget(usual_host_memory(), "RHYTID_HOST_MEMORY_MB")
    limits = [usual_device_memory(CPU), usual_frame_memory(), host.limit, small_budget(host).limit]
    assert sum(limits) <= 6 / 7 * machine_memory()


@pytest.mark.parametrize(
    ("text", "total"), [("max\n", 16), (f"{2 * GIB}\n", 2), (f"{1 << 63}", 16)]
)
def test_a_container_has_what_it_may_use(machine: Path, text: str, total: int) -> None:
    machine.write_text(text)
    assert machine_memory() == total * GIB


def test_a_system_that_does_not_tell_is_taken_for_a_small_one(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory.os, "sysconf", lambda name: -1)
    assert machine_memory() == 8 * GIB


def test_an_upload_of_the_largest_size_fits_into_the_spool() -> None:
    given = {"RHYTID_UPLOAD_LIMIT_MB": "512", "RHYTID_SPOOL_MB": "512"}
    assert ServiceSettings.from_environment(given).upload_limit == 512 * MIB
    with pytest.raises(SettingsError, match=r"UPLOAD_LIMIT_MB is 513: .* RHYTID_SPOOL_MB, .* 512"):
        ServiceSettings.from_environment({**given, "RHYTID_UPLOAD_LIMIT_MB": "513"})
    with pytest.raises(SettingsError, match=r"is 1024: must be at most RHYTID_SPOOL_MB.* is 512;"):
        ServiceSettings.from_environment({"RHYTID_SPOOL_MB": "512"})
    with pytest.raises(SettingsError, match=r"is 4097: .* which is 4096"):
        ServiceSettings.from_environment({"RHYTID_UPLOAD_LIMIT_MB": "4097"})


def test_settings_go_before(device: Device) -> None:
    plain = ServiceSettings.from_environment({})
    assert (plain.device_memory, plain.frame_memory) == (None, None)
    given = {"RHYTID_DEVICE_MEMORY_MB": "7", "RHYTID_FRAME_MEMORY_MB": "3"}
    found = ServiceSettings.from_environment(given)
    assert (found.device_memory, found.frame_memory) == (7 * MIB, 3 * MIB)
    assert Device(device.info, found.device_memory).budget.limit == 7 * MIB
    assert Device(device.info, None).budget.limit == usual_device_memory(device.info)
