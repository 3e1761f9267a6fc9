"""Problems of a mesh as a picture: it from three sides and its UV, their triangles coloured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.domain.wording import plural
from rhytid.pictures.images import Picture, to_picture
from rhytid.pictures.raster import CLAY, View, rasterize_uv, shade_mesh
from rhytid.pictures.sheet import INK, STRIP, Panel, font, marked, sheet

SIDE = 420
MOST_UDIMS = 6
_TURNS = {"from the left": -60.0, "from the front": 0.0, "from the right": 60.0}
_EMPTY, _FILL = (1.0, 1.0, 1.0), (0.86, 0.86, 0.85)
_BOX = 26.0


@dataclass(frozen=True, eq=False)
class Problem:
    """A kind of problem and the triangles that have it.

    name: for the legend.  triangles: (F,) mask.  colour: sRGB in 0…1.
    """

    name: str
    triangles: NDArray[np.bool_]
    colour: tuple[float, float, float]

    @property
    def ink(self) -> tuple[int, int, int]:
        """The colour in 8 bits."""
        red, green, blue = (round(255 * value) for value in self.colour)
        return red, green, blue


def check_picture(
    mesh: Mesh, udims: Sequence[int], problems: Sequence[Problem], caption: str
) -> Image.Image:
    """A sheet with the mesh from three sides, its UDIMs (MOST_UDIMS at most) and a legend.

    Later problems are drawn over earlier ones. A square with its number marks the largest triangle
    of each problem; in space, the largest of those that face the viewer.
    """
    space, flat = (_colours(len(mesh.faces), problems, ground) for ground in (CLAY, _FILL))
    solids = [Panel(name, _solid(mesh, turn, space, problems)) for name, turn in _TURNS.items()]
    maps = [
        Panel(f"UV, UDIM {udim}", _map(mesh, udim, flat, problems)) for udim in udims[:MOST_UDIMS]
    ]
    rows = [maps[i : i + len(solids)] for i in range(0, len(maps), len(solids))]
    return sheet([solids, *rows, [Panel("", _legend(problems))]], caption)


def _colours(
    count: int, problems: Sequence[Problem], ground: tuple[float, float, float]
) -> NDArray[np.float64]:
    """(F, 3) of triangles."""
    colours = np.tile(np.array(ground), (count, 1))
    for problem in problems:
        colours[problem.triangles] = problem.colour
    return colours


def _solid(
    mesh: Mesh, turn: float, colours: NDArray[np.float64], problems: Sequence[Problem]
) -> Picture:
    angle = math.radians(turn)
    about = np.array(
        [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    )
    used = np.unique(mesh.faces)
    middle = mesh.positions[used].astype(np.float64).mean(axis=0)
    positions = (mesh.positions.astype(np.float64) - middle) @ np.linalg.inv(about).T
    view = View.around(positions[used])
    picture = shade_mesh(positions, mesh.faces, SIDE, view, colours)
    corners = positions[mesh.faces]
    middles = view.pixels(corners.mean(axis=1), SIDE)
    areas = _areas(corners)
    # Triangles that face away are on the other side; those without area face nowhere.
    a, b, c = np.moveaxis(corners[..., :2], 1, 0)
    away = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] < 0
    return marked(picture, _boxes(middles, np.where(away, -1.0, areas), problems))


def _map(
    mesh: Mesh, udim: int, colours: NDArray[np.float64], problems: Sequence[Problem]
) -> Picture:
    local = mesh.triangle_uv() - udim_origin(udim)
    # Triangles with a problem are drawn over the others.
    order = np.argsort(~np.any([p.triangles for p in problems], axis=0), kind="stable")
    seen = rasterize_uv(local[order], SIDE)
    picture = to_picture(seen.flat(colours[order], _EMPTY))
    middles = local.mean(axis=1) * (1, -1) + (0, 1)
    outside = ((middles < 0) | (middles > 1)).any(axis=1)
    edges = np.pad(np.roll(local, -1, axis=1) - local, ((0, 0), (0, 0), (0, 1)))
    areas = np.where(outside, -1.0, np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))
    framed: Picture = marked(picture, _boxes(middles * SIDE, areas, problems)).copy()
    framed[[0, -1]], framed[:, [0, -1]] = INK, INK
    return framed


def _areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c = np.moveaxis(corners, 1, 0)
    areas: NDArray[np.float64] = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _boxes(
    middles: NDArray[np.float64], areas: NDArray[np.float64], problems: Sequence[Problem]
) -> list[tuple[NDArray[np.float64], float, str, tuple[int, int, int]]]:
    """A square with its number at the largest triangle of each problem; areas below 0 are not
    shown."""
    boxes = []
    for number, problem in enumerate(problems, 1):
        rows = np.flatnonzero(problem.triangles & (areas >= 0))
        if len(rows):
            largest = rows[np.argmax(areas[rows])]
            boxes.append((middles[largest], _BOX, str(number), problem.ink))
    return boxes


def _legend(problems: Sequence[Problem]) -> Picture:
    """Colours by number and name, with how many triangles have each."""
    rows = -(-len(problems) // 3)
    image = Image.new("RGB", (3 * SIDE, rows * STRIP), "white")
    draw = ImageDraw.Draw(image)
    for number, problem in enumerate(problems):
        x, y = number % 3 * SIDE + 10, number // 3 * STRIP + 10
        draw.rectangle([x, y, x + 20, y + 20], fill=problem.ink)
        text = f"{number + 1} {problem.name}: {plural(int(problem.triangles.sum()), 'triangle')}"
        draw.text((x + 30, y + 10), text, fill=INK, font=font(15), anchor="lm")
    return np.asarray(image)


def problems_of(masks: Mapping[str, NDArray[np.bool_]]) -> list[Problem]:
    """The problems of masks by the names of KINDS, in the order of KINDS; names without a mask are
    left out."""
    kinds = ((name, masks[name]) for name in KINDS if name in masks)
    return [Problem(KINDS[name][0], mask, KINDS[name][1]) for name, mask in kinds]


KINDS = {
    "fine_texels": ("texels 10 times smaller than the largest", (0.62, 0.80, 0.95)),
    "coarse_texels": ("texels 10 times larger than the smallest", (0.95, 0.75, 0.35)),
    "uv_mirrored": ("UV mirrored", (0.55, 0.35, 0.75)),
    "uv_overlap": ("UV overlaps", (0.10, 0.45, 0.80)),
    "boundary": ("at an open border", (0.10, 0.60, 0.35)),
    "flat_in_uv": ("no area in UV", (0.45, 0.30, 0.15)),
    "degenerate": ("no area in space", (0.10, 0.10, 0.10)),
    "flipped": ("wound against the rest", (0.90, 0.35, 0.65)),
    "non_manifold": ("at a non-manifold edge", (0.85, 0.10, 0.10)),
}
