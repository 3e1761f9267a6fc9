"""Baked maps: drawn as files, opened with everything set, played at the right frames."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
from cameras import look_down, render
from scenes import LAST, add, animate, client_of, grid, share

from conftest import preferences

COUNT, TEXELS, TEXEL = 48, 256, 0.01
PIXELS = 21
WIDE = np.array([1.25, 0.75, 1.0])


def sheet(udims: int = 1) -> bpy.types.Object:
    rest, faces, uv = grid(COUNT, TEXELS * TEXEL, udims, TEXELS)
    obj = add("Sheet", rest, faces, uv)
    animate(obj, "wide", rest * WIDE)
    obj.rhytid.resolution, obj.rhytid.unit = "256", "cm"
    return obj


def texels(path: Path) -> np.ndarray:
    return OpenEXR.File(str(path), separate_channels=True).channels()["Y"].pixels


def heights(
    scene: bpy.types.Scene, folder: Path, frames: tuple[int, ...], udim: int = 0
) -> list[float]:
    """What Cycles renders over the middle of a sheet, where nothing but the map moves it."""
    scene.render.use_persistent_data = True
    scene.world = scene.world or bpy.data.worlds.new("world")
    # The middle of a sheet is the corner of four texels.
    look_down(scene, ((udim + 0.5) * TEXELS * TEXEL, 0.5 * TEXELS * TEXEL), TEXEL / 32, PIXELS)
    return [float(found[PIXELS // 2, PIXELS // 2]) for found in render(scene, folder, frames)]


def middle(found: np.ndarray) -> float:
    half = TEXELS // 2
    return float(found[half - 1 : half + 1, half - 1 : half + 1].astype(np.float64).mean())


def still(obj: bpy.types.Object) -> None:
    """Take the animation away: what is rendered moves by its maps alone."""
    obj.data.shape_keys.animation_data_clear()
    obj.data.shape_keys.key_blocks["wide"].value = 0.0


@pytest.fixture
def baked(blender: bpy.types.Scene, service: str, tmp_path: Path) -> tuple[bpy.types.Object, Path]:
    obj = sheet()
    bpy.ops.rhytid.send()
    folder = tmp_path / "maps"
    obj.rhytid.folder = str(folder)
    blender.frame_set(3)
    assert bpy.ops.rhytid.bake() == {"FINISHED"}
    return obj, folder


def test_files_are_the_maps_of_the_frames(service: str, baked: tuple) -> None:
    obj, folder = baked
    names = [f"Sheet.1001.{frame:04d}.exr" for frame in range(1, LAST + 1)]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert bpy.context.scene.frame_current == 3
    client, rest = client_of(service), grid(COUNT, TEXELS * TEXEL, 1, TEXELS)[0]
    for frame in (1, 7, LAST):
        client.put_frame(obj.rhytid.asset, "test", rest * (1 + share(frame) * (WIDE - 1)))
        expected = client.map(obj.rhytid.asset, "test", 1001, sampling="smooth").array
        found = texels(folder / names[frame - 1])
        assert np.abs(found - expected).max() <= 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("start", [1, 4])
def test_a_sequence_plays_without_a_server(
    baked: tuple, blender: bpy.types.Scene, tmp_path: Path, start: int
) -> None:
    obj, folder = baked
    preferences().server = "http://127.0.0.1:9"
    still(obj)
    if start != 1:
        bpy.ops.rhytid.open(directory=str(folder), start=start)
    frames = (4, 6, 8)
    depth = max(abs(middle(texels(path))) for path in folder.iterdir())
    drawn = [middle(texels(folder / f"Sheet.1001.{f - start + 1:04d}.exr")) for f in frames]
    assert max(drawn) - min(drawn) > 0.01 * depth
    assert heights(blender, tmp_path, frames) == pytest.approx(drawn, abs=1e-3 * depth)


def test_tiles_play_by_the_frame(service: str, blender: bpy.types.Scene, tmp_path: Path) -> None:
    obj = sheet(2)
    bpy.ops.rhytid.send()
    obj.rhytid.folder = str(tmp_path / "maps")
    bpy.ops.rhytid.bake()
    preferences().server = "http://127.0.0.1:9"
    still(obj)
    assert obj.rhytid.image.source == "TILED"
    frames = (2, 6, 10)
    found = heights(blender, tmp_path, frames, udim=1)
    drawn = [middle(texels(tmp_path / "maps" / f"Sheet.1002.{f:04d}.exr")) for f in frames]
    assert max(drawn) - min(drawn) > 0.01 * max(map(abs, drawn))
    assert found == pytest.approx(drawn, abs=1e-3 * max(map(abs, drawn)))


def test_a_folder_of_the_command_line(blender: bpy.types.Scene, tmp_path: Path) -> None:
    """`rhytid bake` in millimetres, opened on a mesh in centimetres."""
    rest, faces, uv = grid(COUNT, TEXELS * TEXEL, 1, TEXELS)
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    corners = np.concatenate([uv[:, [0, 1, 2]], uv[:, [0, 2, 3]]]).reshape(-1, 2)
    of_corner = np.arange(len(corners)).reshape(-1, 3)
    frames = np.stack([rest * (1 + part * (WIDE - 1)) for part in (0.0, 0.5, 1.0)]) * 10
    np.savez(
        tmp_path / "flat.npz",
        positions=rest * 10,
        faces=triangles,
        uv=corners,
        face_uv=of_corner,
        frames=frames,
    )
    (tmp_path / "mm.json").write_text('{"unit": "mm", "tile_size": 256}')
    command = shlex.split(os.environ.get("RHYTID_SERVE", "rhytid serve"))
    assert command.pop() == "serve"
    given = ["--mesh", "flat.npz", "--settings", "mm.json", "--resolution", "256", "--out", "maps"]
    subprocess.run([*command, "bake", *given], cwd=tmp_path, check=True, capture_output=True)
    obj = add("Sheet", rest, faces, uv)
    obj.rhytid.unit = "cm"

    assert bpy.ops.rhytid.open(directory=str(tmp_path / "maps"), start=20) == {"FINISHED"}

    drawn = [0.1 * middle(texels(tmp_path / "maps" / f"flat.1001.{f:04d}.exr")) for f in (1, 2, 3)]
    assert max(drawn) - min(drawn) > 0.01 * max(map(abs, drawn))
    found = heights(blender, tmp_path, (20, 21, 22))
    assert found == pytest.approx(drawn, abs=1e-3 * max(map(abs, drawn)))

    from bl_ext.user_default.rhytid import state

    assert state.status(obj).of_frame == ()
    other = add("Other", *grid(COUNT + 1, TEXELS * TEXEL, 1, TEXELS))
    assert bpy.ops.rhytid.open(directory=str(tmp_path / "maps")) == {"FINISHED"}
    (told,) = state.status(other).of_frame
    triangles = f"{2 * (COUNT - 1) ** 2} triangles, 'Other' has {2 * COUNT**2}"
    assert told.startswith(f"flat was baked from a mesh of {triangles}")


def test_what_is_missing_is_told(blender: bpy.types.Scene, tmp_path: Path) -> None:
    sheet()
    with pytest.raises(RuntimeError, match="has no files named NAME"):
        bpy.ops.rhytid.open(directory=str(tmp_path))
    for name in ("a.1001.0001", "a.1001.0003", "b.1001.0001"):
        (tmp_path / f"{name}.exr").write_bytes(b"")
    with pytest.raises(RuntimeError, match="has maps of a, b: give the name of one"):
        bpy.ops.rhytid.open(directory=str(tmp_path))
    with pytest.raises(RuntimeError, match="Maps of frame 2 are missing"):
        bpy.ops.rhytid.open(directory=str(tmp_path), name="a")


def test_a_cancelled_bake_leaves_the_frame(baked: tuple, blender: bpy.types.Scene) -> None:
    from bl_ext.user_default.rhytid import bake

    steps = bake.RHYTID_OT_bake.steps(None, bpy.context)
    for _ in range(3):
        share, text, _ = next(steps)
    assert text == f"frame 3 of {LAST}"
    assert share == pytest.approx(2 / LAST)
    steps.close()
    assert blender.frame_current == 3


def test_a_render_without_a_server_ends_with_an_error(
    blender: bpy.types.Scene, service: str, tmp_path: Path
) -> None:
    sheet()
    bpy.ops.rhytid.send()
    blender.world = bpy.data.worlds.new("world")
    look_down(blender, (0.0, 0.0), TEXEL, 8)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    run = """
import sys, bpy
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
bpy.ops.preferences.addon_enable(module="bl_ext.user_default.rhytid")
bpy.ops.wm.open_mainfile(filepath=sys.argv[3])
bpy.context.preferences.addons["bl_ext.user_default.rhytid"].preferences.server = sys.argv[1]
bpy.context.scene.render.filepath = sys.argv[2]
status = 0
try:
    bpy.ops.render.render(animation=True)
except RuntimeError as exc:
    print(exc)
    status = 1
sys.exit(status)
"""
    ends = []
    for server, out in ((service, "good."), ("http://127.0.0.1:9", "bad.")):
        given = [sys.executable, "-c", run, server, str(tmp_path / out)]
        given.append(str(tmp_path / "shot.blend"))
        ends.append(subprocess.run(given, cwd=tmp_path, capture_output=True, text=True))
    assert ends[0].returncode == 0, ends[0].stderr
    assert len(list(tmp_path.glob("good.*.exr"))) == LAST
    assert ends[1].returncode == 1
    assert "frame 1 has no map of its own: No answer" in ends[1].stderr
    assert "Cannot render, no camera" in ends[1].stdout
    assert list(tmp_path.glob("bad.*")) == []
