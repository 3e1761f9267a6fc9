"""Figures 1 and 3 of the paper: a face, its stretch, and its skin by every method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.domain.tiles import triangles_inside, udim_origin
from rhytid.pictures.flat_patches import FlatPatch, most_stretched_patches
from rhytid.pictures.images import Picture, diverging
from rhytid.pictures.raster import View, shade_mesh
from rhytid.pictures.sheet import Panel, axis_arrows, blank_strip, scale_bar, sheet, wheel_legend
from rhytid_lab.bench.skin import COLUMNS, Column, Map, Skin
from rhytid_lab.bench.subject import Subject
from rhytid_lab.sheets.contact import relative_rms
from rhytid_lab.sheets.contact_rows import SIZE, stack, with_patches
from rhytid_lab.sheets.skin_rows import STEEP, patch_views
from rhytid_lab.sheets.stretch_colours import Performance, axis_colours, stretch_bar, stretch_limit

# The side of a crop, in mean pore spacings: wide enough for a pattern, near enough to see it.
CROP_SPACINGS = 16.0
# At most this share of the face, where few wrinkles stand far apart.
_CROP_SHARE = 0.08
_CONVOLVED = "(c) The neutral map blurred along stretched axes, sharpened along compressed ones. "


@dataclass(frozen=True, eq=False)
class Scene:
    """One frame of a subject, the two patches to look at, and the side of a crop, mesh units."""

    skin: Skin
    frame: str
    performance: Performance
    patches: tuple[FlatPatch, FlatPatch]
    side: float
    unit_mm: float


def scene(subject: Subject, skin: Skin, spacing: float, unit_mm: float) -> Scene:
    """The frame that stretches most, where it does.  spacing: of pores, mesh units.

    Raises MeshError where no patch of the size of a crop fits into the chart.
    """
    performance = performance_of(subject, skin, subject.strongest)
    p = performance
    extent = float(np.ptp(p.neutral, axis=0).max())
    side = min(CROP_SPACINGS * spacing, _CROP_SHARE * extent)
    patches = most_stretched_patches(p.neutral[p.faces], p.triangle_uv, p.axes, p.ratios, side / 2)
    return Scene(skin, subject.strongest, performance, patches, side, unit_mm)


def performance_of(subject: Subject, skin: Skin, name: str) -> Performance:
    """A frame as plain arrays, its triangles in the UDIM that is drawn."""
    mesh, frame = subject.mesh, subject.frames[name]
    ratios, axes = skin.stretch(frame)
    inside = triangles_inside(mesh, subject.udim)
    deformed = mesh.positions if frame.positions is None else frame.positions
    return Performance(
        neutral=mesh.positions,
        deformed=deformed,
        faces=mesh.faces[inside],
        triangle_uv=mesh.triangle_uv()[inside] - udim_origin(subject.udim),
        axes=axes[inside],
        ratios=ratios[inside],
    )


def maps_of(subject: Subject, skin: Skin, frame: str) -> dict[str, Map]:
    """A map for every column, by its title."""
    maps = {}
    for column in COLUMNS:
        skin.use(bins={**column.bins, "r_max": subject.r_max})
        maps[column.title] = skin.map(subject.frames[frame], column.method)
    return maps


def figure_1(scene: Scene, maps: dict[str, Map]) -> tuple[Image.Image, dict[str, Any]]:
    """Neutral face with a stretched and a compressed patch (a), and both by each method (b…)."""
    columns = [column for column in COLUMNS if column.letter]
    rows = [_faces(scene)]
    errors: dict[str, Any] = {}
    for name, patch in zip("AB", scene.patches, strict=True):
        view = patch_views(scene.performance, patch, scene.side)["redraw"]
        crops = {c.title: view.heights(maps[c.title]) for c in columns}
        pictures = {c.title: view.picture(maps[c.title], STEEP) for c in columns}
        rows.append([_skin(scene, name, patch, c, pictures[c.title]) for c in columns])
        errors[name] = {c.title: relative_rms(crops[c.title], crops["redraw"]) for c in columns[1:]}
        errors[name]["ratios"] = [float(x) for x in patch.principal[0]]
    caption = (
        f"(a) The neutral face and the frame '{scene.frame}': patch A is the most stretched one, "
        "B the most compressed one. (b) The neutral map on the deformed skin, unchanged. "
        f"{_CONVOLVED if any(c.letter == 'c' for c in columns) else ''}"
        "(d) Every wrinkle redrawn by its stretch. (e) Precomputed maps blended. Crops are "
        f"{scene.side * scene.unit_mm:.1f} mm wide on the surface, seen along its normal, heights "
        "true to scale, one light from the upper left."
    )
    return sheet(rows, caption), errors


def _faces(scene: Scene) -> list[Panel]:
    frame = scene.performance
    view = View.around(np.concatenate([frame.neutral, frame.deformed]))
    logs = frame.logs
    limit = stretch_limit(logs)
    plain, bar = blank_strip(SIZE), stretch_bar(SIZE, limit)

    def panel(title: str, x: NDArray[Any], strip: Picture, colours: Any = None) -> Panel:
        picture = shade_mesh(x, frame.faces, SIZE, view, colours)
        boxed = with_patches(picture, x[frame.faces], scene.patches, view, scene.side)
        return Panel(title, stack(boxed, strip))

    largest = np.take_along_axis(logs, np.abs(logs).argmax(axis=1)[:, None], axis=1)[:, 0]
    panels = [
        panel("(a) neutral", frame.neutral, plain),
        panel(f"(a) {scene.frame}", frame.deformed, plain),
        panel("the larger stretch ratio", frame.deformed, bar, diverging(largest, limit)),
    ]
    return panels


def _skin(scene: Scene, name: str, patch: FlatPatch, column: Column, picture: Picture) -> Panel:
    if column is COLUMNS[0]:
        ratios, angles = patch.principal
        label = f"to {ratios[0]:.2f} along the arrows\nto {ratios[1]:.2f} across"
        picture = axis_arrows(picture, angles[0], ratios[0] > 1, label)
        picture = scale_bar(picture, SIZE / (scene.side * scene.unit_mm), "1 mm")
    return Panel(f"({column.letter}) {name}: {column.title}", picture)


def figure_3(frame: Performance) -> Image.Image:
    """Neutral (a), primary and secondary axes (b, c) and their ratios (d, e)."""
    view = View.around(np.concatenate([frame.neutral, frame.deformed]))
    limit = stretch_limit(frame.logs)
    wheel, bar = wheel_legend(SIZE, "direction in UV; grey: no axis"), stretch_bar(SIZE, limit)

    def panel(title: str, strip: Picture, colours: Any) -> Panel:
        return Panel(
            title, stack(shade_mesh(frame.deformed, frame.faces, SIZE, view, colours), strip)
        )

    neutral = shade_mesh(frame.neutral, frame.faces, SIZE, view)
    row = [
        Panel("(a) neutral", stack(neutral, blank_strip(SIZE))),
        panel("(b) primary axis", wheel, axis_colours(frame, 0)),
        panel("(c) secondary axis", wheel, axis_colours(frame, 1)),
        panel("(d) primary ratio", bar, diverging(frame.logs[:, 0], limit)),
        panel("(e) secondary ratio", bar, diverging(frame.logs[:, 1], limit)),
    ]
    caption = (
        "Principal stretch of each triangle: axes by their direction in UV, the same after half a "
        "turn; ratios red where skin is compressed, purple where it is stretched."
    )
    return sheet([row], caption)
