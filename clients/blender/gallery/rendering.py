"""Frames of shots as files. Those that are there already are not rendered again."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import bpy
import stage
from shots import Shot

# Strength, by the extension's control; pixels to a micropolygon; one sample in how many. A smooth
# surface needs fewer of both.
SIDES = {"without": (0.0, 4.0, 2), "with": (1.0, 1.0, 1)}


def settle(percent: int) -> None:
    """What is of the pictures alone: sampling, denoiser, size, format."""
    scene = bpy.context.scene
    scene.cycles.use_adaptive_sampling, scene.cycles.offscreen_dicing_scale = False, 16.0
    scene.cycles.use_denoising, scene.cycles.denoiser = True, "OPENIMAGEDENOISE"
    scene.cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    scene.cycles.denoising_prefilter = "ACCURATE"
    # The same noise in every frame, so that what is left of it does not boil.
    scene.cycles.seed, scene.cycles.use_animated_seed = 1, False
    scene.render.resolution_percentage = percent
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"


def rendered(obj: bpy.types.Object, out: Path, shot: Shot, side: str) -> list[Path]:
    """The pictures of a shot, made where they are missing or older than their maps, with a line of
    progress for each."""
    target = _folder(out, shot, side)
    target.mkdir(parents=True, exist_ok=True)
    paths = {frame: target / f"{frame:04d}.png" for frame in shot.frames}
    missing = [frame for frame, path in paths.items() if not _is_new(path, obj, frame)]
    if missing:
        _turn_to(obj, shot, side)
    start = time.monotonic()
    for done, frame in enumerate(missing, start=1):
        _render(frame, paths[frame])
        each = (time.monotonic() - start) / done
        left = f"{each:.1f} s each, {each * (len(missing) - done) / 60:.1f} min left"
        _say(f"{shot.name} {side}: frame {frame}, {done} of {len(missing)}, {left}")
    return list(paths.values())


def _turn_to(obj: bpy.types.Object, shot: Shot, side: str) -> None:
    cycles = bpy.context.scene.cycles
    obj.rhytid.strength, cycles.dicing_rate, fewer = SIDES[side]
    cycles.samples = shot.samples // fewer
    stage.look(shot.view)


def _folder(out: Path, shot: Shot, side: str) -> Path:
    """Its name has what frames look like, so that those of another view are not taken for these."""
    view, percent = shot.view, bpy.context.scene.render.resolution_percentage
    numbers = [*view.at, view.width, view.turn, *view.light, *view.size, percent, shot.samples]
    return out / f"{shot.name}_{side}" / "_".join(f"{number:g}" for number in numbers)


def _is_new(path: Path, obj: bpy.types.Object, frame: int) -> bool:
    """Whether a picture is there and was made after its maps."""
    pattern = bpy.path.abspath(obj.rhytid.pattern)
    pattern = pattern.replace("<FRAME>", f"{frame:0{obj.rhytid.digits}d}")
    maps = [Path(pattern.replace("<UDIM>", str(udim))) for udim in obj.rhytid.udim_list()]
    made = path.stat().st_mtime if path.exists() else 0.0
    return all(made > file.stat().st_mtime for file in maps)


def _render(frame: int, path: Path) -> None:
    """A file has its name when it is whole."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    aside = path.with_name(f"part_{path.name}")
    scene.render.filepath = str(aside)
    bpy.ops.render.render(write_still=True)
    aside.replace(path)


def _say(text: str) -> None:
    # Blender fills stdout.
    sys.stderr.write(f"{text}\n")
