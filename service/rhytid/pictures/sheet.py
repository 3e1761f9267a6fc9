"""Titled panels in rows on one white sheet, and what is drawn beside and into them: colour bars,
the wheel of axes, scale bars, arrows, squares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rhytid.pictures.images import BACKGROUND, Picture, axis_wheel, downsample, to_picture

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
ColourMap = Callable[[NDArray[np.float64]], NDArray[np.float64]]
MARGIN, GAP, TITLE = 28, 18, 26
_CAPTION_LINE = 24
_TITLE_SIZE, _CAPTION_SIZE = 16, 17
INK = (32, 32, 36)
STRIP = 40
_GLOW = (255, 255, 255)
# Pixels of a patch's side, of the strip with its value, and between patches of a control.
PATCH, _STRIP, _BETWEEN = 220, 22, 4
_LABEL_SIZE = 14
# Controls beside each other.
ACROSS = 3


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture (H, W, 3) uint8, and the line of text above it."""

    title: str
    image: Picture


def sheet(rows: list[list[Panel]], caption: str) -> Image.Image:
    """A sheet of rows of panels, aligned at the top left, with the caption wrapped below."""
    width = max(_row_width(row) for row in rows) + 2 * MARGIN
    lines = _wrapped(caption, width - 2 * MARGIN)
    height = 2 * MARGIN + sum(_row_height(row) + GAP for row in rows) + _CAPTION_LINE * len(lines)
    page = Image.new("RGB", (width, height), "white")
    y = MARGIN
    for row in rows:
        _draw_row(page, row, y)
        y += _row_height(row) + GAP
    draw = ImageDraw.Draw(page)
    for number, line in enumerate(lines):
        draw.text((MARGIN, y + number * _CAPTION_LINE), line, fill=INK, font=font(_CAPTION_SIZE))
    return page


def _draw_row(page: Image.Image, row: list[Panel], y: int) -> None:
    draw = ImageDraw.Draw(page)
    x = MARGIN
    for panel in row:
        middle = (x + panel.image.shape[1] / 2, y + TITLE / 2 - 2)
        draw.text(middle, panel.title, fill=INK, font=font(_TITLE_SIZE), anchor="mm")
        page.paste(Image.fromarray(np.ascontiguousarray(panel.image)), (x, y + TITLE))
        x += panel.image.shape[1] + GAP


def _row_width(row: list[Panel]) -> int:
    return sum(int(panel.image.shape[1]) for panel in row) + GAP * (len(row) - 1)


def _row_height(row: list[Panel]) -> int:
    return TITLE + max(int(panel.image.shape[0]) for panel in row)


def _wrapped(text: str, width: int) -> list[str]:
    """Lines that fit `width` pixels; a line break in the text stays one."""
    lines: list[str] = []
    for paragraph in text.split("\n") if text else []:
        line = ""
        for word in paragraph.split():
            longer = f"{line} {word}".strip()
            if line and font(_CAPTION_SIZE).getlength(longer) > width:
                lines.append(line)
                longer = word
            line = longer
        lines.append(line)
    return lines


@dataclass(frozen=True, eq=False)
class LabelledPatch:
    """A patch of skin (PATCH, PATCH, 3) uint8, and the value that it shows, as its label."""

    label: str
    picture: Picture


def control_sheet(shown: Mapping[str, Sequence[LabelledPatch]], caption: str) -> Image.Image:
    """A sheet with a panel for each control, which holds its patches side by side; ACROSS panels a
    row."""
    panels = [Panel(name, _beside(patches)) for name, patches in shown.items()]
    rows = [panels[start : start + ACROSS] for start in range(0, len(panels), ACROSS)]
    return sheet(rows, caption)


def _beside(patches: Sequence[LabelledPatch]) -> Picture:
    gap = np.full((PATCH + _STRIP, _BETWEEN, 3), 255, np.uint8)
    parts = [part for patch in patches for part in (gap, _labelled(patch))]
    return np.concatenate(parts[1:], axis=1)


def _labelled(patch: LabelledPatch) -> Picture:
    """The patch with its label below."""
    image = Image.new("RGB", (PATCH, PATCH + _STRIP), "white")
    image.paste(Image.fromarray(np.ascontiguousarray(patch.picture)), (0, 0))
    middle = (PATCH / 2, PATCH + _STRIP / 2)
    draw = ImageDraw.Draw(image)
    draw.text(middle, patch.label, fill=INK, font=font(_LABEL_SIZE), anchor="mm")
    return np.asarray(image)


@lru_cache
def font(size: float) -> Font:
    """Pillow's own font at a size in pixels; it has ASCII and Latin letters only."""
    return ImageFont.load_default(size)


def colour_bar(
    width: int, low: float, high: float, colours: ColourMap, ticks: Sequence[tuple[float, str]]
) -> Picture:
    """A strip (STRIP, width, 3): a horizontal bar from `low` to `high`, ticks labelled below."""
    bar = round(width * 0.7)
    values = np.linspace(low, high, bar)
    image = Image.new("RGB", (width, STRIP), "white")
    start = (width - bar) // 2
    ramp = to_picture(np.repeat(colours(values)[None], 12, axis=0))
    image.paste(Image.fromarray(ramp), (start, 4))
    draw = ImageDraw.Draw(image)
    for value, label in ticks:
        x = start + (value - low) / (high - low) * (bar - 1)
        draw.line([(x, 16), (x, 19)], fill=INK)
        draw.text((x, 20), label, fill=INK, font=font(13), anchor="ma")
    return np.asarray(image)


def wheel_legend(width: int, label: str) -> Picture:
    """A strip (STRIP, width, 3): the colour wheel of undirected axes, with a label beside it."""
    size = STRIP - 4
    grid = (np.arange(4 * size) + 0.5) / (2 * size) - 1
    x, y = np.meshgrid(grid, -grid)
    disc = (np.hypot(x, y) <= 1) & (np.hypot(x, y) > 0.35)
    colour = np.where(disc[..., None], axis_wheel(np.arctan2(y, x)), BACKGROUND)
    image = Image.new("RGB", (width, STRIP), "white")
    draw = ImageDraw.Draw(image)
    start = round(width - size - 8 - draw.textlength(label, font=font(13))) // 2
    image.paste(Image.fromarray(to_picture(downsample(colour, 4))), (start, 2))
    draw.text((start + size + 8, STRIP / 2), label, fill=INK, font=font(13), anchor="lm")
    return np.asarray(image)


def blank_strip(width: int, label: str = "") -> Picture:
    """A strip (STRIP, width, 3) with centred text, in place of a legend."""
    image = Image.new("RGB", (width, STRIP), "white")
    ImageDraw.Draw(image).text((width / 2, 8), label, fill=INK, font=font(13), anchor="ma")
    return np.asarray(image)


def scale_bar(picture: Picture, length: float, label: str) -> Picture:
    """The picture with a bar of `length` pixels and its label at the lower left."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    y = image.height - 14
    draw.rectangle([12, y - 3, 16 + length, y + 3], fill=_GLOW)
    draw.rectangle([14, y - 1, 14 + length, y + 1], fill=INK)
    _text(draw, (20 + length, y), label, "lm")
    return np.asarray(image)


def axis_arrows(picture: Picture, angle: float, outward: bool, label: str) -> Picture:
    """The picture with two opposed arrows through its corner along an axis, and a label.

    angle: of the axis in radians, y up.  outward: apart (stretch), else together (compression).
    """
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    along = np.array([math.cos(angle), -math.sin(angle)])
    centre = np.array([image.width - 44.0, 44.0])
    draw.circle(tuple(centre), 38, fill=_GLOW)
    for side in (1.0, -1.0):
        ends = (centre + side * 6 * along, centre + side * 32 * along)
        tail, head = ends if outward else ends[::-1]
        _arrow(draw, tail, head)
    _text(draw, (10, 10), label, "la")
    return np.asarray(image)


def marked(
    picture: Picture, boxes: Sequence[tuple[NDArray[Any], float, str, tuple[int, int, int]]]
) -> Picture:
    """The picture with squares: for each its centre in pixels, side, name and colour."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    for centre, side, name, colour in boxes:
        x, y = (float(v) for v in centre)
        box = [x - side / 2, y - side / 2, x + side / 2, y + side / 2]
        draw.rectangle(box, outline=colour, width=3)
        _text(draw, (box[2] + 5, box[1] - 2), name, "lm", colour)
    return np.asarray(image)


def _arrow(draw: ImageDraw.ImageDraw, tail: NDArray[Any], head: NDArray[Any]) -> None:
    along = (head - tail) / np.linalg.norm(head - tail)
    across = np.array([-along[1], along[0]])
    for width, fill, grow in ((7, _GLOW, 2.5), (3, INK, 0.0)):
        neck = head - (11 - grow) * along
        tip = head + grow * along
        sides = [neck + side * (6 + grow) * across for side in (1, -1)]
        draw.line([tuple(tail - grow * along), tuple(neck)], fill=fill, width=width)
        draw.polygon([tuple(tip), *(tuple(s - grow * along) for s in sides)], fill=fill)


def _text(
    draw: ImageDraw.ImageDraw,
    place: tuple[float, float],
    text: str,
    anchor: str,
    fill: tuple[int, int, int] = INK,
) -> None:
    """Text in ink on a white plate, legible on any ground."""
    box = draw.multiline_textbbox(place, text, font=font(15), anchor=anchor)
    draw.rounded_rectangle([box[0] - 5, box[1] - 3, box[2] + 5, box[3] + 4], 4, fill=_GLOW)
    draw.multiline_text(place, text, fill=fill, font=font(15), anchor=anchor)
