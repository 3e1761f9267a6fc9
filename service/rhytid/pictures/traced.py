"""The picture of a traced scan: the scan, the lines that were found, and the rest, shaded alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.pictures.images import Picture, downsample
from rhytid.pictures.relief import relief, spline_samples
from rhytid.pictures.sheet import Panel, sheet

Relief = NDArray[np.float32]
# Pixels of a side of a panel, and the share of a side of the map that the second row shows.
_PANEL, _CROP = 512, 8
# What is exaggerated until a twentieth of the scan is steeper than this, at most so many times.
_STEEP, _MOST = 0.6, 100.0
# The share of a crop that lies in charts, at least, where there is such a place.
_FULL = 0.98


def traced_picture(
    scan: Relief, residual: Relief, inside: NDArray[np.bool_], texel: float, caption: str
) -> Image.Image:
    """A row of the whole map, and one of a part of it where most lines are.

    scan, residual: (R, R), mesh units, row 0 at the top, R a power of two.  inside (R, R): where
    charts are.  texel: usual side of a texel on the surface, mesh units.  caption: the first words
    of the text below.
    """
    maps = {"the scan": scan, "its lines, drawn": scan - residual, "the rest": residual}
    panel = min(_PANEL, len(scan))
    factor, size = len(scan) // panel, max(len(scan) // _CROP, 32)
    corner = _busiest(np.where(inside, scan - residual, np.float32(0.0)), inside, size)
    whole = [downsample(np.where(inside, one, 0.0), factor) for one in maps.values()]
    crops = [_crop(one, corner, size) for one in maps.values()]
    rows, told = [], []
    for heights, step in ((whole, texel * factor), (crops, texel * size / _PANEL)):
        times = _exaggeration(heights[0], step)
        rows.append([_panel(t, h, step, times) for t, h in zip(maps, heights, strict=True)])
        told.append(f"{times:.3g}")
    steep = f"Relief is exaggerated {told[0]} times above, {told[1]} times below."
    return sheet(rows, f"{caption} {steep}")


def _panel(title: str, heights: NDArray[np.float64], step: float, times: float) -> Panel:
    image: Picture = relief(heights, step, exaggeration=times)
    return Panel(title, image)


def _exaggeration(heights: NDArray[np.float64], step: float) -> float:
    """How many times the relief is exaggerated for its slopes to be seen."""
    steep = np.quantile(np.hypot(*np.gradient(heights, step)), 0.95)
    return float(np.clip(_STEEP / max(steep, 1e-30), 1.0, _MOST))


def _busiest(drawn: Relief, inside: NDArray[np.bool_], size: int) -> tuple[int, int]:
    """The corner, row and column, of the square of `size` texels with most lines, among those that
    lie in charts as far as squares do."""
    half = size // 2
    means = [downsample(np.asarray(v, np.float64), half) for v in (np.abs(drawn), inside)]
    lines, shares = ((m[1:, 1:] + m[:-1, 1:] + m[1:, :-1] + m[:-1, :-1]) / 4 for m in means)
    full = shares >= min(_FULL, float(shares.max()))
    row, column = np.unravel_index(np.argmax(np.where(full, lines, -1.0)), lines.shape)
    return int(row) * half, int(column) * half


def _crop(values: Relief, corner: tuple[int, int], size: int) -> NDArray[np.float64]:
    """(_PANEL, _PANEL) heights of a square of `size` texels."""
    along = (np.arange(_PANEL) + 0.5) * size / _PANEL - 0.5
    row, column = np.meshgrid(along + corner[0], along + corner[1], indexing="ij")
    return spline_samples(values, row, column)
