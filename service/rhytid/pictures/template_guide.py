"""A sheet that explains the templates of a mesh, with their legends."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from PIL import Image

from rhytid.pictures.colours import diverging
from rhytid.pictures.images import Picture
from rhytid.pictures.legends import INK, blank_strip, colour_bar, wheel_legend
from rhytid.pictures.sheet import Panel, sheet
from rhytid.pictures.uv_template import TEXEL_RANGE, Charts, filled, template

SIDE = 620
MOST_UDIMS = 6


def guide(charts: Mapping[int, Charts], usual: float, unit_mm: float, caption: str) -> Image.Image:
    """Rows of UDIMs (MOST_UDIMS at most): the template, which way level lines run, and texels.

    usual: side of a texel on the surface, mesh units.  unit_mm: millimetres in a mesh unit.
    """
    rows = [_row(udim, of, usual) for udim, of in list(charts.items())[:MOST_UDIMS]]
    level = "level lines run this way in UV; grey: level ground"
    legends = (
        blank_strip(SIDE, "arrows point up, their feet to the right; orange: ends of charts"),
        wheel_legend(SIDE, level),
        _texel_bar(usual * unit_mm),
    )
    return sheet([*rows, [Panel("", legend) for legend in legends]], caption)


def _row(udim: int, charts: Charts, usual: float) -> list[Panel]:
    lines = template(charts, SIDE)
    grounds = {
        f"UDIM {udim}": Image.new("RGB", lines.size, "white"),
        "orientation": filled(charts, charts.orientation_colours(), SIDE),
        "side of a texel": filled(charts, charts.texel_colours(usual), SIDE),
    }
    panels = []
    for title, ground in grounds.items():
        if title == f"UDIM {udim}":
            ground.paste(lines, mask=lines)
        panels.append(Panel(title, _framed(ground)))
    return panels


def _framed(image: Image.Image) -> Picture:
    framed = np.array(image)
    framed[[0, -1]], framed[:, [0, -1]] = INK, INK
    return framed


def _texel_bar(usual_mm: float) -> Picture:
    end = math.log(TEXEL_RANGE)
    steps = (1 / TEXEL_RANGE, 0.5, 1.0, 2.0, TEXEL_RANGE)
    ticks = [(math.log(step), f"{step * usual_mm:.3g} mm") for step in steps]
    return colour_bar(SIDE, -end, end, lambda values: diverging(values, end), ticks)
