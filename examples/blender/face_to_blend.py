"""A face with expressions to a saved .blend: shape keys that play, wrinkles baked beside it, and
material, Cycles, camera and light set up, so that it opens and renders ready.

In a Python that has bpy, with the service running and the extension built:

    python clients/blender/build.py --out dist
    python examples/blender/face_to_blend.py rhytid-demo/face.npz --out shot/face.blend
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

# Blender reads it when it is imported: the extension goes to a folder of its own.
HOME = TemporaryDirectory(prefix="rhytid-blender-")
os.environ["BLENDER_USER_RESOURCES"] = HOME.name

import bpy  # noqa: E402
from faces import Face, read  # noqa: E402
from studio import light_up  # noqa: E402

ADDON = "bl_ext.user_default.rhytid"


def main() -> None:
    """Read the face, make the object, have its wrinkles grown and baked, save."""
    options = arguments()
    face = read(options.face)
    weights = face.weights(options.play)
    install(options.package, options.server)
    scene = bpy.context.scene
    obj = made(scene, face)
    play(obj, weights, options.frames)
    out = options.out.resolve()
    out.parent.mkdir(parents=True, exist_ok=True)
    obj.rhytid.resolution, obj.rhytid.unit = str(options.resolution), options.unit
    told(bpy.ops.rhytid.send(), "the mesh is sent and its wrinkles are grown")
    light_up(obj, options.at, options.width, options.size)
    # Saved before the maps are baked, so that their folder is named from the file on.
    bpy.ops.wm.save_as_mainfile(filepath=str(out))
    obj.rhytid.folder = f"//{out.stem}.maps/"
    told(bpy.ops.rhytid.bake(), f"{options.frames} frames are baked")
    scene.render.filepath = f"//{out.stem}.frames/"
    bpy.ops.wm.save_as_mainfile(filepath=str(out))
    print(out, flush=True)


def arguments() -> argparse.Namespace:
    """The options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    add = parser.add_argument
    add(
        "face", type=Path, help="npz with shapes and their names, or a folder of ICT FaceKit's data"
    )
    add("--out", type=Path, default=Path("face.blend"), help="the file to write")
    add("--play", default="smile", help="the expression that is played, to full and back")
    add("--frames", type=int, default=24, help="how many frames")
    add("--resolution", type=int, default=2048, help="texels per side of a map, a power of two")
    add("--unit", default="cm", help="what one unit of the face is")
    add("--at", type=float, nargs=3, help="where the camera looks, in the face's own numbers")
    add("--width", type=float, help="how wide its picture is there (default: the whole face)")
    add("--size", type=int, nargs=2, default=(960, 720), help="pixels of a frame")
    add("--server", default="http://127.0.0.1:8717", help="address of the service")
    package = Path("dist/rhytid-0.1.0.zip")
    add("--package", type=Path, default=package, help="the extension, as build.py makes it")
    return parser.parse_args()


def install(package: Path, server: str) -> None:
    """An empty scene, with the extension enabled."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.extensions.package_install_files(
        filepath=str(package.resolve()), repo="user_default", enable_on_install=True
    )
    bpy.context.preferences.addons[ADDON].preferences.server = server


def made(scene: bpy.types.Scene, face: Face) -> bpy.types.Object:
    """The face as an object, selected, with a shape key for each expression."""
    mesh = bpy.data.meshes.new("Face")
    mesh.from_pydata(face.positions.tolist(), [], face.faces.tolist())
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", face.corner_uv.ravel())
    obj = bpy.data.objects.new("Face", mesh)
    scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    # Files have y up, Blender has z.
    obj.rotation_euler.x = 1.5707963
    obj.shape_key_add(name="Basis")
    for name, shape in face.shapes.items():
        key = obj.shape_key_add(name=name, from_mix=False)
        key.data.foreach_set("co", shape.ravel())
        key.value = 0.0  # Blender 5.0 begins with 1
    return obj


def play(obj: bpy.types.Object, weights: dict[str, float], frames: int) -> None:
    """Key the shapes from nothing at the first frame over all to nothing at the last."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, frames
    for name, weight in weights.items():
        key = obj.data.shape_keys.key_blocks[name]
        key.slider_max = max(key.slider_max, weight)
        for frame, value in ((1, 0.0), ((frames + 1) // 2, weight), (frames, 0.0)):
            key.value = value
            key.keyframe_insert("value", frame=frame)
    scene.frame_set(1)


def told(result: Sequence[str], what: str) -> None:
    """Say what was done; an operator that fails raises RuntimeError by itself."""
    print(what if "FINISHED" in result else f"not done: {what}", flush=True)


if __name__ == "__main__":
    main()
    HOME.cleanup()
    # bpy, not Blender, may crash while Python ends, when all is done.
    os._exit(0)
