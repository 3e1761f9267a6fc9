"""What Cycles displaces is our map, within 1e-4 of the depth of a wrinkle of strength 1.

Compared is z of the rendered surface, from the Z pass, with the value of the map at the same place,
as the service answers it to a client that is not Blender.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from cameras import look_down, render
from scenes import LAST, add, animate, client_of, grid, share

# A sheet of 64² vertices at the centres of texels of 0.1 mm, in a map of 256², in cm.
COUNT, TEXELS_A_SIDE, TEXEL = 64, 256, 0.01
# Pixels in a texel, and how many texels are looked at.
PIXELS, TEXELS = 32, 8
MIDDLE = 120
WIDE = np.array([1.25, 0.75, 1.0])
FRAMES = (1, 6, LAST)


def patch() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return grid(COUNT, TEXELS_A_SIDE * TEXEL, texels=TEXELS_A_SIDE)


@pytest.fixture
def sheet(blender: bpy.types.Scene) -> bpy.types.Object:
    rest, faces, uv = patch()
    obj = add("Patch", rest, faces, uv)
    animate(obj, "wide", rest * WIDE)
    obj.rhytid.resolution, obj.rhytid.unit = "256", "cm"
    bpy.ops.rhytid.send()
    blender.world = bpy.data.worlds.new("world")
    return obj


def expected(service: str, obj: bpy.types.Object, frame: int) -> np.ndarray:
    """The map of a frame, row 0 at the smallest v."""
    client, asset = client_of(service), obj.rhytid.asset
    rest = patch()[0]
    client.put_frame(asset, "test", rest * (1 + share(frame) * (WIDE - 1)))
    return client.map(asset, "test", 1001, sampling="smooth").array[::-1].astype(np.float64)


def depth(service: str, obj: bpy.types.Object) -> float:
    return client_of(service).bins(obj.rhytid.asset).depth


def errors(found: np.ndarray, texels: np.ndarray, scales: np.ndarray, every: int) -> np.ndarray:
    """Differences at every so many pixels from the middle, which is over a centre of a texel."""
    half = len(found) // 2
    offsets = np.arange(-(half // every) * every, half + 1, every)
    x, y = np.meshgrid(offsets / (PIXELS * scales[0]), offsets / (PIXELS * scales[1]))
    rendered = found[half - offsets][:, half + offsets]
    return rendered - bilinear(texels, MIDDLE + x, MIDDLE + y)


def bilinear(texels: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The map between its texels."""
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    v, u = y - i, x - j
    below = texels[i, j] * (1 - u) + texels[i, j + 1] * u
    above = texels[i + 1, j] * (1 - u) + texels[i + 1, j + 1] * u
    return below * (1 - v) + above * v


def camera(scene: bpy.types.Scene, scales: np.ndarray) -> None:
    x, y = (MIDDLE + 0.5) * TEXEL * scales[:2]
    look_down(scene, (float(x), float(y)), TEXEL / PIXELS, PIXELS * TEXELS + 1)


def test_vertices_are_as_high_as_their_texels(
    service: str, sheet: bpy.types.Object, blender: bpy.types.Scene, tmp_path: Path
) -> None:
    """Without subdivision the vertices alone are displaced, each by the texel that it stands on."""
    sheet.modifiers.clear()
    sheet.active_material.displacement_method = "DISPLACEMENT"
    camera(blender, np.ones(3))
    sheet.data.shape_keys.animation_data_clear()
    sheet.data.shape_keys.key_blocks["wide"].value = 0.0
    blender.frame_set(1)
    (found,) = render(blender, tmp_path, (1,))

    wrong = errors(found, expected(service, sheet, 1), np.ones(3), PIXELS)
    assert wrong.size == (TEXELS + 1) ** 2
    assert np.abs(wrong).max() <= 1e-4 * depth(service, sheet)


def test_frames_with_adaptive_subdivision(
    service: str, sheet: bpy.types.Object, blender: bpy.types.Scene, tmp_path: Path
) -> None:
    """As it is set up, everywhere between texels, in each frame of an animation."""
    blender.render.use_persistent_data = True
    drawn = []
    for frame in FRAMES:
        scales = 1 + share(frame) * (WIDE - 1)
        camera(blender, scales)
        (found,) = render(blender, tmp_path, (frame,))
        texels = expected(service, sheet, frame)
        wrong = np.abs(errors(found, texels, scales, 8))
        drawn.append(found)
        print(frame, wrong.max() / depth(service, sheet), found.std())  # noqa: T201
        assert wrong.max() <= 1e-4 * depth(service, sheet)
