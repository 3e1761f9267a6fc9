"""Heights as Cycles renders them: the Z pass of a camera that looks straight down on a sheet."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import OpenEXR

DISTANCE = 1.0


def look_down(
    scene: bpy.types.Scene, centre: tuple[float, float], pixel: float, count: int
) -> None:
    """An orthographic camera whose middle pixel's centre is over `centre`; count² pixels, odd."""
    lens = bpy.data.cameras.new("camera")
    lens.type, lens.ortho_scale = "ORTHO", pixel * count
    lens.clip_start, lens.clip_end = 0.01, 10.0
    seat = bpy.data.objects.new("camera", lens)
    seat.location = (*centre, DISTANCE)
    scene.collection.objects.link(seat)
    scene.camera = seat
    render = scene.render
    render.resolution_x = render.resolution_y = count
    render.resolution_percentage = 100
    scene.view_layers[0].use_pass_z = True
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    # Samples are taken near the centres of pixels: within 0.005 of one.
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 0.01
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    render.image_settings.color_depth = "32"


def render(scene: bpy.types.Scene, folder: Path, frames: tuple[int, ...]) -> list[np.ndarray]:
    """Heights of each frame, rendered as an animation; row 0 at the largest y."""
    scene.frame_start, scene.frame_end = frames[0], frames[-1]
    scene.frame_step = frames[1] - frames[0] if len(frames) > 1 else 1
    scene.render.filepath = str(folder / "z.")
    bpy.ops.render.render(animation=True)
    return [height(folder / f"z.{frame:04d}.exr") for frame in frames]


def height(path: Path) -> np.ndarray:
    """The heights in a rendered file."""
    # Blender 5.0 writes a part for each pass.
    parts = OpenEXR.File(str(path), separate_channels=True).parts
    channels = {name: found for part in parts for name, found in part.channels.items()}
    (name,) = [name for name in channels if name.endswith("Depth.Z")]
    return DISTANCE - channels[name].pixels.astype(np.float64)
