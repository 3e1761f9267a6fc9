"""examples/blender: from a face with expressions to a .blend that renders without anything else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import grid

SCRIPT = Path(__file__).resolve().parents[3] / "examples" / "blender" / "face_to_blend.py"
# What the saved file holds, read by a Blender that has no extension; then its second frame.
READ = """
import json, os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene, obj = bpy.context.scene, bpy.data.objects["Face"]
nodes = obj.active_material.node_tree.nodes
texture, height = nodes["rhytid map"], nodes["rhytid height"]
keys = obj.data.shape_keys.key_blocks
values = []
for frame in (1, 2, 3):
    scene.frame_set(frame)
    values.append([round(key.value, 6) for key in keys[1:]])
known = hasattr(obj, "rhytid")
scene.frame_start = scene.frame_end = 2
scene.cycles.samples = 1
bpy.ops.render.render(animation=True)
print("READ" + json.dumps({
    "extension": known,
    "keys": [key.name for key in keys],
    "values": values,
    "image": texture.image.filepath,
    "source": texture.image.source,
    "space": texture.image.colorspace_settings.name,
    "frames": texture.image_user.frame_duration,
    "midlevel": height.inputs["Midlevel"].default_value,
    "scale": height.inputs["Scale"].default_value,
    "engine": scene.render.engine,
    "camera": scene.camera is not None,
}), flush=True)
os._exit(0)
"""


@pytest.fixture
def face(tmp_path: Path) -> Path:
    """A sheet of 12 cm with two expressions."""
    rest, quads, uv = grid(24, 12.0)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    corners = np.concatenate([uv[:, [0, 1, 2]], uv[:, [0, 2, 3]]]).reshape(-1, 2)
    shapes = np.stack([rest * (1.2, 0.9, 1.0), rest * (0.8, 1.0, 1.0)])
    file = tmp_path / "face.npz"
    np.savez(
        file,
        positions=rest,
        faces=triangles,
        uv=corners,
        face_uv=np.arange(len(corners)).reshape(-1, 3),
        shapes=shapes,
        names=np.array(["wide", "narrow"]),
    )
    return file


def script(*given: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *given]
    temporary = folder / "temporary"
    temporary.mkdir()
    place = {**os.environ, "TMPDIR": str(temporary)}
    return subprocess.run(command, cwd=folder, env=place, capture_output=True, text=True)


def test_the_file_renders_without_extension_and_server(
    package: Path, service: str, face: Path, tmp_path: Path
) -> None:
    given = ["--out", "shot/face.blend", "--play", "narrow", "--frames", "3", "--size", "40", "30"]
    given += ["--resolution", "256", "--server", service, "--package", str(package)]
    ended = script(str(face), *given, folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines()[-1] == str(tmp_path / "shot" / "face.blend")
    assert list((tmp_path / "temporary").glob("rhytid-blender-*")) == []
    files = sorted(path.name for path in (tmp_path / "shot" / "face.maps").iterdir())
    assert files == [f"Face.1001.000{frame}.exr" for frame in (1, 2, 3)]

    (tmp_path / "shot").rename(tmp_path / "elsewhere")
    blend = tmp_path / "elsewhere" / "face.blend"
    empty = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "none")}
    command = [sys.executable, "-c", READ, str(blend)]
    told = subprocess.run(command, cwd=tmp_path, env=empty, capture_output=True, text=True).stdout
    found = json.loads(told.partition("READ")[2].splitlines()[0])
    assert found == {
        "extension": False,
        "keys": ["Basis", "wide", "narrow"],
        "values": [[0, 0], [0, 1], [0, 0]],
        "image": "//face.maps/Face.1001.0001.exr",
        "source": "SEQUENCE",
        "space": "Non-Color",
        "frames": 3,
        "midlevel": 0,
        "scale": 1,
        "engine": "CYCLES",
        "camera": True,
    }
    assert [path.name for path in (blend.parent / "face.frames").iterdir()] == ["0002.png"]


@pytest.mark.parametrize("what", ["expression", "face"])
def test_what_is_missing_is_told(face: Path, tmp_path: Path, what: str) -> None:
    if what == "face":
        np.savez(face, positions=np.zeros((3, 3)))
    ended = script(str(face), "--play", "smirk", folder=tmp_path)
    told = "no expression 'smirk': wide, narrow" if what == "expression" else "has no expressions"
    assert ended.returncode == 1
    assert told in ended.stderr
