"""The picture that `--preview` writes: the skin of a graph, drawn on a device."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import busiest_udim, mesh_udims, triangles_inside, udim_origin
from rhytid.domain.units import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.engine.resident import ResidentAsset
from rhytid.errors import MeshError
from rhytid.pictures.places import Place, flat_places
from rhytid.pictures.preview import WHOLE, Patch, WholeMap, preview
from rhytid.pipeline.elements import BLOCK

PATCH_MM = 20.0
MOST_UDIMS = 4
# Texels between two pores, at least, as far as maps go.
_DENSITY = 16.0
_RESOLUTIONS: list[int] = [2**n for n in range(10, 15)]
_NEUTRAL = MapQuery("neutral")


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
    settings = settings.changed({"resolution": _resolution(places, spacing)})
    with _resident(device, mesh, graph, settings) as asset:
        udims = sorted({udim, *mesh_udims(mesh)[:MOST_UDIMS]})
        maps = [_whole(asset, mesh, u) for u in udims[:MOST_UDIMS]]
        named = zip("AB", places, strict=False)
        patches = [_patch(asset, name, udim, place, side) for name, place in named]
    caption = (
        f"{graph.counts()[1]} wrinkles, pores {spacing * unit_mm:.3g} mm apart, drawn at "
        f"{settings.resolution} x {settings.resolution} texels. Whole maps are means of many "
        "texels, their relief exaggerated; patches are true to scale."
    )
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


def _resolution(places: tuple[Place, ...], spacing: float) -> int:
    """Enough texels for pores in the patches."""
    uv_lengths = [float(np.sqrt(abs(np.linalg.det(place.to_uv)))) for place in places]
    wanted = _DENSITY / (spacing * min(uv_lengths, default=np.inf))
    return next((r for r in _RESOLUTIONS if r >= wanted), _RESOLUTIONS[-1])


@contextmanager
def _resident(
    device: Device, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings
) -> Iterator[ResidentAsset]:
    with device.task():
        asset = ResidentAsset(device, mesh, settings)
        try:
            asset.locate(graph)
            asset.install(asset.prepare(graph, settings), settings)
            yield asset
        finally:
            asset.release()


def _whole(asset: ResidentAsset, mesh: Mesh, udim: int) -> WholeMap:
    level = asset.settings.grid.levels - WHOLE.bit_length()
    heights = asset.drawn(NEUTRAL_FRAME, _NEUTRAL, udim, level, 0, 0, WHOLE)
    inside = triangles_inside(mesh, udim)
    area = _area(mesh.positions[mesh.faces[inside]].astype(np.float64))
    area_uv = _area(np.pad(mesh.triangle_uv()[inside], ((0, 0), (0, 0), (0, 1))))
    return WholeMap(udim, heights, float(np.sqrt(area / area_uv)))


def _area(corners: NDArray[np.float64]) -> float:
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _patch(asset: ResidentAsset, name: str, udim: int, place: Place, side: float) -> Patch:
    """The square of whole blocks around a place that holds its patch."""
    resolution = asset.settings.resolution
    reach = 0.5 * side * np.abs(place.to_uv).sum(axis=1) * resolution + 2.0
    low = np.array([place.uv[0], 1.0 - place.uv[1]]) * resolution - reach
    column, row = (int(max(x, 0.0)) // BLOCK for x in low)
    blocks = min(2 + int(2 * reach.max()) // BLOCK, resolution // BLOCK)
    column, row = (BLOCK * min(i, resolution // BLOCK - blocks) for i in (column, row))
    heights = asset.drawn(NEUTRAL_FRAME, _NEUTRAL, udim, 0, row, column, BLOCK * blocks)
    corner = np.array([column, resolution - row - BLOCK * blocks]) / resolution
    return Patch(name, udim, place, side, heights, corner, 1.0 / resolution)
