"""How costs grow, as figures and pictures."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest
from PIL import Image

from bench.small_bench import SIZE
from rhytid.cli import main
from rhytid.device.runtime import Device
from rhytid_lab.bench import scaling
from rhytid_lab.bench.scaling import SERIES, Growth, Scaling, plot
from rhytid_lab.commands import bench as command
from rhytid_lab.samples.sphere import sphere, sphere_stretch

MESH = sphere(12)


@pytest.fixture(autouse=True)
def _few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "_RINGS", (4, 8))
    monkeypatch.setattr(scaling, "_BINS", (2, 4))
    monkeypatch.setattr(scaling, "_SHARES", (0.5, 1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("series", "places"),
    [
        ("size", [256, 512]),
        ("wrinkles", [200, 400]),
        ("triangles", [32, 128]),
        ("bins", [2, 4]),
        ("synthesis", [200, 400]),
    ],
)
def test_a_series_times_its_cases_at_its_places(
    device: Device, series: str, places: list[int]
) -> None:
    bent, used = sphere_stretch(MESH, 1.2, 0.9), device.budget.used
    found = [*Scaling(device, MESH, bent, 512, 400, 1).run(series)]

    assert [(g.x, g.case) for g in found] == [(x, c) for x in places for c in SERIES[series][1]]
    assert {g.series for g in found} == {series}
    assert all(g.seconds > 0 for g in found)
    assert all((g.map_copies is None) == (series == "synthesis") for g in found)
    assert device.budget.used == used  # given back
    assert len(plot(found).axes[0].lines) == len(SERIES[series][1])


@pytest.mark.slow
def test_the_command_writes_figures_and_a_picture_a_series(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    device: Device,
) -> None:
    out = tmp_path / "scaling"
    bent = sphere_stretch(MESH, 1.2, 0.9)
    place = (device, MESH, bent)

    def given(arguments: argparse.Namespace) -> tuple[object, ...]:
        return place

    def run(self: Scaling, series: str) -> list[Growth]:
        return [Growth(series, x, c, 0.1 * x, 2.0 * x) for x in (1, 2) for c in SERIES[series][1]]

    monkeypatch.setattr(command, "_frame_on_device", given)
    monkeypatch.setattr(Scaling, "run", run)
    assert main(["bench", "--scaling", str(out), "--size", str(SIZE), "--wrinkles", "300"]) == 0

    figures = json.loads((out / "scaling.json").read_text())
    assert (figures["size"], figures["wrinkles"]) == (SIZE, 300)
    assert {row["series"] for row in figures["results"]} == set(SERIES)
    for series in SERIES:
        Image.open(out / f"scaling_{series}.png").load()
    told = capsys.readouterr().out.splitlines()
    assert len(told) == 2 + len(figures["results"])
