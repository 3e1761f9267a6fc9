"""Patchiness of the regions of a face, as the table and the picture of docs/skin.md have it:

    python tests/bench/patchiness.py FACE.npz OUT.jpg [--seeds 1 2 3] [--device D]

FACE.npz holds expressions of ARKit's names as `shapes`. Skin is grown with `graph.patches` 0, 1 and
2 and the default settings, and drawn at rest at 4096². In the middle 14 mm of a patch 20 mm wide of
each region, as far as there is mesh, patchiness is the coefficient of variation of the local root
mean square of heights, in windows of about 2 mm, of what is between 0.45 and 4 mm long.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rhytid.baking.input_files import mesh_file, shape_files
from rhytid.cli.preview import drawn_under, resident, skin_views
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions, Folds
from rhytid.domain.lengths import MILLIMETRES
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import busiest_udim
from rhytid.engine.engine import open_device
from rhytid.pictures.preview import RegionView, patch_panel
from rhytid.pictures.sheet import Panel, sheet
from rhytid.pipeline.folds import measured_folds
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.workspace import directly

UNIT, RESOLUTION, AMOUNTS = "cm", 4096, (0.0, 1.0, 2.0)
# Millimetres: a side of a patch, its rim that windows reach over, deviations of the Gaussians that
# bound the band and that of a window.
SIDE_MM, RIM, BAND, WINDOW = 20.0, 3.0, (0.15, 1.2), 1.0
LIGHT = 30.0
Heights = NDArray[np.float64]


def patchiness(heights: Heights, seen: NDArray[np.bool_]) -> float:
    """Of a patch (P, P), SIDE_MM wide, as far as it is seen."""
    step = SIDE_MM / len(heights)

    def smooth(values: Heights, size: float) -> Heights:
        share = gaussian_filter(seen.astype(np.float64), size / step)
        return gaussian_filter(values * seen, size / step) / np.maximum(share, 1e-9)

    fine, broad = (smooth(heights, size) for size in BAND)
    local = np.sqrt(smooth((fine - broad) ** 2, WINDOW))
    inside = (slice(round(RIM / step), -round(RIM / step)),) * 2
    found = local[inside][seen[inside]]
    return float(found.std() / found.mean())


class Face:
    """A face with the folds of its expressions, and where its regions are looked at."""

    def __init__(self, device: Device, file: Path) -> None:
        read = mesh_file(file)
        self.device, self.mesh = device, read.mesh
        self.folds = _folds(device, self.mesh, shape_files(None, read))
        self.udim = busiest_udim(self.mesh)
        side = SIDE_MM / MILLIMETRES[UNIT]
        self.views: list[RegionView] = skin_views(self.mesh, self.folds, self.udim, side)

    def drawn(self, amount: float, seed: int) -> NDArray[np.float32]:
        """(R, R) displacement under the patches, mesh units."""
        grown = {"patches": amount, "seed": seed}
        settings = AssetSettings.parse({"unit": UNIT, "graph": grown}).for_synthesis()
        made = synthesize(self.mesh, settings.graph, self.device, folds=self.folds, unit=UNIT)
        settings = settings.with_lengths(made.lengths).changed({"resolution": RESOLUTION})
        surfaces = [view.surface for view in self.views]
        with resident(self.device, self.mesh, made.graph, settings) as asset:
            return drawn_under(asset, self.udim, surfaces, lambda *_: None)


def _folds(device: Device, mesh: Mesh, expressions: Expressions | None) -> Folds:
    limit = AssetSettings().response.log_stretch_limit
    assert expressions is not None
    found = measured_folds(device, mesh, expressions, limit, UNIT, lambda *_: None, directly)
    assert found is not None
    return found


def panels(face: Face, drawn: NDArray[np.float32], amount: float) -> list[Panel]:
    """A row of the picture."""
    return [
        patch_panel(
            f"{view.region.replace('_', ' ')}, patches {amount:g}",
            view.surface, drawn, LIGHT, SIDE_MM,
        )
        for view in face.views
    ]  # fmt: skip


def main() -> None:
    """Print a line for each region, and draw the first seed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--device")
    arguments = parser.parse_args()
    face = Face(open_device(ServiceSettings(), arguments.device), arguments.face)
    rows: list[list[Panel]] = []
    found: dict[tuple[str, float], list[float]] = {}
    for amount in AMOUNTS:
        for seed in arguments.seeds:
            drawn = face.drawn(amount, seed)
            for view in face.views:
                surface = view.surface
                figure = patchiness(surface.heights(drawn), surface.seen.covered)
                found.setdefault((view.region, amount), []).append(figure)
            if seed == arguments.seeds[0]:
                rows.append(panels(face, drawn, amount))
    for view in face.views:
        figures = (np.mean(found[view.region, amount]) for amount in AMOUNTS)
        line = ", ".join(f"{value:.2f}" for value in figures)
        sys.stdout.write(f"{view.region:12} patches 0, 1, 2: {line}\n")
    caption = f"{SIDE_MM:g} mm of each region at rest, light from the upper left at {LIGHT:g}°."
    sheet(rows, caption).convert("RGB").save(arguments.out, quality=88)


if __name__ == "__main__":
    main()
