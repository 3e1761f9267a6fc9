"""Heights on both sides of UV seams, read from the maps that the service makes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.ndimage import map_coordinates

from rhytid.baking.assets import build
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.engine.engine import Engine
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.settings import ServiceSettings
from synthesis.seam_places import SeamPlaces

INTERPOLATIONS = {"bilinear": 1, "cubic": 3}
PRESETS = {"usual look": "best", "preset paper": "paper"}
Heights = tuple[np.ndarray, np.ndarray]


def seam_maps(
    mesh: Mesh, graph: WrinkleGraph, moved: np.ndarray, found: SeamPlaces, resolution: int
) -> Iterator[tuple[str, Heights]]:
    """Names and heights on both sides, in depths.  moved: (V, 3) positions of a frame."""
    unit = "cm" if graph.origin is None or graph.origin.unit is None else graph.origin.unit
    for look, preset in PRESETS.items():
        settings = AssetSettings.parse({"resolution": resolution, "preset": preset, "unit": unit})
        with TemporaryDirectory() as store:
            service = replace(ServiceSettings.from_environment(), store=Path(store))
            engine = Engine(service)
            try:
                asset = build(engine, NewAsset(mesh, settings, graph)).id
                engine.frames.put(asset, "moved", moved)
                depth = engine.assets.info(asset).settings["depth"]
                for method in ("redraw", "binned"):
                    for frame in ("neutral", "moved"):
                        read = _read(engine, asset, frame, MapQuery(method), found)
                        for how, heights in read:
                            name = f"{resolution}, {method}, {look}, {frame}, {how}"
                            yield name, tuple(side / depth for side in heights)
            finally:
                engine.close()


def _read(
    engine: Engine, asset: str, frame: str, query: MapQuery, found: SeamPlaces
) -> Iterator[tuple[str, Heights]]:
    sides = found.here, found.there
    heights = {how: tuple(np.zeros(len(uv)) for uv in sides) for how in INTERPOLATIONS}
    for udim in engine.assets.info(asset).udims:
        field = engine.tiles.plan_map(asset, frame, query, udim, 0).draw()
        for i, uv in enumerate(sides):
            local = uv - udim_origin(udim)
            mine = np.flatnonzero(((local >= 0) & (local < 1)).all(axis=1))
            for how, order in INTERPOLATIONS.items():
                heights[how][i][mine] = between(field, local[mine], order)
    yield from heights.items()


def between(field: np.ndarray, uv: np.ndarray, order: int) -> np.ndarray:
    """(P,) heights at places (P, 2) of a map."""
    side = len(field)
    rows, columns = (1 - uv[:, 1]) * side - 0.5, uv[:, 0] * side - 0.5
    return map_coordinates(field, [rows, columns], order=order, mode="nearest", output=np.float64)
