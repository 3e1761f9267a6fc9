"""Implementations beside each other: only what agrees is timed, and who is missing is named."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.small_bench import SIZE, WRINKLES, Given, small_bench
from meshes import deform
from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.cli import main
from rhytid.cli.termination import TERMINATED, Terminated
from rhytid.device.runtime import Device
from rhytid_lab.bench import peers
from rhytid_lab.bench.comparison import (
    NAMES,
    OURS,
    TOLERANCE,
    Comparison,
    HostCopy,
    tolerance,
    worst_difference,
)
from rhytid_lab.bench.frame import CASES, REPORTED, FrameBench
from rhytid_lab.commands import bench as command

SMALL = ["bench", "--size", str(SIZE), "--wrinkles", str(WRINKLES), "--repeats", "1"]
ENTRY = {
    "case", "implementation", "seconds", "processor_seconds", "map_copies", "max_difference",
}  # fmt: skip


@pytest.fixture(scope="module")
def bench(device: Device) -> Iterator[FrameBench]:
    made = small_bench(device)
    yield made
    made.release()


def missing(monkeypatch: pytest.MonkeyPatch, *packages: str) -> None:
    """As if these packages were not installed."""
    find = peers.find_spec
    monkeypatch.setattr(peers, "find_spec", lambda name: None if name in packages else find(name))


def test_the_command_names_every_case_and_implementation() -> None:
    assert set(command.CASES) == set(CASES)
    assert set(command.IMPLEMENTATIONS) == set(NAMES)
    assert set(REPORTED) <= {"copy", *CASES}


@pytest.mark.parametrize("case", ["stretch", "redraw", "neutral", "binned"])
def test_numpy_agrees(bench: FrameBench, case: str) -> None:
    results = Comparison(bench, (OURS, "numpy"), 1).run([case])

    assert [entry.implementation for entry in results.timings] == [OURS, "numpy"]
    assert 0 < results.timings[1].max_difference < 1e-4
    assert results.untimed == []


@pytest.mark.parametrize("case", [case for case in CASES if case not in ("precompute", "stretch")])
def test_results_are_whole_maps(bench: FrameBench, case: str) -> None:
    found, side = bench.result(case), 64 if case == "tile" else SIZE

    assert found.shape == (side, side)
    assert found.min() < -0.01


def test_a_tile_is_a_crop_of_the_map(bench: FrameBench) -> None:
    crop = bench.result("redraw")[128:192, 128:192]

    assert bench.result("tile").tobytes() == np.ascontiguousarray(crop).tobytes()


@pytest.mark.parametrize("wrong", [2 * TOLERANCE, np.nan])
def test_a_wrong_result_is_not_timed(
    bench: FrameBench, wrong: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    off = bench.result("redraw")
    off[5, 7] += wrong * bench.scene().depth
    peer = Given(off)
    monkeypatch.setattr(peers, "prepare", lambda *given: peer)

    results = Comparison(bench, (OURS, "numba"), 1).run(["redraw"])

    assert [entry.implementation for entry in results.timings] == [OURS]
    assert [(left.implementation, left.off) for left in results.untimed] == [("numba", True)]
    assert results.untimed[0].reason.startswith("refused: off by")
    assert peer.released


def test_a_result_of_another_shape_is_an_error(bench: FrameBench) -> None:
    found = bench.result("redraw")

    with pytest.raises(ValueError, match=r"shape \(255, 256\)"):
        worst_difference("redraw", bench.scene(), found, found[1:])


def test_the_difference_of_stretch_sees_turned_axes(bench: FrameBench) -> None:
    ours = bench.result("stretch")
    flipped, turned = ours.copy(), ours.copy()
    flipped[:, 2:4] *= -1
    turned[:, 2:4] = turned[:, 3:1:-1] * (1, -1)

    assert worst_difference("stretch", bench.scene(), ours, flipped) == 0
    assert worst_difference("stretch", bench.scene(), ours, turned) > 100 * tolerance("stretch")


@pytest.mark.slow
def test_the_command_fails_where_a_result_is_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    off = Given(np.zeros((SIZE, SIZE), np.float32))
    monkeypatch.setattr(peers, "prepare", lambda *given: off)

    assert main([*SMALL, "--methods", "redraw", "--implementations", "numba"]) == 1
    told = capsys.readouterr()
    assert "redraw  numba" in told.out
    assert "refused: off by" in told.out
    assert "the results differ from rhytid's: numba in redraw" in told.err


def cancelled_in(monkeypatch: pytest.MonkeyPatch, last: str) -> None:
    """A bench is cancelled when it times this case."""
    seconds = FrameBench.seconds

    def cancelled(bench: FrameBench, case: str) -> float:
        if case == last:
            raise Terminated(TERMINATED)
        return seconds(bench, case)

    monkeypatch.setattr(FrameBench, "seconds", cancelled)


def test_what_has_ended_is_printed_when_a_bench_is_cancelled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cancelled_in(monkeypatch, "redraw")

    with suppress(SystemExit):
        main([*SMALL, "--methods", "stretch", "redraw", "--implementations", "rhytid"])

    told = capsys.readouterr()
    rows = [line.split()[0] for line in told.out.splitlines()]
    assert (rows[0], rows[2:]) == ("case", ["copy", "stretch"])
    assert "cases are missing above" in told.err


def test_figures_of_a_cancelled_bench_leave_the_missing_to_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing(monkeypatch, "numba")
    cancelled_in(monkeypatch, "neutral")

    with suppress(SystemExit):
        main([*SMALL, "--methods", "redraw,neutral", "--implementations", "numba", "--json"])

    told = capsys.readouterr()
    assert [e["case"] for e in json.loads(told.out)["results"]] == ["redraw"]
    assert "redraw: numba: not installed" in told.err.splitlines()


@pytest.mark.parametrize(("curvature", "left_out"), [(0.0, []), (1.0, ["redraw", "neutral"])])
def test_graphs_of_other_presets_are_drawn_flat_or_by_rhytid_alone(
    device: Device, curvature: float, left_out: list[str]
) -> None:
    mesh, settings = sheet(), settings_of()
    shape = replace(settings.shape, curvature=curvature)
    graph = random_graph(3, WRINKLES, half_width=(0.004, 0.02), length=(0.01, 0.1))
    share = np.linspace(0.2, 2.2, graph.wrinkles, dtype=np.float32)
    bent = np.full((graph.wrinkles, 2), 0.3, np.float32)
    other = replace(graph, edge_share=share, edge_slopes=bent)
    deformed = deform(mesh.positions, 2, 0.05)
    bench = FrameBench(device, mesh, other, deformed, replace(settings, shape=shape))

    found = Comparison(bench, (OURS, "numpy"), 1).run(["redraw", "neutral", "stretch"])

    assert [(one.case, one.off) for one in found.untimed] == [(one, False) for one in left_out]
    assert all("it draws straight lines" in one.reason for one in found.untimed)
    assert len(found.timings) == 6 - len(left_out)
    bench.release()


@pytest.mark.slow
def test_figures_have_the_agreed_form(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing(monkeypatch, "moderngl", "numba", "cv2")
    file = tmp_path / "figures.json"

    assert main([*SMALL, "--json", str(file)]) == 0
    figures = json.loads(file.read_text())
    assert set(figures) == {"device", "size", "wrinkles", "copy_seconds", "results"}
    assert (figures["size"], figures["copy_seconds"] > 0) == (SIZE, True)
    assert figures["wrinkles"] == pytest.approx(WRINKLES, rel=0.1)
    assert all(set(entry) == ENTRY for entry in figures["results"])
    for entry in figures["results"]:
        assert entry["map_copies"] == pytest.approx(entry["seconds"] / figures["copy_seconds"])
    assert {e["case"] for e in figures["results"] if e["implementation"] == OURS} == set(CASES)

    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("case")
    assert lines[0].endswith("note")
    told = [line.split(maxsplit=2) for line in lines if line.endswith("not installed")]
    expected = [(case, n) for n in ("opengl", "numba", "opencv") for case in peers.cases_of(n)]
    assert sorted((case, name) for case, name, _ in told) == sorted(expected)


@pytest.mark.slow
def test_figures_on_stdout_leave_the_missing_to_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing(monkeypatch, "numba")

    assert main([*SMALL, "--methods", "tile,binned", "--implementations", "numba", "--json"]) == 0
    told = capsys.readouterr()
    assert [e["case"] for e in json.loads(told.out)["results"]] == ["binned", "tile"]
    needed, missed = told.err.splitlines()
    assert needed.startswith("rhytid bench: 256 x 256 texels, 300 wrinkles: needs about")
    assert missed == "binned: numba: not installed"


@pytest.mark.parametrize("option", ["--methods", "--implementations"])
def test_an_unknown_name_is_a_usage_error(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["bench", option, "numpy,redraw"])

    assert end.value.code == 2
    assert "one of" in capsys.readouterr().err


def test_what_would_take_too_long_is_left_out(
    bench: FrameBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rhytid_lab.bench.peers import with_numpy

    monkeypatch.setattr(with_numpy, "_MOST_TEXELS", 1000)
    results = Comparison(bench, (OURS, "numpy"), 1).run(["redraw"])

    assert [left.off for left in results.untimed] == [False]
    assert "choose fewer wrinkles" in results.untimed[0].reason


def test_the_host_has_a_copy_of_its_own() -> None:
    assert HostCopy(64).seconds() > 0
