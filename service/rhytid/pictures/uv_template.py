"""Templates to paint over: the charts of a UDIM, which way is up, and the size of texels; and a
sheet that explains them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.pictures.images import Picture, axis_wheel, diverging, to_picture
from rhytid.pictures.raster import rasterize_uv
from rhytid.pictures.sheet import INK, Panel, blank_strip, colour_bar, sheet, wheel_legend

Floats = NDArray[np.float64]
# Texels are coloured from a fourth of the usual side to four times as much.
TEXEL_RANGE = 4.0
# Arrows per side of a UDIM, and pixels per side for which lines are one wide.
_ARROWS, _FINE_LINES = 28, 2048
# Above it lines are not drawn twice as large first: it would take more than 256 MiB.
_SMOOTHED = 8192
_WIRE, _BORDER, _ARROW = (70, 74, 82, 150), (214, 84, 20, 255), (20, 90, 200, 255)
# Least length that the upward direction has within the surface; with less the ground is level.
_LEVEL = 0.25
# Pixels per side of a panel of the guide, and UDIMs that it shows at most.
SIDE, MOST_UDIMS = 620, 6


@dataclass(frozen=True, eq=False)
class Charts:
    """The usable triangles of a UDIM, K of them.

    uv: (K, 3, 2) local to the UDIM.  texels: (K,) sides of texels on the surface, mesh units.  up,
    right: (K, 2) unit vectors in UV of up (+y) and right on the surface, seen from outside; 0 where
    the surface is level.  wire: (E, 2, 2) all edges.  border: (E, 2, 2) edges of one triangle
    alone.
    """

    uv: Floats
    texels: Floats
    up: Floats
    right: Floats
    wire: Floats
    border: Floats

    @classmethod
    def of(cls, mesh: Mesh, udim: int, size: int) -> Charts:
        """The charts of the triangles that reach into a UDIM, which is drawn at `size` texels per
        side."""
        local = mesh.triangle_uv() - udim_origin(udim)
        near = (local.max(axis=1) > 0).all(axis=1) & (local.min(axis=1) < 1).all(axis=1)
        near &= mesh.usable_triangles()
        uv, corners = local[near], mesh.positions[mesh.faces[near]].astype(np.float64)
        edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
        edges_uv = np.swapaxes(uv[:, 1:] - uv[:, :1], 1, 2)
        area = np.linalg.norm(np.cross(edges[..., 0], edges[..., 1]), axis=1)
        up, right = _upright(edges, edges_uv)
        texels = np.sqrt(area / np.abs(np.linalg.det(edges_uv))) / size
        return cls(uv, texels, up, right, *_edges(uv, corners))

    @property
    def usual(self) -> float:
        """The median side of a texel by triangles, mesh units."""
        return float(np.median(self.texels))

    def texel_colours(self, usual: float) -> Floats:
        """(K, 3) colours: red where texels are smaller than usual, purple where they are larger."""
        return diverging(np.log(self.texels / usual), math.log(TEXEL_RANGE))

    def orientation_colours(self) -> Floats:
        """(K, 3) colours by the direction that level lines have in UV; grey where there is none."""
        known = np.linalg.norm(self.right, axis=1)
        return axis_wheel(np.arctan2(self.right[:, 1], self.right[:, 0]), known)


def template(charts: Charts, size: int) -> Image.Image:
    """An RGBA image (size, size) to lay over a map: wires, borders of charts in orange, and arrows
    that point up on the surface, with a foot to the right; transparent elsewhere."""
    image = Image.new("RGBA", (size, size))
    wide = max(1, round(size / _FINE_LINES))
    for lines, colour, width in (
        (charts.wire, _WIRE, wide),
        (charts.border, _BORDER, 3 * wide),
        (_arrows(charts), _ARROW, 2 * wide),
    ):
        ink = Image.new("RGBA", (size, size), colour)
        mask = _strokes(lines, size, width).point(
            [value * colour[3] // 255 for value in range(256)]
        )
        ink.putalpha(mask)
        image = Image.alpha_composite(image, ink)
    return image


def filled(charts: Charts, colours: Floats, size: int) -> Image.Image:
    """An RGB image (size, size) with each triangle in its colour of (K, 3), white around them."""
    image = Image.new("RGB", (size, size), "white")
    draw = ImageDraw.Draw(image)
    inks = to_picture(colours[None])[0].tolist()
    for corners, ink in zip(_pixels(charts.uv, size).tolist(), inks, strict=True):
        draw.polygon([tuple(corner) for corner in corners], fill=tuple(ink))
    return image


def starter(value: float, size: int) -> Image.Image:
    """A grey image of 16 bits (size, size), everywhere `value` of white."""
    return Image.fromarray(np.full((size, size), np.rint(value * 65535), np.uint16))


def guide(charts: Mapping[int, Charts], usual: float, unit_mm: float, caption: str) -> Image.Image:
    """A sheet with a row for each UDIM (MOST_UDIMS at most): the template, the direction of level
    lines, and the size of texels.

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


def _upright(edges: Floats, edges_uv: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (K, 2) in UV of up and of right."""
    to_uv = edges_uv @ np.linalg.pinv(edges)
    normal = np.cross(edges[..., 0], edges[..., 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    up = np.array([0.0, 1.0, 0.0]) - normal[:, 1:2] * normal
    steep = np.linalg.norm(up, axis=1)[:, None] > _LEVEL
    found = (np.einsum("kuc,kc->ku", to_uv, axis) for axis in (up, np.cross(up, normal)))
    units = (v / np.maximum(np.linalg.norm(v, axis=1)[:, None], 1e-30) for v in found)
    first, second = (np.where(steep, unit, 0.0) for unit in units)
    return first, second


def _edges(uv: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """All edges (E, 2, 2) in UV, and those of one triangle alone: there a chart ends."""
    places = np.concatenate([corners, uv], axis=2).reshape(-1, 5)
    _, label = np.unique(places + 0.0, axis=0, return_inverse=True)
    label = label.reshape(-1, 3)
    ends = np.sort(np.stack([label, np.roll(label, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    pairs = np.stack([uv, np.roll(uv, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    _, first, count = np.unique(ends, axis=0, return_index=True, return_counts=True)
    return pairs[first], pairs[first[count == 1]]


def _arrows(charts: Charts) -> Floats:
    """(E, 2, 2) strokes of the arrows, one in each square of a grid with a triangle in its middle;
    where the surface is level, none."""
    seen = rasterize_uv(charts.uv, _ARROWS)
    row, column = np.nonzero(seen.covered)
    triangle = seen.triangle[row, column]
    middle = np.stack([(column + 0.5) / _ARROWS, 1.0 - (row + 0.5) / _ARROWS], axis=1)
    up, right = (0.36 / _ARROWS * way[triangle] for way in (charts.up, charts.right))
    across = np.stack([-up[:, 1], up[:, 0]], axis=1)
    tail, tip = middle - up, middle + up
    strokes = [(tail, tip), (tail, tail + 0.7 * right)]
    strokes += [(tip, tip - 0.5 * up + side * 0.35 * across) for side in (1, -1)]
    kept = (up != 0).any(axis=1)
    return np.concatenate([np.stack(ends, axis=1)[kept] for ends in strokes])


def _strokes(lines: Floats, size: int, width: int) -> Image.Image:
    """A mask (size, size) of lines (E, 2, 2) in UV, smooth at their sides."""
    finer = 2 if 2 * size <= _SMOOTHED else 1
    mask = Image.new("L", (finer * size, finer * size))
    draw = ImageDraw.Draw(mask)
    for ends in _pixels(lines, finer * size).tolist():
        draw.line([tuple(end) for end in ends], fill=255, width=finer * width)
    return mask.reduce(finer) if finer > 1 else mask


def _pixels(uv: Floats, size: int) -> Floats:
    """Places (…, 2) in UV as Pillow counts them: whole numbers are middles of pixels."""
    return (uv * (1, -1) + (0, 1)) * size - 0.5
