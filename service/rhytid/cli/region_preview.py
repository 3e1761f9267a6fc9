"""The picture of the regions of a face that `--preview` writes beside its own, by age."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rhytid.cli.preview import drawn_under, resident, resolution_for
from rhytid.cli.progress import share_bar
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import busiest_udim, triangles_inside, udim_origin
from rhytid.pictures.preview import LIGHTS, RegionView, patch_panel, region_views
from rhytid.pictures.sheet import Panel, sheet
from rhytid.support.atomic_files import atomic_write

SIDE_MM = 8.0
_PIXELS = 400


@dataclass(frozen=True, eq=False)
class AgedSkin:
    """The skin of an age.  settings: unit and lengths that it is drawn with.  spacing: of its
    pores, mesh units."""

    age: float
    graph: WrinkleGraph
    settings: AssetSettings
    spacing: float


def write_region_sheet(
    device: Device, mesh: Mesh, folds: Folds, skins: Iterable[AgedSkin], file: Path
) -> None:
    """Patches of all regions that folds have masks of, two rows for each skin, into a PNG;
    nothing where no region lies in the UDIM with most triangles."""
    udim, rows = busiest_udim(mesh), []
    views: list[RegionView] = []
    for skin in skins:
        unit_mm = millimetres(skin.settings.length_unit) or MILLIMETRES[USUAL_UNIT]
        views = views or skin_views(mesh, folds, udim, SIDE_MM / unit_mm)
        if not views:
            return
        rows += _rows(device, mesh, udim, views, skin)
    caption = (
        f"Regions as masks of named expressions have them, {SIDE_MM:g} mm wide, seen on the "
        "surface along its normal, true to scale; light from the upper left, at 45° and grazing."
    )
    with atomic_write(file) as aside:
        sheet(rows, caption).save(aside, format="png")


def skin_views(mesh: Mesh, folds: Folds, udim: int, side: float) -> list[RegionView]:
    """Where each region of a face is looked at: patches of `side` mesh units."""
    inside = triangles_inside(mesh, udim)
    faces = mesh.faces[inside]
    size, eccentricity, _ = folds.axes()
    return region_views(
        mesh.positions[faces].astype(np.float64),
        mesh.triangle_uv()[inside] - udim_origin(udim),
        {name: mask[faces].mean(axis=1) for name, mask in folds.regions.items()},
        (size * eccentricity)[faces].mean(axis=1),
        side,
        _PIXELS,
    )


def _rows(
    device: Device, mesh: Mesh, udim: int, views: list[RegionView], skin: AgedSkin
) -> list[list[Panel]]:
    resolution = resolution_for([view.scale for view in views], skin.spacing)
    settings = skin.settings.changed({"resolution": resolution})
    with (
        share_bar(f"regions, age {skin.age:g}") as show,
        resident(device, mesh, skin.graph, settings) as asset,
    ):
        heights = drawn_under(asset, udim, [view.surface for view in views], show)
    return [
        [
            patch_panel(
                f"{view.region.replace('_', ' ')}, {skin.age:g} years, {light:g}°",
                view.surface, heights, light, SIDE_MM,
            )
            for view in views
        ]
        for light in LIGHTS
    ]  # fmt: skip
