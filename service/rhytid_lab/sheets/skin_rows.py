"""The rows of a contact sheet that show the skin of one patch, on its surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.flat_patches import FlatPatch
from rhytid.pictures.images import Picture, diverging, signed_grey, to_picture
from rhytid.pictures.raster import vertex_normals
from rhytid.pictures.sheet import Panel, axis_arrows, blank_strip, colour_bar, scale_bar
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch
from rhytid_lab.sheets.contact_rows import METHODS, SIZE, stack
from rhytid_lab.sheets.stretch_colours import Performance

# Light over the surface, degrees.
STEEP, GRAZING = 45.0, 15.0
# Sides of a crop that a view of the face with its displacement is wide.
_AROUND = 2.0


def patch_views(frame: Performance, patch: FlatPatch, side: float) -> dict[str, SurfacePatch]:
    """The patch by method, and `face`: the deformed face around it.

    Neutral skin is seen on the neutral surface, the others on the deformed one, from a frame that
    turned with the skin.
    """
    neutral, deformed = (np.asarray(x)[frame.faces] for x in (frame.neutral, frame.deformed))
    before, after = (corners[patch.triangle] for corners in (neutral, deformed))
    rest = Frame.of(before)
    moved = rest.carried(before, after)
    normals = vertex_normals(frame.deformed, frame.faces)[frame.faces]
    skin = surface_patch(deformed, frame.triangle_uv, moved, side, SIZE)
    return {
        "neutral": surface_patch(neutral, frame.triangle_uv, rest, side, SIZE),
        "redraw": skin,
        "binned": skin,
        "face": surface_patch(deformed, frame.triangle_uv, moved, _AROUND * side, SIZE, normals),
    }


def skin_row(
    name: str,
    patch: FlatPatch,
    views: Mapping[str, SurfacePatch],
    maps: Mapping[str, NDArray[Any]],
    side: float,
    unit_mm: float,
) -> list[Panel]:
    """Relief by method at 45°, the heights of redraw, and how far binned is from it.

    views: of `patch_views`, `side` mesh units wide.  maps: (R, R) displacement by method.
    """
    ratios, angles = patch.principal
    crops = {method: views[method].heights(maps[method]) for method in METHODS}
    limit = max(float(np.percentile(np.abs(crops["redraw"]), 99.5)), 1e-30)
    pictures = {method: views[method].picture(maps[method], STEEP) for method in METHODS}
    label = f"to {ratios[0]:.2f} along the arrows\nto {ratios[1]:.2f} across"
    pictures["neutral"] = scale_bar(pictures["neutral"], SIZE * 2 / (side * unit_mm), "2 mm")
    pictures["redraw"] = axis_arrows(pictures["redraw"], angles[0], ratios[0] > 1, label)
    raw = to_picture(signed_grey(crops["redraw"], limit))
    error = to_picture(diverging(crops["binned"] - crops["redraw"], limit))
    grey = _height_bar(limit * unit_mm, signed_grey)
    signed = _height_bar(limit * unit_mm, diverging)
    shown = [Panel(f"{name}: {m}", stack(pictures[m], blank_strip(SIZE))) for m in METHODS]
    return [
        *shown,
        Panel(f"{name}: displacement of redraw", stack(raw, grey)),
        Panel(f"{name}: binned - redraw", stack(error, signed)),
    ]


def grazing_row(
    name: str,
    views: Mapping[str, SurfacePatch],
    maps: Mapping[str, NDArray[Any]],
    side: float,
    unit_mm: float,
) -> list[Panel]:
    """Relief by method at grazing light, and the deformed face with its displacement by both.

    As `skin_row`.
    """

    def panel(title: str, picture: Picture) -> Panel:
        return Panel(title, stack(picture, blank_strip(SIZE)))

    row = [
        panel(f"{name}: {m}, light at {GRAZING:g}°", views[m].picture(maps[m], GRAZING))
        for m in METHODS
    ]
    bar = 5 * SIZE / (_AROUND * side * unit_mm)
    for light in (STEEP, GRAZING):
        face = views["face"].picture(maps["redraw"], light, form=True)
        title = f"{name}: face with its displacement, {light:g}°"
        row.append(panel(title, scale_bar(face, bar, "5 mm")))
    return row


def _height_bar(
    limit_mm: float, colours: Callable[[NDArray[np.float64], float], NDArray[np.float64]]
) -> Picture:
    ticks = [(t * limit_mm, f"{t * limit_mm:+.3f} mm" if t else "0") for t in (-1, 0, 1)]
    return colour_bar(SIZE, -limit_mm, limit_mm, lambda v: colours(v, limit_mm), ticks)
