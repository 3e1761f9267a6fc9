"""Figure 5 of the paper: a sphere, stretched and compressed, by every method."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.pictures.images import BACKGROUND, Picture, downsample, signed_grey, to_picture
from rhytid.pictures.raster import Coverage, View, rasterize, vertex_normals
from rhytid.pictures.relief import lit, spline_samples
from rhytid.pictures.sheet import Panel, sheet
from rhytid.synthesis.progress import Progress
from rhytid_lab.bench.face_figures import performance_of
from rhytid_lab.bench.skin import COLUMNS, Map, Skin
from rhytid_lab.bench.subject import Subject
from rhytid_lab.contact_sheets import relative_rms
from rhytid_lab.samples.sphere import SPHERE_STRETCHES

# Pores that hardly deform: the figure is about those.
PORES = {"beta_w": 1.0, "beta_d": 1.0}
_SPHERE, _CROP, _GAP = 320, 170, 4
_EXAGGERATION = 1.5
# Of the map's side.
_CROP_SHARE = 0.14
_MARGIN = 0.02
_SUPERSAMPLING = 2
# More from the front than on flat crops: a whole sphere is shown.
_LIGHT = (-0.42, 0.46, 0.78)


def figure_5(
    subject: Subject, skin: Skin, progress: Progress
) -> tuple[Image.Image, dict[str, Any]]:
    """Figure 5. Rows: the four deformations.  Columns: the methods; each cell is the sphere and a
    crop."""
    positions = [f.positions for f in subject.frames.values() if f.positions is not None]
    view = View.around(np.concatenate(positions), _MARGIN)
    limit = 1.5 * (skin.settings.depth or 1.0)
    rows, figures = [], {}
    for index, name in enumerate(subject.frames):
        progress(index / len(subject.frames), "figure 5")
        maps = _maps(subject, skin, name)
        panels = [
            Panel(f"{_ratios(name)}: {title}", _cell(subject, skin, name, heights, view, limit))
            for title, heights in maps.items()
        ]
        rows.append(panels)
        figures[name] = {
            title: relative_rms(heights, maps["redraw"]) for title, heights in maps.items()
        }
    caption = (
        "A sphere under isotropic stretch and compression and two anisotropic stretches (ratios "
        "along x and y at its centre): shaded with its displacement, half as deep again, and the "
        "displacement of its centre. Pores hardly deform here (beta_w = beta_d = 1). With one bin "
        "anisotropic stretch cancels out, so that the map stays as it was."
    )
    return sheet(rows, caption), figures


def _maps(subject: Subject, skin: Skin, name: str) -> dict[str, Map]:
    maps = {}
    for column in COLUMNS:
        skin.use(response=PORES, bins={**column.bins, "r_max": subject.r_max})
        maps[column.title] = skin.map(subject.frames[name], column.method)
    return maps


def _ratios(name: str) -> str:
    a, b = SPHERE_STRETCHES[name]
    return f"{a:g} x {b:g}"


def _cell(
    subject: Subject, skin: Skin, name: str, heights: Map, view: View, limit: float
) -> Picture:
    p = performance_of(subject, skin, name)
    ball = shade_displaced(
        p.deformed, p.faces, p.triangle_uv, heights, _SPHERE, view, _EXAGGERATION
    )
    return _beside(ball, to_picture(signed_grey(_centre(heights), limit)))


def _centre(heights: Map) -> Any:
    """The middle of the map; u is along x, so it needs no turning."""
    size = len(heights)
    along = (0.5 + _CROP_SHARE * ((np.arange(_CROP) + 0.5) / _CROP - 0.5)) * size - 0.5
    column, row = np.meshgrid(along, along)
    return spline_samples(heights, row, column)


def _beside(ball: Picture, crop: Picture) -> Picture:
    """The crop beside the sphere, in the middle of its height."""
    cell = np.full((_SPHERE, _SPHERE + _GAP + _CROP, 3), 255, np.uint8)
    cell[:, :_SPHERE] = ball
    top = (_SPHERE - _CROP) // 2
    cell[top : top + _CROP, -_CROP:] = crop
    return cell


def shade_displaced(
    positions: NDArray[Any],
    faces: NDArray[Any],
    triangle_uv: NDArray[Any],
    displacement: NDArray[Any],
    size: int,
    view: View,
    exaggeration: float = 1.0,
) -> Picture:
    """Return a picture (size, size, 3) of a surface seen from +z, every pixel lit with its
    displaced normal.

    positions: (V, 3).  faces: (F, 3).  triangle_uv: (F, 3, 2), local to the UDIM of the map.
    displacement: (R, R) mesh units, row 0 at the top.  exaggeration: multiplies it.
    """
    fine = size * _SUPERSAMPLING
    corners = np.asarray(positions, np.float64)[faces]
    seen = rasterize(view.pixels(corners, fine), fine, fine, corners[..., 2])
    normals = seen.smooth(vertex_normals(positions, faces)[faces])
    uv = seen.smooth(np.asarray(triangle_uv, np.float64))
    slopes = _surface_gradient(seen, corners, triangle_uv, _uv_gradient(displacement, uv))
    bent = normals - exaggeration * slopes
    bent /= np.maximum(np.linalg.norm(bent, axis=-1, keepdims=True), 1e-30)
    colour = np.where(seen.covered[..., None], lit(bent, _LIGHT), BACKGROUND)
    return to_picture(downsample(colour, _SUPERSAMPLING))


def _uv_gradient(heights: NDArray[Any], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, W, 2): ∂h/∂u and ∂h/∂v at texture coordinates (H, W, 2)."""
    size = len(heights)
    down, across = np.asarray(np.gradient(np.asarray(heights, np.float64), 1.0 / size))
    row: NDArray[np.float64] = (1 - uv[..., 1]) * size - 0.5
    column: NDArray[np.float64] = uv[..., 0] * size - 0.5
    slopes = (spline_samples(across, row, column), -spline_samples(down, row, column))
    return np.stack(slopes, axis=-1)


def _surface_gradient(
    seen: Coverage, corners: NDArray[Any], triangle_uv: NDArray[Any], slopes: NDArray[Any]
) -> NDArray[np.float64]:
    """(H, W, 3): J(JᵀJ)⁻¹∇h, J = ∂X/∂(u, v) of the visible triangle; 0 where it has no area."""
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    t = np.asarray(triangle_uv, np.float64)
    edges_uv = np.stack([t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]], axis=-1)
    # J = E U⁻¹, so J(JᵀJ)⁻¹ = (J⁺)ᵀ = (U E⁺)ᵀ.
    back = np.swapaxes(edges_uv @ np.linalg.pinv(edges, rcond=1e-9), -1, -2)
    gradient = np.einsum("hwij,hwj->hwi", back[seen.triangle], slopes)
    return np.where(seen.covered[..., None], gradient, 0.0)
