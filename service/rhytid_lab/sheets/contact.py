"""The contact sheet of one frame: the face, its stretch, and its skin at two patches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.errors import InputError
from rhytid.pictures.flat_patches import most_stretched_patches
from rhytid.pictures.sheet import sheet
from rhytid_lab.sheets.contact_rows import METHODS, face_row
from rhytid_lab.sheets.skin_rows import grazing_row, patch_views, skin_row
from rhytid_lab.sheets.stretch_colours import Performance


def contact_sheet(
    frame: Performance,
    displacement: Mapping[str, NDArray[Any]],
    crop_mm: float = 12.0,
    unit_mm: float = 10.0,
    note: str = "",
) -> Image.Image:
    """One sheet: the face and its stretch above, the skin of two patches below.

    displacement: (R, R) mesh units, row 0 at the top, by method: neutral, redraw, binned.
    crop_mm: side of a crop on the surface.  unit_mm: millimetres a mesh unit.  note: added to
    the caption.  Raises InputError for maps that do not belong together, MeshError where no
    patch of the size of a crop fits.
    """
    _check(displacement)
    side = crop_mm / unit_mm
    corners = np.asarray(frame.neutral)[frame.faces]
    patches = most_stretched_patches(corners, frame.triangle_uv, frame.axes, frame.ratios, side / 2)
    rows = [face_row(frame, patches, side)]
    crops: list[dict[str, NDArray[Any]]] = []
    for name, patch in zip("AB", patches, strict=True):
        views = patch_views(frame, patch, side)
        crops.append({m: views[m].heights(displacement[m]) for m in METHODS})
        rows.append(skin_row(name, patch, views, displacement, side, unit_mm))
        rows.append(grazing_row(name, views, displacement, side, unit_mm))
    return sheet(rows, _caption(displacement, crops, crop_mm, note))


def relative_rms(values: NDArray[Any], reference: NDArray[Any]) -> float:
    """Rms of the difference over the rms of the reference; 0 where both are zero everywhere."""
    difference = float(np.sqrt(np.mean((values - reference) ** 2, dtype=np.float64)))
    scale = float(np.sqrt(np.mean(np.square(reference), dtype=np.float64)))
    return difference / scale if scale else (np.inf if difference else 0.0)


def _check(displacement: Mapping[str, NDArray[Any]]) -> None:
    for method in METHODS:
        if method not in displacement:
            raise InputError(f"displacement has no {method!r}")
        shape = np.shape(displacement[method])
        if len(shape) != 2 or shape[0] != shape[1] or shape != np.shape(displacement["neutral"]):
            raise InputError(f"displacement {method!r} has shape {shape}: three equal squares")


def _caption(
    displacement: Mapping[str, NDArray[Any]],
    crops: list[dict[str, NDArray[Any]]],
    crop_mm: float,
    note: str,
) -> str:
    whole = relative_rms(displacement["binned"], displacement["redraw"])
    a, b = (relative_rms(crop["binned"], crop["redraw"]) for crop in crops)
    resolution = len(displacement["redraw"])
    text = (
        f"A: the most stretched patch, B: the most compressed one, each {crop_mm:g} mm wide on the "
        "surface it is shown on (neutral: undeformed; the others: deformed, so stretched skin "
        "shows less of the map), seen along the normal at its middle. Heights are true to scale, "
        "read through a cubic B-spline; one light from the upper left. "
        f"Rms of binned - redraw over rms of redraw: {100 * whole:.1f} % of the whole map "
        f"({resolution} x {resolution} texels), {100 * a:.1f} % in A, {100 * b:.1f} % in B."
    )
    return f"{text}\n{note}" if note else text
