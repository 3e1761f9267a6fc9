"""The first row of a contact sheet: a face and its stretch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.pictures.flat_patches import FlatPatch
from rhytid.pictures.images import Picture, diverging
from rhytid.pictures.raster import View, shade_mesh
from rhytid.pictures.sheet import Panel, blank_strip, marked, wheel_legend
from rhytid_client import Method
from rhytid_lab.sheets.stretch_colours import Performance, axis_colours, stretch_bar, stretch_limit

SIZE = 380
METHODS: tuple[Method, ...] = ("neutral", "redraw", "binned")
_MARKS = ((96, 20, 150), (190, 25, 30))


def face_row(frame: Performance, patches: tuple[FlatPatch, FlatPatch], side: float) -> list[Panel]:
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
