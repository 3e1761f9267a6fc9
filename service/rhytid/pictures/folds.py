"""A picture of the folds of skin: the preferred lines on the shaded face, coloured by strength."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rhytid.domain.expressions import Folds
from rhytid.pictures.shade_mesh import View, shade_mesh, vertex_normals

# Pixels between two strokes, and along the longest of them.
_SPACING, _LENGTH = 9.0, 17.0
# Root mean square log compression that is drawn in the strongest colour.
_MOST = 0.12
_FINE = 2
_FAINT, _STRONG = np.array([70.0, 90.0, 190.0]), np.array([200.0, 20.0, 20.0])


def fold_picture(
    positions: NDArray[Any], faces: NDArray[Any], folds: Folds, size: int = 1024
) -> Image.Image:
    """Strokes along the lines that folds prefer, on the mesh seen from +z: long and red where it
    folds much, short and blue where hardly.

    positions: (V, 3).  faces: (F, 3).  size: pixels per side.
    """
    view = View.around(positions)
    clay = Image.fromarray(shade_mesh(positions, faces, size, view))
    image = Image.blend(clay, Image.new("RGB", clay.size, (255, 255, 255)), 0.45)
    image = image.resize((size * _FINE, size * _FINE), Image.Resampling.BICUBIC)
    canvas = ImageDraw.Draw(image)
    strength, eccentricity, axis = folds.axes()
    normal = vertex_normals(positions, faces)
    lines = np.cross(normal, axis)[:, :2] * (1, -1)
    share = np.minimum(strength / _MOST, 1.0)
    pixels = view.pixels(positions, size * _FINE)
    for i in _spaced_vertices(pixels, positions, normal):
        half = lines[i] * _FINE * _LENGTH * (0.15 + 0.35 * np.sqrt(share[i]))
        half *= 0.3 + 0.7 * eccentricity[i] ** 0.5
        colour = (_FAINT + (_STRONG - _FAINT) * share[i]).astype(int)
        ends = [tuple(pixels[i] - half), tuple(pixels[i] + half)]
        canvas.line(ends, fill=tuple(colour), width=_FINE * (2 if share[i] > 0.25 else 1))
    return image.resize((size, size), Image.Resampling.LANCZOS)


def _spaced_vertices(
    pixels: NDArray[np.float64], positions: NDArray[Any], normal: NDArray[np.float64]
) -> NDArray[np.intp]:
    """Vertices that face the viewer, the nearest one of each cell of the picture."""
    seen = np.flatnonzero(normal[:, 2] > 0.08)
    seen = seen[np.argsort(-np.asarray(positions, np.float64)[seen, 2], kind="stable")]
    cells = np.floor(pixels[seen] / (_FINE * _SPACING)).astype(np.int64)
    first = np.unique(cells, axis=0, return_index=True)[1]
    found: NDArray[np.intp] = seen[first]
    return found
