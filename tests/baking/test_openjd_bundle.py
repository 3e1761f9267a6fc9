"""`rhytid bake --openjd`: what is in the bundle."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from baking.bundles import SMALL, bake, template, values, write_shot
from meshes import SmallMesh
from rhytid.baking.farm.openjd_bundle import BakeJob, JobBundle
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.frames import frames_list, read_frames_list
from rhytid.cli import main
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import InputError, LimitError, SettingsError

JOB = BakeJob("a" * 16, "face", "1-4", 2, "redraw", ["redraw"], 256, False)


def by_name(job: BakeJob) -> dict[str, dict[str, object]]:
    return {str(parameter["name"]): parameter for parameter in job.parameters()}


def test_a_bundle_has_all_that_a_farm_needs(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    from openjd.model import decode_job_template  # takes a quarter of a second

    neutral, files = write_shot(tmp_path, small_mesh)
    bundle, out = tmp_path / "job", tmp_path / "maps"
    more = ("--openjd", str(bundle), "--chunk", "3", "--frame-range", "1-2,4", "--json", "-")
    assert bake(neutral, files, out, *more) == 0

    assert not out.exists()
    written = {file.name for file in bundle.iterdir()}
    beside = {"template.json", "parameter_values.json", "asset_references.json"}
    assert written == beside | {"asset.rhytid.tar", "frames.txt"}
    decode_job_template(template=template(bundle), supported_extensions=["TASK_CHUNKING"])
    defaults = {p["name"]: p.get("default") for p in template(bundle)["parameterDefinitions"]}
    assert defaults["Frames"] == "1-2,4"
    assert (defaults["FramesPerTask"], defaults["Resolution"]) == (3, 256)
    folder = str(tmp_path / "frames")
    assert values(bundle) == {"Mesh": str(neutral), "Out": str(out), "FramesFolder": folder}
    listed = read_frames_list(bundle / "frames.txt", Path(folder))
    assert listed == [FramePlace(f"{n:04d}", file, 0) for n, file in enumerate(files, 1)]
    references = json.loads((bundle / "asset_references.json").read_bytes())["assetReferences"]
    assert references["inputs"]["filenames"] == sorted(map(str, [neutral, *files]))
    assert references["outputs"]["directories"] == [str(out)]
    figures = json.loads(capsys.readouterr().out)
    assert (figures["frames"], figures["tasks"]) == (3, 1)


def test_binned_is_offered_where_its_range_is_measured(
    tmp_path: Path, small_mesh: SmallMesh
) -> None:
    neutral, files = write_shot(tmp_path, small_mesh)
    for method, offered in (("redraw", False), ("binned", True)):
        more = ("--method", method, "--openjd", str(tmp_path / method))
        assert bake(neutral, files, tmp_path / "maps", *more) == 0
        [found] = [
            p for p in template(tmp_path / method)["parameterDefinitions"] if p["name"] == "Method"
        ]
        assert ("binned" in found["allowedValues"]) is offered


def test_every_resolution_is_one_that_an_asset_can_have() -> None:
    sides = by_name(JOB)["Resolution"]["allowedValues"]
    assert isinstance(sides, list)
    for side in sides:
        AssetSettings.parse({"resolution": side, "tile_size": 256})
    for side in (sides[0] // 2, sides[-1] * 2):
        with pytest.raises(SettingsError):
            AssetSettings.parse({"resolution": side, "tile_size": 256})


def test_a_value_that_is_too_long_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    frames = ",".join(map(str, range(1000)))
    job = BakeJob("a" * 16, "face", frames, 2, "redraw", ["redraw"], 256, False)
    with pytest.raises(LimitError, match=r"Frames has 3889 characters, .* at most 1024"):
        JobBundle(job, Path("face.npz"), [], Path("maps")).write(tmp_path / "job", [b""])
    assert not (tmp_path / "job").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shot.1.npy\nshot.2.npy\n", ", line 1: no such file"),
        ("\udcff", " is no text in UTF-8"),
        ("\n \n", " lists no frames"),
        ("0001\t0\ta.npy\nb.npy\n", ", line 2: write a frame as LABEL"),
        ("0001\t-1\ta.npy\n", ", line 1: write a frame as LABEL"),
        ("0001\t0\ta.npy\n0001\t0\tb.npy\n", ", line 2: frame 0001 is listed twice"),
        ("0001\t0\ta.npy\n", "frame 0001: no such file: "),
        ("0001\t1\tframes/take1/shot.0001.npy\n", "index 1, the file holds 1 frame"),
    ],
)
def test_a_list_of_frames_that_cannot_be_used_is_named(
    text: str,
    message: str,
    tmp_path: Path,
    small_mesh: SmallMesh,
    capsys: pytest.CaptureFixture[str],
) -> None:
    neutral, _ = write_shot(tmp_path, small_mesh)
    listing = tmp_path / "frames.txt"
    listing.write_bytes(text.encode(errors="surrogateescape"))

    given = ["bake", "--mesh", str(neutral), "--out", str(tmp_path / "maps")]
    assert main([*given, *SMALL, "--frames-list", str(listing)]) == 1
    said = capsys.readouterr().err
    assert (str(listing) if message[0] in ", " else "") + message in said


@pytest.mark.parametrize("name", ["end .npy ", "tab\t.npy", "line\n.npy", "\udcff.npy"])
def test_a_file_whose_name_no_list_can_hold_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rename the file"):
        frames_list([FramePlace("0001", tmp_path / name, 0)], tmp_path)


def test_odd_names_come_back_as_they_are(tmp_path: Path) -> None:
    files = [tmp_path / "a" / name for name in ("caf\u00e9.npy", "nel\x85.npy", "a b.npy")]
    places = [FramePlace(f"{n:04d}", file, n) for n, file in enumerate(files)]
    for mark in ("", "\ufeff"):  # which editors of Windows put at the beginning
        (tmp_path / "frames.txt").write_text(mark + frames_list(places, tmp_path), "utf-8")
        assert read_frames_list(tmp_path / "frames.txt", tmp_path) == places


def test_paths_have_no_steps_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bundle = JobBundle(JOB, Path("../face.npz"), [Path("../a/../b/1.npy")], Path("maps"))
    above = tmp_path.parent
    wanted = {"Mesh": above / "face.npz", "Out": tmp_path / "maps", "FramesFolder": above / "b"}
    assert bundle.paths() == {name: str(path) for name, path in wanted.items()}


def test_times_and_names_reach_the_tasks_as_they_are(
    tmp_path: Path, small_mesh: SmallMesh, capsys: pytest.CaptureFixture[str]
) -> None:
    neutral, files = write_shot(tmp_path, small_mesh)
    rate = repr(24000 / 1001)
    more = ("--openjd", str(tmp_path / "job"), "--fps", rate)
    assert bake(neutral, files, tmp_path / "maps", *more, "--clip=-x") == 0
    words = template(tmp_path / "job")["steps"][0]["script"]["actions"]["onRun"]["args"]
    assert words[words.index("--fps") + 1] == rate
    assert "--clip=-x" in words
    assert bake(neutral, files, tmp_path / "maps", *more, "--clip", "{{Take}}") == 1
    assert "--clip {{Take}}: a job cannot hold a name with '{{'" in capsys.readouterr().err
