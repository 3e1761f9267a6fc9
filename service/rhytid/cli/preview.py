"""Pictures of `--preview`: the skin of a graph, drawn on a device."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.preview_spots import Spots, flat_spots, spot_at
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls, Stiffness, bilinear, painted_regions
from rhytid.domain.skin import REGIONS
from rhytid.domain.tiles import busiest_udim, mesh_udims, triangles_inside, udim_origin
from rhytid.domain.uv_layout import mean_uv_length
from rhytid.domain.wording import plural
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pictures.preview import (
    LIGHTS,
    PATCH,
    WHOLE,
    Patch,
    RegionView,
    WholeMap,
    patch_panel,
    preview,
    region_views,
)
from rhytid.pictures.sheet import Panel, sheet
from rhytid.pictures.surface_patch import SurfacePatch, surface_patch
from rhytid.support.atomic_files import atomic_write
from rhytid.support.console import share_bar, working
from rhytid.synthesis.progress import Progress, part

PATCH_MM = 20.0
MOST_UDIMS = 4
# Of a patch in the picture of regions, wide enough for leaders to lie in it; its pixels per side.
SIDE_MM, _PIXELS = 14.0, 480
# Texels between two pores, at least, as far as maps go.
_DENSITY = 16.0
# What patches of ages are of.
_REGIONS = "Regions as they are painted, or as masks of named expressions have them"
_FLATTEST = "No region is known: the flattest places"
# Texels per side of what is drawn at once; and of whole maps, of which a pixel is a mean of 16.
_DRAWN, _DRAWN_WHOLE = 512, 4 * WHOLE
_RESOLUTIONS: list[int] = [2**n for n in range(10, 15)]
_NEUTRAL = MapQuery("neutral")
# Shares of the progress at which whole maps and patches are drawn.
_WHOLE, _DRAWING = 0.5, 0.9


def write_preview(
    device: Device,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    spacing: float,
    file: Path,
    place: Sequence[float] = (),
) -> None:
    """Draw the neutral skin of a graph into a PNG: whole maps, and patches.

    graph: with the triangles of its pores.  settings: unit and lengths that it is drawn with.
    spacing: measured distance of its pores, mesh units.  place: u and v, or x, y and z, of the only
    patch; empty for patches at the flattest places.
    """
    unit_mm = millimetres(settings.length_unit) or MILLIMETRES[USUAL_UNIT]
    side = PATCH_MM / unit_mm
    sides = [side * 0.5**n for n in range(8)]
    with working("placing patches"):
        near = spot_at(mesh, place, side) if place else flat_spots(mesh, sides)
    scales = [spot.scale for spot in near.spots]
    settings = settings.changed({"resolution": resolution_for(scales, spacing)})
    caption = (
        f"{plural(graph.counts()[1], 'wrinkle')}, pores {spacing * unit_mm:.3g} mm apart, drawn at "
        f"{settings.resolution} x {settings.resolution} texels. Whole maps are means over larger "
        "texels, their relief exaggerated. Patches are seen on the surface, along its normal, true "
        "to scale, 45° and grazing light from the upper left."
    )
    with share_bar("preview") as show:
        show(0.0, "uploading")
        # Of whole maps nobody sees the texels of the patches, which take minutes all over a face.
        broad = settings.changed({"resolution": min(settings.resolution, _DRAWN_WHOLE)})
        maps = _wholes(device, mesh, graph, broad, near.udim, part(show, 0.0, _WHOLE))
        show(_WHOLE, "uploading")
        with resident(device, mesh, graph, settings) as asset:
            patches = _patches(asset, mesh, near, part(show, _WHOLE, _DRAWING))
        show(_DRAWING, "picture")
        with atomic_write(file) as aside:
            preview(maps, patches, unit_mm, caption).save(aside, format="png")


def _wholes(
    device: Device,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    near: int,
    progress: Progress,
) -> list[WholeMap]:
    """The maps of the UDIM `near` and of some others."""
    others = [udim for udim in mesh_udims(mesh) if udim != near]
    udims, maps = sorted([near, *others[: MOST_UDIMS - 1]]), []
    with resident(device, mesh, graph, settings) as asset:
        for done, one in enumerate(udims):
            progress(done / len(udims), f"UDIM {one}")
            maps.append(_whole(asset, mesh, one))
    return maps


def _whole(asset: DeviceAsset, mesh: Mesh, udim: int) -> WholeMap:
    level = asset.mesh.settings.grid.levels - WHOLE.bit_length()
    heights = asset.drawing.to_host(NEUTRAL_FRAME, _NEUTRAL, udim, level, 0, 0, WHOLE)
    return WholeMap(udim, heights, mean_uv_length(mesh, udim))


def _patches(asset: DeviceAsset, mesh: Mesh, near: Spots, progress: Progress) -> list[Patch]:
    """The patches at some spots. The map is only drawn where they lie."""
    udim, side = near.udim, near.side
    inside = triangles_inside(mesh, udim)
    corners = mesh.positions[mesh.faces[inside]].astype(np.float64)
    uv = mesh.triangle_uv()[inside] - udim_origin(udim)
    surfaces = [surface_patch(corners, uv, spot.frame, side, PATCH) for spot in near.spots]
    heights = drawn_under(asset, udim, surfaces, progress)
    named = zip("AB", near.spots, surfaces, strict=False)
    return [Patch(name, udim, s.uv, side, surface, heights) for name, s, surface in named]


@dataclass(frozen=True, eq=False)
class AgedSkin:
    """The skin of an age.

    settings: unit and lengths that it is drawn with.  spacing: distance of its pores, mesh units.
    """

    age: float
    graph: WrinkleGraph
    settings: AssetSettings
    spacing: float


@dataclass(frozen=True, eq=False)
class SheetPlaces:
    """What the picture of regions looks at: patches in one UDIM, none where nothing fits.

    known: whether they are regions, not the flattest places of a mesh without any.
    """

    udim: int
    views: list[RegionView]
    known: bool

    @classmethod
    def of(
        cls, mesh: Mesh, folds: Folds | None, controls: Controls | None, unit: str
    ) -> SheetPlaces:
        """All regions that lie in the UDIM with most triangles, or the flattest places there."""
        side = SIDE_MM / (millimetres(unit) or MILLIMETRES[USUAL_UNIT])
        udim = busiest_udim(mesh)
        views = skin_views(mesh, folds, udim, side, controls)
        return cls(udim, views or _flat_views(mesh, udim, side), bool(views))


def write_region_sheet(
    device: Device, mesh: Mesh, places: SheetPlaces, skins: Iterable[AgedSkin], file: Path
) -> None:
    """Draw patches at some places into a PNG, two rows for each skin."""
    rows: list[list[Panel]] = []
    for skin in skins:
        rows += _rows(device, mesh, places, skin)
    caption = (
        f"{_REGIONS if places.known else _FLATTEST}, {SIDE_MM:g} mm wide, seen on the surface "
        "along its normal, true to scale; light from the upper left, at 45° and grazing."
    )
    with working(f"drawing {file.name}"), atomic_write(file) as aside:
        sheet(rows, caption).save(aside, format="png")


def skin_views(
    mesh: Mesh,
    folds: Folds | None,
    udim: int,
    side: float,
    controls: Controls | None = None,
    asked: Collection[str] = REGIONS,
) -> list[RegionView]:
    """Where each region of a face that is asked for is looked at, as patches of `side` mesh units.
    A region that is painted lies where it is painted, others where expressions show them."""
    inside = triangles_inside(mesh, udim)
    faces = mesh.faces[inside]
    uv = mesh.triangle_uv()[inside] - udim_origin(udim)
    masks, folding = {}, np.zeros(len(faces))
    if folds is not None:
        size, eccentricity, _ = folds.axes()
        folding = (size * eccentricity)[faces].mean(axis=1)
        masks = {name: mask[faces].mean(axis=1) for name, mask in folds.regions.items()}
    for name, mask in painted_regions(controls).items():
        painted = mask.get(udim)
        values = np.zeros(len(faces)) if painted is None else bilinear(painted, uv.mean(axis=1))
        masks[name] = values
    masks = {name: mask for name, mask in masks.items() if name in asked}
    corners = mesh.positions[faces].astype(np.float64)
    return region_views(corners, uv, masks, folding, side, _PIXELS)


def _flat_views(mesh: Mesh, udim: int, side: float) -> list[RegionView]:
    """The flattest places of its UDIM with most triangles, as patches of `side` mesh units."""
    inside = triangles_inside(mesh, udim)
    corners = mesh.positions[mesh.faces[inside]].astype(np.float64)
    uv = mesh.triangle_uv()[inside] - udim_origin(udim)
    spots = flat_spots(mesh, [side]).spots
    surfaces = [surface_patch(corners, uv, spot.frame, side, _PIXELS) for spot in spots]
    return [RegionView(f"place {name}", -1, one) for name, one in zip("AB", surfaces, strict=False)]


def _rows(device: Device, mesh: Mesh, places: SheetPlaces, skin: AgedSkin) -> list[list[Panel]]:
    resolution = resolution_for([view.scale for view in places.views], skin.spacing)
    settings = skin.settings.changed({"resolution": resolution})
    with share_bar(f"regions, age {skin.age:g}") as show:
        show(0.0, "uploading")
        with resident(device, mesh, skin.graph, settings) as asset:
            surfaces = [view.surface for view in places.views]
            heights = drawn_under(asset, places.udim, surfaces, part(show, 0.0, _DRAWING))
        show(_DRAWING, "pictures")
        return [
            [
                patch_panel(
                    f"{view.region.replace('_', ' ')}, {skin.age:g} years, {light:g}°",
                    view.surface, heights, light, SIDE_MM,
                )
                for view in places.views
            ]
            for light in LIGHTS
        ]  # fmt: skip


def resolution_for(scales: Sequence[float], spacing: float) -> int:
    """Texels per side that resolve pores in patches.  scales: UV per mesh unit in each patch.
    spacing: of pores, mesh units."""
    wanted = _DENSITY / (spacing * min(scales, default=np.inf))
    return next((r for r in _RESOLUTIONS if r >= wanted), _RESOLUTIONS[-1])


@contextmanager
def resident(
    device: Device,
    mesh: Mesh,
    graph: WrinkleGraph,
    settings: AssetSettings,
    stiffness: Stiffness | None = None,
) -> Iterator[DeviceAsset]:
    """The skin of a graph on a device, ready to be drawn. Its memory is freed after the block."""
    with device.task():
        asset = DeviceAsset(device, mesh, settings, stiffness)
        try:
            asset.mesh.locate(graph)
            asset.mesh.install(asset.mesh.prepare(graph, settings), settings)
            yield asset
        finally:
            asset.release()


def drawn_under(
    asset: DeviceAsset,
    udim: int,
    surfaces: Sequence[SurfacePatch],
    progress: Progress,
    frame: Frame = NEUTRAL_FRAME,
) -> NDArray[np.float32]:
    """(R, R) displacement of a UDIM in a frame. It is drawn only where patches read it, and 0
    elsewhere."""
    query = _NEUTRAL if frame is NEUTRAL_FRAME else MapQuery("redraw")
    resolution = asset.mesh.settings.resolution
    # Memory is taken by the squares that are written, not by the whole map.
    heights = np.zeros((resolution, resolution), np.float32)
    drawn = min(_DRAWN, resolution)
    squares = touched_squares(surfaces, resolution, drawn)
    for done, (row, column) in enumerate(squares):
        progress(done / len(squares), "patches")
        square = asset.drawing.to_host(frame, query, udim, 0, row, column, drawn)
        heights[row : row + drawn, column : column + drawn] = square
    return heights


def touched_squares(
    surfaces: Sequence[SurfacePatch], resolution: int, side: int
) -> list[tuple[int, int]]:
    """Row and column of each square of `side` texels that the patches read."""
    count = resolution // side
    touched = np.zeros((count, count), bool)
    for surface in surfaces:
        u, v = surface.uv[surface.seen.covered].T
        texels = np.floor(np.stack([1 - v, u]) * resolution - 0.5).astype(np.int64)
        # A spline reads from one texel before to two after.
        for shift in itertools.product((-1, 2), repeat=2):
            row, column = np.clip(texels + np.reshape(shift, (2, 1)), 0, resolution - 1) // side
            touched[row, column] = True
    return [(int(row) * side, int(column) * side) for row, column in np.argwhere(touched)]
