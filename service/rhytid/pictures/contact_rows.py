"""The rows of a contact sheet: a face with its stretch, and the skin of one place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.colours import diverging, signed_grey
from rhytid.pictures.images import Picture, to_picture
from rhytid.pictures.legends import (
    axis_arrows,
    blank_strip,
    colour_bar,
    marked,
    scale_bar,
    wheel_legend,
)
from rhytid.pictures.places import Place
from rhytid.pictures.relief import relief
from rhytid.pictures.shade_mesh import View, shade_mesh
from rhytid.pictures.sheet import Panel
from rhytid.pictures.stretch_colours import Performance, axis_colours, stretch_bar, stretch_limit

SIZE = 380
METHODS = ("neutral", "redraw", "binned")
_MARKS = ((96, 20, 150), (190, 25, 30))


def face_row(frame: Performance, places: tuple[Place, Place], side: float) -> list[Panel]:
    """Neutral, deformed, both ratios, the first axis; squares of `side` mesh units mark places."""
    view = View.around(np.concatenate([frame.neutral, frame.deformed]))
    logs = frame.logs
    limit = stretch_limit(logs)
    first, second = (diverging(logs[:, axis], limit) for axis in (0, 1))

    def panel(title: str, x: NDArray[Any], strip: Picture, colours: Any = None) -> Panel:
        picture = shade_mesh(x, frame.faces, SIZE, view, colours)
        return Panel(title, stack(with_places(picture, x[frame.faces], places, view, side), strip))

    plain, bar = blank_strip(SIZE), stretch_bar(SIZE, limit)
    wheel = wheel_legend(SIZE, "direction in UV; grey: no axis")
    return [
        panel("neutral", frame.neutral, plain),
        panel("deformed", frame.deformed, plain),
        panel("stretch ratio, axis 1", frame.deformed, bar, first),
        panel("stretch ratio, axis 2", frame.deformed, bar, second),
        panel("principal axis 1", frame.deformed, wheel, axis_colours(frame, 0)),
    ]


def with_places(
    picture: Picture, corners: NDArray[Any], places: tuple[Place, Place], view: View, side: float
) -> Picture:
    """A picture of a mesh with a square of `side` mesh units around each place, A and B."""
    centres = [view.pixels(corners[place.triangle].mean(axis=0), SIZE) for place in places]
    width = SIZE / view.height * side
    boxes = zip(centres, "AB", _MARKS, strict=True)
    return marked(picture, [(centre, width, name, colour) for centre, name, colour in boxes])


def skin_row(
    name: str, place: Place, crops: Mapping[str, NDArray[Any]], side: float, unit_mm: float
) -> list[Panel]:
    """Relief by method, the heights of redraw, and how far binned is from it.

    crops: (SIZE, SIZE) heights by method, `side` mesh units wide.
    """
    ratios, angles = place.principal
    spacing = side / SIZE
    limit = max(float(np.percentile(np.abs(crops["redraw"]), 99.5)), 1e-30)
    pictures = {method: relief(crops[method], spacing) for method in METHODS}
    label = f"to {ratios[0]:.2f} along the arrows\nto {ratios[1]:.2f} across"
    pictures["neutral"] = scale_bar(pictures["neutral"], SIZE * 2 / (side * unit_mm), "2 mm")
    pictures["redraw"] = axis_arrows(pictures["redraw"], angles[0], ratios[0] > 1, label)
    raw = to_picture(signed_grey(crops["redraw"], limit))
    error = to_picture(diverging(crops["binned"] - crops["redraw"], limit))
    grey = _height_bar(limit * unit_mm, signed_grey)
    signed = _height_bar(limit * unit_mm, diverging)
    return [
        Panel(f"{name}: neutral", stack(pictures["neutral"], blank_strip(SIZE))),
        Panel(f"{name}: redraw", stack(pictures["redraw"], blank_strip(SIZE))),
        Panel(f"{name}: binned", stack(pictures["binned"], blank_strip(SIZE))),
        Panel(f"{name}: displacement of redraw", stack(raw, grey)),
        Panel(f"{name}: binned - redraw", stack(error, signed)),
    ]


def _height_bar(
    limit_mm: float, colours: Callable[[NDArray[np.float64], float], NDArray[np.float64]]
) -> Picture:
    ticks = [(t * limit_mm, f"{t * limit_mm:+.3f} mm" if t else "0") for t in (-1, 0, 1)]
    return colour_bar(SIZE, -limit_mm, limit_mm, lambda v: colours(v, limit_mm), ticks)


def stack(*pictures: Picture) -> Picture:
    """Pictures of one width, one below the other."""
    return np.concatenate(pictures, axis=0)
