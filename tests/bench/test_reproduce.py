"""The report from end to end, at the smallest size."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cli.running import write_neutral
from meshes import SmallMesh
from rhytid.cli import main
from rhytid.device.runtime import Device
from rhytid.domain.methods import METHODS
from rhytid_lab.bench.accuracy import PAPER, SOURCES, Accuracy, best, choice, front, memory
from rhytid_lab.bench.page import page
from rhytid_lab.bench.report import Report, wrinkles_at
from rhytid_lab.bench.skin import COLUMNS
from rhytid_lab.bench.subject import built_in_face, most_stretched
from rhytid_lab.commands import reproduce

pytestmark = [pytest.mark.slow, pytest.mark.release]

PICTURES = ("figure_1", "figure_3", "figure_4", "figure_5", "pareto")


@pytest.fixture(scope="module")
def report(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Report:
    """Few choices of bins: each is compiled for itself."""
    out = tmp_path_factory.mktemp("report")
    choices = (PAPER, choice(depth_factored=True))
    made = Report(device, built_in_face(device), out, 256, 10.0, choices, (SOURCES[3],))
    made.run(lambda share, stage: None)
    return made


def numbers(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for one in value:
            yield from numbers(one)
    elif isinstance(value, (int, float)):
        yield value


def test_every_figure_is_finite_json(report: Report) -> None:
    figures = json.loads(json.dumps(report.figures, allow_nan=False))
    found = list(numbers(figures))

    assert len(found) > 100
    assert all(math.isfinite(number) for number in found)
    assert len(figures["frames"]) == 5
    assert {row["case"] for row in figures["times"]["rows"]} >= {"stretch", "redraw", "binned"}
    assert len(figures["accuracy"]["rows"]) == 2
    assert all(row["error"] < 0.5 for row in figures["accuracy"]["rows"])


@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_shows_something(report: Report, name: str) -> None:
    with Image.open(report.out / f"{name}.png") as picture:
        assert picture.width > 1000
        assert np.asarray(picture).std() > 10


def test_the_page_has_every_picture_and_table(report: Report) -> None:
    text = page(report.figures)

    assert all(f"src='{name}.png'" in text for name in PICTURES)
    assert text.count("<table>") == 3


def test_columns_are_the_methods_there_are() -> None:
    assert {column.method for column in COLUMNS} == set(METHODS)


def accuracy(copies: float, error: float, **changes: Any) -> Accuracy:
    bins = choice(**changes)
    return Accuracy(bins, {"face": error}, {"face": error}, copies, copies, memory(bins))


def test_best_is_the_closest_within_twice_the_time_of_the_paper() -> None:
    paper = accuracy(10, 0.2)
    near = accuracy(20, 0.1, count=8)
    dear = accuracy(21, 0.05, count=16)

    assert best([paper, near, dear]) is near
    assert front([dear, near, accuracy(15, 0.3, count=2), paper]) == [paper, near, dear]


def test_memory_counts_codes_and_the_triangle_index() -> None:
    assert memory(PAPER) == 5 * 3 + 1
    assert memory(choice(merge="mellow", bits=16, count=8, samples=5)) == 9 * 2 * 5 * 2 + 1


def test_frames_come_from_every_part_the_largest_first() -> None:
    assert most_stretched([0.1, 0.5, 0.2, 0.3], most=2) == [1, 3]
    assert most_stretched([0.1], most=5) == [0]


def test_wrinkles_are_as_dense_as_the_papers() -> None:
    assert wrinkles_at(16384) == 20_000_000
    assert wrinkles_at(4096) == 1_250_000


def test_a_mesh_without_frames_is_refused(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = write_neutral(tmp_path / "mesh.npz", small_mesh)

    assert main(["reproduce", "--mesh", str(mesh), "--out", str(tmp_path / "out")]) == 1
    assert "no frames" in capsys.readouterr().err
    assert main(["reproduce", "--resolution", "300", "--out", str(tmp_path / "out")]) == 1
    assert "resolution is 300" in capsys.readouterr().err


def test_an_interrupted_report_has_no_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(arguments: argparse.Namespace, progress: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Report, "run", interrupt)
    assert main(["reproduce", "--resolution", "256", "--out", str(tmp_path)]) == 130
    assert list(tmp_path.iterdir()) == []
    assert "interrupted" in capsys.readouterr().err


def test_reproduce_writes_page_and_figures(
    report: Report,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(Report, "run", lambda self, show: self.figures.update(report.figures))
    assert main(["reproduce", "--resolution", "256", "--out", str(tmp_path), "--json"]) == 0

    told = json.loads(capsys.readouterr().out)
    assert told == json.loads((tmp_path / "report.json").read_text())
    assert (tmp_path / "index.html").read_text().startswith("<!doctype html>")
    assert reproduce.RESOLUTION == 4096
