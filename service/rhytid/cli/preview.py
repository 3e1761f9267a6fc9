"""The picture that `--preview` writes: the skin of a graph, drawn on a device."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.reporting import share_bar
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import busiest_udim, mesh_udims, triangles_inside, udim_origin
from rhytid.domain.units import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.engine.device_asset import DeviceAsset
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.errors import MeshError
from rhytid.pictures.places import Place, flat_places
from rhytid.pictures.preview import PATCH, WHOLE, Patch, WholeMap, preview
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch
from rhytid.synthesis.progress import Progress, part

PATCH_MM = 20.0
MOST_UDIMS = 4
# Texels between two pores, at least, as far as maps go.
_DENSITY = 16.0
# Texels a side of what is drawn at once.
_DRAWN = 512
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
) -> None:
    """Draw the neutral skin of a graph, which names the triangles of its pores, into a PNG.

    settings: unit and lengths that it is drawn with.  spacing: of its pores, as it came out, mesh
    units.
    """
    unit_mm = millimetres(settings.length_unit) or MILLIMETRES[USUAL_UNIT]
    udim = busiest_udim(mesh)
    side, places = _places(mesh, udim, [PATCH_MM / unit_mm * 0.5**n for n in range(8)])
    scales = [float(np.sqrt(abs(np.linalg.det(place.to_uv)))) for place in places]
    settings = settings.changed({"resolution": resolution_for(scales, spacing)})
    caption = (
        f"{graph.counts()[1]} wrinkles, pores {spacing * unit_mm:.3g} mm apart, drawn at "
        f"{settings.resolution} x {settings.resolution} texels. Whole maps are means of many "
        "texels, their relief exaggerated. Patches are seen on the surface, along its normal, true "
        "to scale, 45° and grazing light from the upper left."
    )
    with share_bar("preview") as show:
        with resident(device, mesh, graph, settings) as asset:
            udims = sorted({udim, *mesh_udims(mesh)[:MOST_UDIMS]})[:MOST_UDIMS]
            maps = []
            for done, one in enumerate(udims):
                show(_WHOLE * done / len(udims), f"UDIM {one}")
                maps.append(_whole(asset, mesh, one))
            patches = _patches(asset, mesh, udim, places, side, part(show, _WHOLE, _DRAWING))
        show(_DRAWING, "picture")
        preview(maps, patches, unit_mm, caption).save(file, format="png")


def _places(mesh: Mesh, udim: int, sides: list[float]) -> tuple[float, tuple[Place, ...]]:
    """Where patches of the first of these sides that fits lie flat; none on a tiny mesh."""
    inside = triangles_inside(mesh, udim)
    corners = mesh.positions[mesh.faces[inside]]
    uv = mesh.triangle_uv()[inside] - udim_origin(udim)
    for side in sides:
        with suppress(MeshError):
            return side, flat_places(corners, uv, side / 2)
    return sides[-1], ()


def resolution_for(scales: Sequence[float], spacing: float) -> int:
    """Enough texels for pores in patches.  scales: UV to a mesh unit of each.  spacing: mesh
    units."""
    wanted = _DENSITY / (spacing * min(scales, default=np.inf))
    return next((r for r in _RESOLUTIONS if r >= wanted), _RESOLUTIONS[-1])


@contextmanager
def resident(
    device: Device, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> Iterator[DeviceAsset]:
    """The skin of a graph on a device, ready to be drawn; given back at the end."""
    with device.task():
        asset = DeviceAsset(device, mesh, settings)
        try:
            asset.mesh.locate(graph)
            asset.mesh.install(asset.mesh.prepare(graph, settings), settings)
            yield asset
        finally:
            asset.release()


def _whole(asset: DeviceAsset, mesh: Mesh, udim: int) -> WholeMap:
    level = asset.mesh.settings.grid.levels - WHOLE.bit_length()
    heights = asset.drawing.to_host(NEUTRAL_FRAME, _NEUTRAL, udim, level, 0, 0, WHOLE)
    inside = triangles_inside(mesh, udim)
    area = _area(mesh.positions[mesh.faces[inside]].astype(np.float64))
    area_uv = _area(np.pad(mesh.triangle_uv()[inside], ((0, 0), (0, 0), (0, 1))))
    return WholeMap(udim, heights, float(np.sqrt(area / area_uv)))


def _area(corners: NDArray[np.float64]) -> float:
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _patches(
    asset: DeviceAsset,
    mesh: Mesh,
    udim: int,
    places: tuple[Place, ...],
    side: float,
    progress: Progress,
) -> list[Patch]:
    """What the patches of these places show, on one map that is drawn only where they lie."""
    inside = triangles_inside(mesh, udim)
    corners = mesh.positions[mesh.faces[inside]].astype(np.float64)
    uv = mesh.triangle_uv()[inside] - udim_origin(udim)
    surfaces = [
        surface_patch(corners, uv, Frame.of(corners[place.triangle]), side, PATCH)
        for place in places
    ]
    heights = drawn_under(asset, udim, surfaces, progress)
    named = zip("AB", places, surfaces, strict=False)
    return [Patch(name, udim, p.uv, side, surface, heights) for name, p, surface in named]


def drawn_under(
    asset: DeviceAsset, udim: int, surfaces: Sequence[SurfacePatch], progress: Progress
) -> NDArray[np.float32]:
    """(R, R) the neutral map of a UDIM, drawn only where patches read it."""
    resolution = asset.mesh.settings.resolution
    # Memory is taken by the squares that are written, not by the whole map.
    heights = np.zeros((resolution, resolution), np.float32)
    drawn = min(_DRAWN, resolution)
    squares = touched_squares(surfaces, resolution, drawn)
    for done, (row, column) in enumerate(squares):
        progress(done / len(squares), "patches")
        square = asset.drawing.to_host(NEUTRAL_FRAME, _NEUTRAL, udim, 0, row, column, drawn)
        heights[row : row + drawn, column : column + drawn] = square
    return heights


def touched_squares(
    surfaces: Sequence[SurfacePatch], resolution: int, side: int
) -> list[tuple[int, int]]:
    """Row and column of the squares of `side` texels that the patches read."""
    found: set[tuple[int, int]] = set()
    for surface in surfaces:
        u, v = surface.uv[surface.seen.covered].T
        texels = np.floor(np.stack([1 - v, u], axis=1) * resolution - 0.5)
        # A spline reads from one texel before to two after.
        for shift in itertools.product((-1, 2), repeat=2):
            squares = np.clip(texels + shift, 0, resolution - 1).astype(np.int64) // side * side
            found |= {(int(row), int(column)) for row, column in np.unique(squares, axis=0)}
    return sorted(found)
