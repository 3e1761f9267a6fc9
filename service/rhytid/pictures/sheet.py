"""Titled panels in rows on one white sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from rhytid.pictures.images import Picture
from rhytid.pictures.legends import INK, font

MARGIN, GAP, TITLE = 28, 18, 26
_CAPTION_LINE = 24
_TITLE_SIZE, _CAPTION_SIZE = 16, 17


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture (H, W, 3) uint8 and the line above it."""

    title: str
    image: Picture


def sheet(rows: list[list[Panel]], caption: str) -> Image.Image:
    """Rows of panels, aligned at the top left, the caption wrapped below."""
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
