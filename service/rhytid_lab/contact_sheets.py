"""The contact sheet of one frame: a face, its stretch, and its skin at two patches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.errors import InputError
from rhytid.pictures.flat_patches import FlatPatch, most_stretched_patches
from rhytid.pictures.images import Picture, axis_wheel, diverging, signed_grey, to_picture
from rhytid.pictures.raster import View, shade_mesh, vertex_normals
from rhytid.pictures.sheet import (
    Panel,
    axis_arrows,
    blank_strip,
    colour_bar,
    marked,
    scale_bar,
    sheet,
    wheel_legend,
)
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch
from rhytid_client import Method

SIZE = 380
METHODS: tuple[Method, ...] = ("neutral", "redraw", "binned")
_MARKS = ((96, 20, 150), (190, 25, 30))
# Light over the surface, degrees.
STEEP, GRAZING = 45.0, 15.0
# Sides of a crop that a view of the face with its displacement is wide.
_AROUND = 2.0


@dataclass(frozen=True, eq=False)
class Performance:
    """One frame of a face as plain arrays.

    neutral, deformed: (V, 3).  faces: (F, 3).  triangle_uv: (F, 3, 2), local to the UDIM of the
    maps.  axes: (F, 2, 2), axes[f, i] = ŝᵢ in UV.  ratios: (F, 2).
    """

    neutral: NDArray[Any]
    deformed: NDArray[Any]
    faces: NDArray[Any]
    triangle_uv: NDArray[Any]
    axes: NDArray[Any]
    ratios: NDArray[Any]

    @property
    def logs(self) -> NDArray[np.float64]:
        """(F, 2) log stretch; a collapsed triangle has a large negative number."""
        logs: NDArray[np.float64] = np.log(np.maximum(self.ratios, 1e-6))
        return logs


def axis_colours(frame: Performance, axis: int) -> NDArray[np.float64]:
    """(F, 3); fades to grey where the two ratios are the same within a few per cent."""
    along, logs = frame.axes[:, axis], frame.logs
    return axis_wheel(np.arctan2(along[:, 1], along[:, 0]), np.abs(logs[:, 0] - logs[:, 1]) / 0.06)


def stretch_limit(logs: NDArray[np.float64]) -> float:
    """The end of the colour scale: nearly all of this frame, slivers left out."""
    return float(np.clip(np.percentile(np.abs(logs), 99), 0.05, 0.7))


def stretch_bar(width: int, limit: float) -> Picture:
    """A strip (STRIP, width, 3) with the ratios from exp(-limit) to exp(limit)."""
    ticks = [(t * limit, f"{np.exp(t * limit):.2f}" if t else "1") for t in (-1, -0.5, 0, 0.5, 1)]
    return colour_bar(width, -limit, limit, lambda v: diverging(v, limit), ticks)


def contact_sheet(
    frame: Performance,
    displacement: Mapping[str, NDArray[Any]],
    crop_mm: float = 12.0,
    unit_mm: float = 10.0,
    note: str = "",
) -> Image.Image:
    """One sheet: the face and its stretch above, the skin of two patches below.

    displacement: (R, R) mesh units, row 0 at the top, by method: neutral, redraw, binned.
    crop_mm: side of a crop on the surface.  unit_mm: millimetres a mesh unit.  note: added to
    the caption.  Raises InputError for maps that do not belong together, MeshError where no
    patch of the size of a crop fits.
    """
    _check(displacement)
    side = crop_mm / unit_mm
    corners = np.asarray(frame.neutral)[frame.faces]
    patches = most_stretched_patches(corners, frame.triangle_uv, frame.axes, frame.ratios, side / 2)
    rows = [_face_row(frame, patches, side)]
    crops: list[dict[str, NDArray[Any]]] = []
    for name, patch in zip("AB", patches, strict=True):
        views = patch_views(frame, patch, side)
        crops.append({m: views[m].heights(displacement[m]) for m in METHODS})
        rows.append(_skin_row(name, patch, views, displacement, side, unit_mm))
        rows.append(_grazing_row(name, views, displacement, side, unit_mm))
    return sheet(rows, _caption(displacement, crops, crop_mm, note))


def relative_rms(values: NDArray[Any], reference: NDArray[Any]) -> float:
    """Rms of the difference over the rms of the reference; 0 where both are zero everywhere."""
    difference = float(np.sqrt(np.mean((values - reference) ** 2, dtype=np.float64)))
    scale = float(np.sqrt(np.mean(np.square(reference), dtype=np.float64)))
    return difference / scale if scale else (np.inf if difference else 0.0)


def _check(displacement: Mapping[str, NDArray[Any]]) -> None:
    for method in METHODS:
        if method not in displacement:
            raise InputError(f"displacement has no {method!r}")
        shape = np.shape(displacement[method])
        if len(shape) != 2 or shape[0] != shape[1] or shape != np.shape(displacement["neutral"]):
            raise InputError(f"displacement {method!r} has shape {shape}: three equal squares")


def _caption(
    displacement: Mapping[str, NDArray[Any]],
    crops: list[dict[str, NDArray[Any]]],
    crop_mm: float,
    note: str,
) -> str:
    whole = relative_rms(displacement["binned"], displacement["redraw"])
    a, b = (relative_rms(crop["binned"], crop["redraw"]) for crop in crops)
    resolution = len(displacement["redraw"])
    text = (
        f"A: the most stretched patch, B: the most compressed one, each {crop_mm:g} mm wide on the "
        "surface it is shown on (neutral: undeformed; the others: deformed, so stretched skin "
        "shows less of the map), seen along the normal at its middle. Heights are true to scale, "
        "read through a cubic B-spline; light from the upper left, on faces weaker from the right. "
        f"Rms of binned - redraw over rms of redraw: {100 * whole:.1f} % of the whole map "
        f"({resolution} x {resolution} texels), {100 * a:.1f} % in A, {100 * b:.1f} % in B."
    )
    return f"{text}\n{note}" if note else text


def _face_row(frame: Performance, patches: tuple[FlatPatch, FlatPatch], side: float) -> list[Panel]:
    """Neutral, deformed, both ratios, the first axis; squares of `side` mesh units mark patches."""
    view = View.around(np.concatenate([frame.neutral, frame.deformed]))
    logs = frame.logs
    limit = stretch_limit(logs)
    first, second = (diverging(logs[:, axis], limit) for axis in (0, 1))

    def panel(title: str, x: NDArray[Any], strip: Picture, colours: Any = None) -> Panel:
        picture = shade_mesh(x, frame.faces, SIZE, view, colours)
        return Panel(
            title, stack(with_patches(picture, x[frame.faces], patches, view, side), strip)
        )

    plain, bar = blank_strip(SIZE), stretch_bar(SIZE, limit)
    wheel = wheel_legend(SIZE, "direction in UV; grey: no axis")
    return [
        panel("neutral", frame.neutral, plain),
        panel("deformed", frame.deformed, plain),
        panel("stretch ratio, axis 1", frame.deformed, bar, first),
        panel("stretch ratio, axis 2", frame.deformed, bar, second),
        panel("principal axis 1", frame.deformed, wheel, axis_colours(frame, 0)),
    ]


def with_patches(
    picture: Picture,
    corners: NDArray[Any],
    patches: tuple[FlatPatch, FlatPatch],
    view: View,
    side: float,
) -> Picture:
    """A picture of a mesh with a square of `side` mesh units around each patch, A and B."""
    centres = [view.pixels(corners[patch.triangle].mean(axis=0), SIZE) for patch in patches]
    width = SIZE / view.height * side
    boxes = zip(centres, "AB", _MARKS, strict=True)
    return marked(picture, [(centre, width, name, colour) for centre, name, colour in boxes])


def stack(*pictures: Picture) -> Picture:
    """Pictures of one width, one below the other."""
    return np.concatenate(pictures, axis=0)


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


def _skin_row(
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


def _grazing_row(
    name: str,
    views: Mapping[str, SurfacePatch],
    maps: Mapping[str, NDArray[Any]],
    side: float,
    unit_mm: float,
) -> list[Panel]:
    """Relief by method at grazing light, and the deformed face with its displacement by both.

    views, maps, side, unit_mm: as of `_skin_row`.
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
