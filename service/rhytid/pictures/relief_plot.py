"""A plot of patches of skin that were measured: heights, slopes and correlation lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rhytid.pictures.images import Picture, to_picture
from rhytid.pictures.sheet import INK, Panel, font, scale_bar, sheet

FloatArray = NDArray[np.float64]
# Pixels of a panel, and of its margin where numbers stand.
SIZE, _RIM = 400, 46
_COLOURS = ((40, 90, 170), (190, 60, 40))
_GREY = (205, 205, 205)
# Share of heights, per cent, that lies beyond black and beyond white.
_CLIPPED = 0.2
# Shares of the area, per cent, at the bottom and at the top of a histogram.
_LEAST, _MOST = 0.01, 100.0


@dataclass(frozen=True, eq=False)
class Shown:
    """A patch in one state.

    label: of the state.  heights: (P, P) micrometres.  along, across: (B,) shares of the area by
    slope.  lengths: (A,) correlation lengths by direction, mm.
    """

    label: str
    heights: FloatArray
    along: FloatArray
    across: FloatArray
    lengths: FloatArray


@dataclass(frozen=True, eq=False)
class ShownPatch:
    """A patch of `side` mm: at rest, and in another state if there is one."""

    name: str
    side: float
    states: tuple[Shown, ...]


def relief_plot(
    patches: Sequence[ShownPatch], edges: FloatArray, angles: FloatArray, caption: str
) -> Image.Image:
    """A sheet with a row for each patch.

    edges: (B + 1,) of the histograms, degrees.  angles: (A,) of the correlation lengths, degrees
    from 0 to below 180.
    """
    return sheet([_row(patch, edges, angles) for patch in patches], caption)


def _row(patch: ShownPatch, edges: FloatArray, angles: FloatArray) -> list[Panel]:
    low, high = np.percentile(patch.states[0].heights, [_CLIPPED, 100.0 - _CLIPPED])
    found = []
    for state in patch.states:
        grey = ((state.heights - low) / max(high - low, 1e-12)).clip(0.0, 1.0)
        picture = to_picture(np.repeat(grey[..., None], 3, axis=-1))
        # In words, for the font lacks µ.
        heights = f"1 mm, {low:.0f} to {high:.0f} micrometres"
        barred = scale_bar(picture, len(grey) / patch.side, heights)
        found.append(Panel(f"{patch.name}: {state.label}", barred))
    labels = [state.label for state in patch.states]
    for name in ("along", "across"):
        shares = [getattr(state, name) for state in patch.states]
        found.append(Panel(f"slopes {name}, % by degrees", _histogram(shares, labels, edges)))
    lengths = [state.lengths for state in patch.states]
    return [*found, Panel("correlation length, mm", _polar(lengths, angles))]


def _histogram(shares: Sequence[FloatArray], labels: Sequence[str], edges: FloatArray) -> Picture:
    """Steps of shares on a logarithmic axis."""
    image = Image.new("RGB", (SIZE, SIZE), "white")
    draw = ImageDraw.Draw(image)

    def place(degrees: Any, share: Any) -> FloatArray:
        x = (degrees - edges[0]) / (edges[-1] - edges[0])
        y = np.log(np.maximum(100.0 * share, _LEAST) / _LEAST) / np.log(_MOST / _LEAST)
        across = SIZE - 2 * _RIM
        found: FloatArray = np.stack([_RIM + x * across, SIZE - _RIM - y * across], axis=-1)
        return found

    for per_cent in (0.01, 0.1, 1.0, 10.0, 100.0):
        ends = place(edges[[0, -1]], np.full(2, per_cent / 100.0))
        draw.line([tuple(end) for end in ends], fill=_GREY)
        draw.text(tuple(ends[0] - (6, 0)), f"{per_cent:g}", INK, font(13), "rm")
    for degrees in np.arange(-40.0, 41.0, 20.0):
        ends = place(np.full(2, degrees), np.array([_LEAST, _MOST]) / 100.0)
        draw.line([tuple(end) for end in ends], fill=_GREY)
        draw.text(tuple(ends[0] + (0, 6)), f"{degrees:g}", INK, font(13), "ma")
    for number, (share, label) in enumerate(zip(shares, labels, strict=True)):
        line = place(np.repeat(edges, 2)[1:-1], np.repeat(share, 2))
        draw.line([tuple(point) for point in line], fill=_COLOURS[number], width=2)
        draw.text((_RIM + 6, 8 + 18 * number), label, _COLOURS[number], font(14), "la")
    return np.asarray(image)


def _polar(lengths: Sequence[FloatArray], angles: FloatArray) -> Picture:
    """Lengths by direction around the middle; along points to the right."""
    image = Image.new("RGB", (SIZE, SIZE), "white")
    draw = ImageDraw.Draw(image)
    middle, most = SIZE / 2, max(float(one.max()) for one in lengths)
    scale = (middle - _RIM) / max(most, 1e-12)
    for share in (0.5, 1.0):
        reach = share * most * scale
        draw.circle((middle, middle), reach, outline=_GREY)
        draw.text((middle + 4, middle - reach), f"{share * most:.2g}", INK, font(13), "lb")
    draw.line([(_RIM, middle), (SIZE - _RIM, middle)], fill=_GREY)
    draw.text((SIZE - _RIM + 4, middle), "along", INK, font(13), "lm")
    turn = np.radians(np.concatenate([angles, angles + 180.0]))
    for number, one in enumerate(lengths):
        both = np.concatenate([one, one]) * scale
        x, y = middle + both * np.cos(turn), middle - both * np.sin(turn)
        around = [*zip(x.tolist(), y.tolist(), strict=True)]
        draw.line([*around, around[0]], fill=_COLOURS[number], width=2)
    return np.asarray(image)
