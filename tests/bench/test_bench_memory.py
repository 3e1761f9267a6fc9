"""The bench says what memory it needs before it starts, and that is about what it takes."""

from __future__ import annotations

import pytest

from rhytid.cli import main
from rhytid.device.budget import MemoryBudget
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import DeviceMemoryError
from rhytid.synthesis import generate
from rhytid_lab.bench.frame import CASES, FrameBench
from rhytid_lab.bench.subject import grow
from rhytid_lab.commands.bench_skin import GIB, Need
from rhytid_lab.samples.face import procedural_face


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "preset", "cases", "wrinkles"),
    [
        (2048, "paper", CASES, 5000),
        (2048, "best", ("redraw", "binned"), 5000),
        (2048, "paper", ("redraw",), 100_000),
        (1024, "paper", ("convolved",), 20_000),
    ],
)
def test_the_need_is_what_is_taken_and_little_more(
    device: Device,
    monkeypatch: pytest.MonkeyPatch,
    size: int,
    preset: str,
    cases: tuple[str, ...],
    wrinkles: int,
) -> None:
    face = procedural_face()
    grown = grow(device, face.mesh, wrinkles)
    settings = AssetSettings.parse({"resolution": size, "preset": preset})
    taken, before, reserve = [0], device.budget.used, device.budget.reserve

    def counted(nbytes: int, *, reuse: bool = False) -> object:
        spare = reserve(nbytes, reuse=reuse)
        taken.append(device.budget.used - before)
        return spare

    monkeypatch.setattr(device.budget, "reserve", counted)
    resolved = settings.resolved(grown.spacing)
    deformed = face.pose({"smile": 1.0})
    bench = FrameBench(device, face.mesh, grown.graph, deformed, resolved)
    for case in cases:
        bench.ready(case)
        bench.run(case)
    bench.release()
    need = Need.of(settings, cases, wrinkles, len(face.mesh.faces))
    assert max(taken) <= need.device <= 1.25 * max(taken)


def test_the_need_of_the_size_of_the_paper() -> None:
    """16384² with 20 million wrinkles was measured at 11.8 GiB in all."""
    settings = AssetSettings.parse({"resolution": 16384, "preset": "paper"})
    need = Need.of(settings, ("stretch", "redraw", "precompute", "binned"), 20e6, 18_432)
    assert 11 * GIB < need.device + need.host < 16 * GIB


def test_too_little_is_refused_before_any_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RHYTID_DEVICE_MEMORY_MB", "200")
    monkeypatch.setattr(generate, "_skin", None)  # where the work of a synthesis begins
    assert main(["bench", "--size", "4096", "--wrinkles", "1000", "--methods", "redraw"]) == 1
    said = capsys.readouterr().err
    assert "needs about 0.2 GiB of device memory" in said
    assert "RHYTID_DEVICE_MEMORY_MB" in said


def test_more_than_the_machine_has_is_refused_whatever_the_budget_says(device: Device) -> None:
    need = Need(1 << 50, 1 << 50)
    with pytest.raises(DeviceMemoryError, match="the budget is"):
        need.check(device)
    budget, device.budget = device.budget, MemoryBudget(1 << 60, device.pool)
    try:
        with pytest.raises(DeviceMemoryError, match="the machine has"):
            need.check(device)
    finally:
        device.budget = budget


def test_what_is_needed_is_told_first(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--size", "256", "--wrinkles", "300", "--methods", "redraw", "--repeats", "1"]
    assert main(["bench", *given, "--implementations", "rhytid", "--json"]) == 0
    told = capsys.readouterr()
    assert "256 x 256 texels, 300 wrinkles: needs about" in told.err
    assert "needs" not in told.out
