"""The script of the gallery: what it bakes is what it shows, and what is there is kept."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
import rendering
import sheets
import shots
import stage
from face import Face
from PIL import Image

pytestmark = pytest.mark.face

TEXELS = 256
VIEW = shots.View((3.3, 4.6, 9.4), 8.0, 18, (0.7, 0.6, 0.2), (96, 72))
SHOT = shots.Shot("trial", VIEW, range(1, 3), samples=16)


@pytest.fixture(scope="module")
def face() -> Face:
    return Face.read(Path(os.environ["RHYTID_FACE_DATA"]) / "ict_face")


@pytest.fixture
def shown(blender: bpy.types.Scene, face: Face, tmp_path: Path) -> tuple[bpy.types.Object, Path]:
    """The face at rest in two frames: flat, then with ridges of half a millimetre."""
    maps = tmp_path / "maps"
    maps.mkdir()
    ridges = 0.05 * np.sin(np.arange(TEXELS) / 2.0, dtype=np.float32)
    for frame, height in ((1, 0.0), (2, 1.0)):
        written(maps / f"face.1001.{frame:04d}.exr", np.tile(height * ridges, (TEXELS, 1)))
    obj = stage.build(face, np.zeros((2, len(face.names)), np.float32))
    obj.rhytid.unit = "cm"
    assert bpy.ops.rhytid.open(directory=str(maps)) == {"FINISHED"}
    rendering.settle(percent=100)
    return obj, maps


def written(path: Path, heights: np.ndarray) -> None:
    header = {"type": OpenEXR.scanlineimage, "unit": "cm"}
    OpenEXR.File(header, {"Y": np.ascontiguousarray(heights)}).write(str(path))


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path), np.float64)


def test_frames_show_their_maps(shown: tuple, tmp_path: Path) -> None:
    obj, _ = shown
    plain = [pixels(path) for path in rendering.rendered(obj, tmp_path, SHOT, "without")]
    given = [pixels(path) for path in rendering.rendered(obj, tmp_path, SHOT, "with")]

    assert np.array_equal(plain[0], plain[1])
    # What is left of a flat map is noise: sides differ in samples and in dicing.
    flat, ridged = (np.abs(a - b).mean() for a, b in zip(given, plain, strict=True))
    assert ridged > 5 * flat


def test_only_what_is_missing_is_rendered(
    shown: tuple, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    obj, maps = shown
    first, second = rendering.rendered(obj, tmp_path, SHOT, "with")
    assert sorted(first.parent.iterdir()) == [first, second]
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("trial")]
    assert [line.partition(",")[0] for line in told] == [
        "trial with: frame 1",
        "trial with: frame 2",
    ]

    second.unlink()
    kept = first.stat().st_mtime_ns
    rendering.rendered(obj, tmp_path, SHOT, "with")
    assert first.stat().st_mtime_ns == kept
    assert second.exists()

    newer = second.stat().st_mtime + 10
    os.utime(maps / "face.1001.0001.exr", (newer, newer))
    rendering.rendered(obj, tmp_path, SHOT, "with")
    assert first.stat().st_mtime_ns > kept


def test_the_scene_moves_as_what_is_baked(
    blender: bpy.types.Scene, face: Face, tmp_path: Path
) -> None:
    moves = shots.weights(face)
    face.write(tmp_path / "face.npz", moves)
    obj = stage.build(face, moves)
    with np.load(tmp_path / "face.npz") as baked:
        frames, corners = baked["frames"], baked["uv"][baked["face_uv"]]
        at = baked["positions"][baked["faces"]]
    assert len(frames) == blender.frame_end == shots.CAPTURED + len(shots.EXPRESSIONS)

    for frame in (1, 20, shots.CAPTURED, len(frames)):
        blender.frame_set(frame)
        now = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        found = np.empty(3 * len(now.vertices), np.float32)
        now.vertices.foreach_get("co", found)
        assert np.abs(found.reshape(-1, 3) - frames[frame - 1]).max() < 1e-4
    assert np.abs(frames[19] - frames[0]).max() > 0.3

    own = {(tuple(p), tuple(t)) for p, t in zip(*corner_values(obj), strict=True)}
    sent = {
        (tuple(p), tuple(t))
        for p, t in zip(at.reshape(-1, 3).round(5), corners.reshape(-1, 2).round(5), strict=True)
    }
    assert own == sent


def corner_values(obj: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Position and uv of each corner of the mesh at rest."""
    mesh = obj.data
    ids, uv = np.empty(len(mesh.loops), np.int32), np.empty(2 * len(mesh.loops), np.float32)
    mesh.loops.foreach_get("vertex_index", ids)
    mesh.uv_layers[0].uv.foreach_get("vector", uv)
    rest = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.shape_keys.reference_key.data.foreach_get("co", rest)
    return rest.reshape(-1, 3)[ids].round(5), uv.reshape(-1, 2).round(5)


def test_the_film_has_all_frames(tmp_path: Path) -> None:
    frames = [Image.new("RGB", (32, 16), (k * 40, 0, 0)) for k in range(5)]
    sheets.film(frames, tmp_path / "film.webp", fps=15, quality=80)
    with Image.open(tmp_path / "film.webp") as film:
        assert (film.n_frames, film.size, film.info["loop"]) == (5, (32, 16), 0)
        film.seek(3)
        film.load()
        assert film.info["duration"] == 67
        assert film.convert("RGB").getpixel((16, 8))[0] == pytest.approx(120, abs=4)
