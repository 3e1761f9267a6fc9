"""A .blend that is saved has its maps beside it; without them skin is smooth, and it is told."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenEXR
import pytest
from cameras import height, look_down
from scenes import FIRST, add, animate, grid

from conftest import preferences

COUNT, TEXELS, TEXEL = 48, 256, 0.01
PIXELS = 21
# Opens a file and renders a frame: a process of its own, as on a machine of a render farm.
RENDER = """
import sys, bpy
path, out, server, frame = sys.argv[1:5]
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
if server != "none":
    bpy.ops.preferences.addon_enable(module="bl_ext.user_default.rhytid")
    bpy.context.preferences.addons["bl_ext.user_default.rhytid"].preferences.server = server
bpy.ops.wm.open_mainfile(filepath=path)
scene = bpy.context.scene
scene.render.filepath = out
scene.frame_set(int(frame))
camera, status = scene.camera, 0
try:
    bpy.ops.render.render(write_still=True)
except RuntimeError as exc:
    assert scene.camera == camera
    print("ended:", exc)
    status = 3
sys.exit(status)
"""
NOBODY = "http://127.0.0.1:9"


@pytest.fixture
def sheet(blender: bpy.types.Scene) -> bpy.types.Object:
    """A sheet that was sent, still; a camera looks down on it."""
    rest, faces, uv = grid(COUNT, TEXELS * TEXEL, 1, TEXELS)
    obj = add("Sheet", rest, faces, uv)
    obj.rhytid.resolution, obj.rhytid.unit = "256", "cm"
    bpy.ops.rhytid.send()
    blender.world = bpy.data.worlds.new("world")
    look_down(blender, (0.5 * TEXELS * TEXEL, 0.5 * TEXELS * TEXEL), TEXEL / 32, PIXELS)
    return obj


def file_of(obj: bpy.types.Object) -> Path:
    return Path(bpy.path.abspath(obj.rhytid.image.filepath))


def save(path: Path, copy: bool = False) -> None:
    assert bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=copy) == {"FINISHED"}


def blender_ends() -> None:
    """Blender deletes its temporary folder at its end."""
    shutil.rmtree(Path(bpy.app.tempdir) / "rhytid")


def middle(found: np.ndarray) -> float:
    half = len(found) // 2
    return float(found[half - 1 : half + 1, half - 1 : half + 1].astype(np.float64).mean())


def drawn(file: Path) -> float:
    """The map's value in the middle, where the camera looks."""
    return middle(OpenEXR.File(str(file), separate_channels=True).channels()["Y"].pixels)


def rendered(
    blend: Path, out: Path, server: str = "none", frame: int = FIRST
) -> tuple[subprocess.CompletedProcess[str], float | None]:
    """A render by another process, and the height in its middle; server "none": no extension."""
    given = [sys.executable, "-c", RENDER, str(blend), str(out), server, str(frame)]
    run = subprocess.run(given, cwd=out.parent, capture_output=True, text=True, env=os.environ)
    found = height(out) if out.exists() else None
    return run, None if found is None else float(found[PIXELS // 2, PIXELS // 2])


def test_a_saved_file_has_its_map_wherever_it_goes(sheet: bpy.types.Object, tmp_path: Path) -> None:
    expected = drawn(file_of(sheet))
    (tmp_path / "here").mkdir()
    save(tmp_path / "here" / "shot.blend")
    assert file_of(sheet).parent == tmp_path / "here" / "rhytid" / "shot"
    blender_ends()
    moved = (tmp_path / "here").rename(tmp_path / "there")
    run, found = rendered(moved / "shot.blend", tmp_path / "z.exr")
    assert run.returncode == 0, run.stderr
    assert abs(expected) > 1e-4
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("extension", [False, True])
def test_a_missing_map_displaces_nothing(
    sheet: bpy.types.Object, tmp_path: Path, extension: bool
) -> None:
    """With the extension a render ends with an error, also where live updates are off."""
    sheet.rhytid.live = False
    save(tmp_path / "shot.blend")
    blender_ends()
    shutil.rmtree(tmp_path / "rhytid")
    server = NOBODY if extension else "none"
    run, found = rendered(tmp_path / "shot.blend", tmp_path / "z.exr", server)
    if extension:
        assert run.returncode == 3, run.stderr
        assert "The map of 'Sheet' is missing, its skin is smooth" in run.stderr
        assert found is None
    else:
        assert found == pytest.approx(0.0, abs=1e-7)


def test_the_panel_tells_of_a_missing_map(sheet: bpy.types.Object, tmp_path: Path) -> None:
    from bl_ext.user_default.rhytid import state

    save(tmp_path / "shot.blend")
    shutil.rmtree(tmp_path / "rhytid")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    status = state.status(bpy.data.objects["Sheet"])
    assert status.failed
    assert status.text.startswith("The map of 'Sheet' is missing, its skin is smooth: press 'Draw")
    bpy.context.view_layer.objects.active = bpy.data.objects["Sheet"]
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert (status.text, status.failed) == ("Up to date", False)


def test_a_missing_file_of_a_bake_ends_the_render(
    sheet: bpy.types.Object, blender: bpy.types.Scene, tmp_path: Path
) -> None:
    blender.frame_start, blender.frame_end = FIRST, 3
    sheet.rhytid.folder = str(tmp_path / "maps")
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    save(tmp_path / "shot.blend")
    assert rendered(tmp_path / "shot.blend", tmp_path / "a.exr", NOBODY, 2)[0].returncode == 0
    (tmp_path / "maps" / "Sheet.1001.0002.exr").unlink()
    run, found = rendered(tmp_path / "shot.blend", tmp_path / "b.exr", NOBODY, 2)
    assert (run.returncode, found) == (3, None)
    assert "The map of 'Sheet' is missing, its skin is smooth: bake the frames" in run.stderr


def test_saving_again_draws_nothing_and_keeps_what_older_versions_show(
    sheet: bpy.types.Object, tmp_path: Path
) -> None:
    animate(sheet, "wide", grid(COUNT, TEXELS * TEXEL, 1, TEXELS)[0] * (1.25, 0.75, 1.0))
    folder = tmp_path / "rhytid" / "shot"
    names = []
    for frame in (FIRST, 4, 8, 8):
        bpy.context.scene.frame_set(frame)
        save(tmp_path / "shot.blend")
        names.append(file_of(sheet).name)
        shown = sheet.rhytid.image.filepath
        assert bpy.ops.rhytid.update() == {"FINISHED"}
        assert sheet.rhytid.image.filepath == shown, "what was saved was drawn again"
    assert len(set(names)) == 3
    # One older version, as Blender keeps it from the start.
    assert bpy.context.preferences.filepaths.save_version == 1
    assert {file.name for file in folder.iterdir()} == set(names[-3:])


def test_nothing_of_others_is_removed(sheet: bpy.types.Object, tmp_path: Path) -> None:
    folder = tmp_path / "rhytid" / "shot"
    folder.mkdir(parents=True)
    others = [folder / "Sheet.1001.0001.exr", folder / "Sheet.txt", tmp_path / "rhytid" / "a.exr"]
    for file in others:
        file.write_text("mine")
    for scale in (1.0, 1.1, 1.2, 1.3):
        sheet.data.vertices[0].co.x *= scale
        sheet.data.update()
        bpy.ops.rhytid.update()
        save(tmp_path / "shot.blend")
    assert [file.read_text() for file in others] == ["mine"] * 3


def test_saved_under_another_name_it_has_maps_of_its_own(
    sheet: bpy.types.Object, tmp_path: Path
) -> None:
    (tmp_path / "other").mkdir()
    expected = drawn(file_of(sheet))
    save(tmp_path / "one.blend")
    save(tmp_path / "other" / "two.blend")
    assert file_of(sheet).parent == tmp_path / "other" / "rhytid" / "two"
    save(tmp_path / "copy.blend", copy=True)
    assert file_of(sheet).parent == tmp_path / "other" / "rhytid" / "two"
    blender_ends()
    for name in ("one", "copy"):
        shutil.rmtree(tmp_path / "other" / "rhytid", ignore_errors=True)
        found = rendered(tmp_path / f"{name}.blend", tmp_path / f"{name}.exr")[1]
        assert found == pytest.approx(expected, rel=1e-3)


def test_a_map_that_cannot_be_kept_is_told(
    sheet: bpy.types.Object, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    from bl_ext.user_default.rhytid import state

    (tmp_path / "rhytid").write_text("a file where the folder should be")
    save(tmp_path / "shot.blend")
    told = "The saved file does not have the map of 'Sheet'"
    assert f"rhytid: {told}" in capfd.readouterr().err
    assert state.status(sheet).text.startswith(told)
    assert state.status(sheet).failed


def test_tiles_are_kept(blender: bpy.types.Scene, tmp_path: Path) -> None:
    obj = add("Two", *grid(16, 6.0, udims=2))
    obj.rhytid.resolution = "256"
    bpy.ops.rhytid.send()
    save(tmp_path / "shot.blend")
    assert obj.rhytid.image.filepath.startswith("//rhytid/shot/Two.<UDIM>.")
    names = sorted(file.name.split(".")[1] for file in (tmp_path / "rhytid" / "shot").iterdir())
    assert names == ["1001", "1002"]


def test_a_packed_map_is_drawn_anew(sheet: bpy.types.Object, tmp_path: Path) -> None:
    """What is packed would be shown, whatever is drawn."""
    sheet.rhytid.image.pack()
    save(tmp_path / "shot.blend")
    assert not (tmp_path / "rhytid").exists()
    sheet.data.vertices[0].co.x *= 1.5
    sheet.data.update()
    assert bpy.ops.rhytid.update() == {"FINISHED"}
    assert not sheet.rhytid.image.packed_files
    assert file_of(sheet).is_file()


def test_a_stopped_render_leaves_the_camera(
    sheet: bpy.types.Object, blender: bpy.types.Scene, tmp_path: Path
) -> None:
    animate(sheet, "wide", grid(COUNT, TEXELS * TEXEL, 1, TEXELS)[0] * (1.25, 0.75, 1.0))
    blender.frame_end = 2
    preferences().server = NOBODY
    blender.render.filepath = str(tmp_path / "z.")
    camera = blender.camera
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.render.render(animation=True)
    assert blender.camera == camera
    # The map of the first frame was there.
    assert [file.name for file in tmp_path.iterdir()] == ["z.0001.exr"]


def test_what_is_known_of_an_object_follows_its_name(sheet: bpy.types.Object) -> None:
    from bl_ext.user_default.rhytid import state

    path = sheet.rhytid.image.filepath
    sheet.name = "Renamed"
    other = add("Sheet", *grid(16, 12.0))
    assert state.status(other).text == ""
    assert state.status(sheet).text == "Up to date"
    other.rhytid.resolution = "256"
    for wide in (1.0, 1.1, 1.2, 1.3, 1.4):
        other.data.vertices[0].co.x += wide
        other.data.update()
        bpy.ops.rhytid.send() if wide == 1.0 else bpy.ops.rhytid.update()
    assert file_of(sheet).is_file(), "an object with its old name removed its map"
    assert sheet.rhytid.image.filepath == path


def test_what_drew_a_map_goes_on_to_draw_it(sheet: bpy.types.Object) -> None:
    """Whatever it and its copy are called since."""
    from bl_ext.user_default.rhytid import updating

    copy = sheet.copy()
    copy.data = sheet.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    sheet.name = "Old"
    copy.name = "Sheet"
    bpy.context.view_layer.update()
    assert updating.live(bpy.context.scene) == [sheet, copy]


def test_a_calibration_leaves_events_to_the_window(sheet: bpy.types.Object) -> None:
    """It comes back after each step, and says that it is done when the server has ended."""
    from bl_ext.user_default.rhytid import operators

    told: list[Any] = []
    steps = operators.RHYTID_OT_calibrate.steps(
        type("Told", (), {"report": lambda self, kind, text: told.append(text)})(), bpy.context
    )
    assert next(steps)[1] == "sending"
    for _ in steps:
        assert told == []
    assert told == ["Precomputed maps are made for this stretch"]


def test_defaults_are_those_of_the_command_line(blender: bpy.types.Scene) -> None:
    assert add("Sheet", *grid(4, 12.0)).rhytid.resolution == "4096"
