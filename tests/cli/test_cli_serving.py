"""`serve` and `demo` as a user has them: processes, sockets, files."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image

from cli.running import process
from rhytid.api.server import http_server
from rhytid.cli import main
from rhytid.formats.exr import read_exr
from rhytid_lab.samples.face import procedural_face

SERVE = ("serve", "--port", "0", "--store", "store")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status"),
    [(signal.SIGTERM, 0), (signal.SIGINT, 130)],
)
def test_serve_tells_its_address_and_ends_when_told(
    number: signal.Signals,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    with process(*SERVE, folder=tmp_path) as running:
        monkeypatch.undo()
        assert running.stdout is not None
        words = running.stdout.readline().split()
        url = words[words.index("on") + 1].rstrip(",")
        assert httpx.get(f"{url}/readyz", timeout=60).json() == {"status": "ready"}
        if number == signal.SIGTERM:
            monkeypatch.chdir(tmp_path)
            monkeypatch.setattr(http_server, "server_of", None)  # else it would serve for good
            assert main(SERVE) == 1
            [told] = capsys.readouterr().err.splitlines()
            assert f"store is in use by another rhytid serve, process {running.pid}" in told
        running.send_signal(number)
        _, errors = running.communicate(timeout=60)

    assert running.returncode == status
    assert "Traceback" not in errors
    assert (tmp_path / "store").is_dir()
    assert [one for one in (tmp_path / "tmp").iterdir() if one.name.startswith("rhytid")] == []


@pytest.mark.parametrize("option", [("--stiffness", ""), ("--map", "turn=")])
def test_demo_names_maps_that_are_not_there_before_it_begins(
    tmp_path: Path, option: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    name, start = option
    given = ["demo", "--out", str(tmp_path / "demo"), name, f"{start}{tmp_path / 'm.<UDIM>.png'}"]
    assert main(given) == 1
    assert "there is no such file for any UDIM of the mesh, 1001" in capsys.readouterr().err
    assert not (tmp_path / "demo").exists()


@pytest.mark.slow
def test_demo_makes_maps_sheets_and_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    face = procedural_face(32)
    frames = np.stack([face.pose({"smile": strength}) for strength in (0.5, 1.0)])
    names = ("positions", "faces", "uv", "face_uv")
    arrays = {name: getattr(face.mesh, name) for name in names}
    np.savez(tmp_path / "face.npz", **arrays, frames=frames)
    out = tmp_path / "demo"

    query = ["--stretch", "uv", "--sampling", "smooth"]
    Image.new("L", (4, 4), 128).save(tmp_path / "even.1001.png")
    even = str(tmp_path / "even.<UDIM>.png")
    given = ["demo", "--mesh", str(tmp_path / "face.npz"), "--out", str(out)]
    given += ["--stiffness", even, "--map", f"turn={even}"]
    assert main([*given, "--resolution", "256", "--wrinkles", "500", "--json", *query]) == 0

    figures = json.loads(capsys.readouterr().out)
    assert figures == json.loads((out / "times.json").read_text())
    assert (figures["wrinkles"], figures["frames"]) == (500, 2)
    assert (figures["stretch"], figures["sampling"]) == ("uv", "smooth")
    for method in ("redraw", "binned"):
        maps = sorted((out / method).iterdir())
        assert [file.name for file in maps] == ["face.1001.0001.exr", "face.1001.0002.exr"]
        header = read_exr(maps[0])[1]
        assert [header[key] for key in ("method", "stretch", "sampling")] == [method, *query[1::2]]
    assert [sheet["frame"] for sheet in figures["key_frames"]] == ["0002", "0001"]
    with Image.open(out / figures["key_frames"][0]["sheet"]) as sheet:
        assert sheet.width > 1000
