"""Figures 1, 3 and 4 of the paper: a face, its stretch, its skin by every method, and the
precomputed maps of each bin."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.domain.tiles import TileAddress, triangles_inside, udim_origin
from rhytid.pictures.flat_patches import FlatPatch, most_stretched_patches
from rhytid.pictures.images import Picture, diverging, signed_grey, to_picture
from rhytid.pictures.raster import View, shade_mesh
from rhytid.pictures.relief import relief, surface_crop
from rhytid.pictures.sheet import Panel, axis_arrows, blank_strip, scale_bar, sheet, wheel_legend
from rhytid.pipeline.bins import quantisation_steps, sample_stretches
from rhytid_lab.bench.skin import COLUMNS, Column, Map, Skin
from rhytid_lab.bench.subject import Subject
from rhytid_lab.contact_sheets import (
    SIZE,
    STEEP,
    Performance,
    axis_colours,
    patch_views,
    relative_rms,
    stack,
    stretch_bar,
    stretch_limit,
    with_patches,
)

# The side of a crop, in mean pore spacings: wide enough for a pattern, near enough to see it.
CROP_SPACINGS = 16.0
# At most this share of the face, where few wrinkles stand far apart.
_CROP_SHARE = 0.08
_CONVOLVED = "(c) The neutral map blurred along stretched axes, sharpened along compressed ones. "
_SIZE = 190
_ROWS = ("compression", "neutral", "stretch")


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
    """Return the frame that stretches most, with the patches where it does.  spacing: mean spacing
    of pores, mesh units.

    Raises MeshError where no patch of the size of a crop fits into the chart.
    """
    performance = performance_of(subject, skin, subject.strongest)
    p = performance
    extent = float(np.ptp(p.neutral, axis=0).max())
    side = min(CROP_SPACINGS * spacing, _CROP_SHARE * extent)
    patches = most_stretched_patches(p.neutral[p.faces], p.triangle_uv, p.axes, p.ratios, side / 2)
    return Scene(skin, subject.strongest, performance, patches, side, unit_mm)


def performance_of(subject: Subject, skin: Skin, name: str) -> Performance:
    """Return a frame as plain arrays, with the triangles of the UDIM that is drawn."""
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
    """Return a map for every column, by its title."""
    maps = {}
    for column in COLUMNS:
        skin.use(bins={**column.bins, "r_max": subject.r_max})
        maps[column.title] = skin.map(subject.frames[frame], column.method)
    return maps


def figure_1(scene: Scene, maps: dict[str, Map]) -> tuple[Image.Image, dict[str, Any]]:
    """Figure 1: the neutral face with a stretched and a compressed patch (a), and both by each
    method (b…)."""
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
    """Figure 3: neutral (a), primary and secondary axes (b, c) and their ratios (d, e)."""
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


def figure_4(scene: Scene) -> Image.Image:
    """Figure 4. Columns: the orientation bins and the pores; each cell is displacement and
    relief."""
    skin, patch = scene.skin, scene.patches[0]
    side = 0.75 * scene.side
    address, local = _within_tile(skin, patch, side)
    bins = skin.settings.bins
    middle, last = bins.samples // 2, bins.samples - 1
    rows = []
    for name, sample in zip(_ROWS, (0, middle, last), strict=True):
        crops = [
            _crop(skin, address, local, layer, sample, side) for layer in range(bins.count + 1)
        ]
        rows.append(
            [_cell(_title(skin, name, i, sample), crop, skin, side) for i, crop in enumerate(crops)]
        )
    caption = (
        f"The precomputed maps of the fast method (N = {bins.count}, M = {bins.samples}, "
        f"{bins.bits} bits) on one patch of the undeformed skin: displacement left, relief right. "
        "Each bin holds the wrinkles nearest to its direction; pores are a layer of their own. "
        f"Rows are drawn at log stretch {-bins.r_max:.2f}, 0 and {bins.r_max:.2f}."
    )
    return sheet(rows, caption)


def _title(skin: Skin, row: str, layer: int, sample: int) -> str:
    count = skin.settings.bins.count
    bin = "pores" if layer == count else f"bin {layer}, {_direction(layer, count)}"
    r = sample_stretches(skin.settings)[sample]
    return f"{bin}: {row} ({np.exp(r):.2f})"


def _direction(layer: int, count: int) -> str:
    """The direction of a bin, (sin αₙ, cos αₙ): the first one is up in UV."""
    names = {0.0: "N-S", 0.25: "NE-SW", 0.5: "E-W", 0.75: "NW-SE"}
    share = layer / count
    return names.get(share, f"{180 * share:g} deg from N")


def _within_tile(skin: Skin, patch: FlatPatch, side: float) -> tuple[TileAddress, FlatPatch]:
    """The tile of a patch, and the patch in the tile's own coordinates, moved so that it fits."""
    grid = skin.settings.grid
    count = grid.count(0)
    down = np.array([patch.uv[0], 1 - patch.uv[1]]) * count
    column, row = np.clip(np.floor(down).astype(int), 0, count - 1)
    to_uv = patch.to_uv * count
    reach = 0.75 * side * float(np.linalg.norm(to_uv, 2))
    within = np.clip(down - (column, row), min(reach, 0.5), max(1 - reach, 0.5))
    local = replace(patch, uv=np.array([within[0], 1 - within[1]]), to_uv=to_uv)
    return TileAddress(skin.udim, 0, int(row), int(column)), local


def _crop(
    skin: Skin, address: TileAddress, patch: FlatPatch, layer: int, sample: int, side: float
) -> NDArray[np.float64]:
    step = quantisation_steps(skin.settings, skin.shares)[layer, sample]
    codes = skin.bin_map(address, layer * skin.settings.bins.samples + sample)
    return surface_crop(codes * step, patch, side, _SIZE, deformed=False)


def _cell(title: str, heights: NDArray[np.float64], skin: Skin, side: float) -> Panel:
    depth = skin.settings.depth or 1.0
    grey: Picture = to_picture(signed_grey(heights, 1.5 * depth))
    return Panel(title, np.concatenate([grey, relief(heights, side / _SIZE)], axis=1))
