"""Roughness of the regions of a face by age, as the table of docs/skin.md has it:

    python tests/bench/roughness.py FACE.npz [--ages 20 35 65] [--wrinkles 600000] [--device D]

FACE.npz holds expressions of ARKit's names as `shapes`. Patches lie as those of
`rhytid synthesize --preview` do, are 8 mm wide, and are drawn at 8192² without undulation. Sa is
the mean distance from a plane; Rz the mean, over stretches of 1.6 mm, of the height from trough to
peak, along level profiles and along upright ones. All in micrometres. At last, where 35 is one of
the ages, the share of lines of each age that join the same two pores as at 35.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.baking.input_files import mesh_file, shape_files
from rhytid.cli.preview import drawn_under, resident, skin_views
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.lengths import millimetres
from rhytid.domain.tiles import busiest_udim
from rhytid.engine.engine import open_device
from rhytid.pipeline.folds import measured_folds
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.workspace import directly

UNIT, RESOLUTION, SIDE_MM, STRETCH_MM = "cm", 8192, 8.0, 1.6
UNCHANGED = 35.0
Heights = NDArray[np.float64]


def rough(heights: Heights) -> tuple[float, float, float]:
    """Sa, Rz along level profiles and Rz along upright ones, of stretches that are whole.
    heights: (P, P), less its plane, NaN beside the mesh."""
    count = round(SIDE_MM / STRETCH_MM)
    level = heights[:, : heights.shape[1] // count * count].reshape(len(heights), count, -1)
    upright = heights[: len(heights) // count * count].reshape(count, -1, heights.shape[1])
    return (
        float(np.nanmean(np.abs(heights))),
        float(np.nanmean(np.ptp(level, -1))),
        float(np.nanmean(np.ptp(upright, 1))),
    )


def less_plane(heights: Heights, seen: NDArray[np.bool_]) -> Heights:
    """Heights (P, P) less the plane of those seen, NaN elsewhere."""
    y, x = np.nonzero(seen)
    terms = np.column_stack([np.ones_like(x), x, y])
    plane, *_ = np.linalg.lstsq(terms, heights[seen], rcond=None)
    found = np.full(heights.shape, np.nan)
    found[seen] = heights[seen] - terms @ plane
    return found


def joined(graph: WrinkleGraph) -> set[tuple[bytes, ...]]:
    """Of each line the places of its two pores in UV."""
    own = graph.edge_nodes[graph.own_edges]
    return {tuple(sorted(place.tobytes() for place in two)) for two in graph.node_uv[own]}


def main() -> None:
    """Print a line for each region and age."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("--ages", type=float, nargs="+", default=[20, 35, 65])
    parser.add_argument("--wrinkles", type=int, default=600_000)
    parser.add_argument("--device")
    arguments = parser.parse_args()
    read = mesh_file(arguments.face)
    mesh, expressions = read.mesh, shape_files(None, read)
    device = open_device(ServiceSettings(), arguments.device)
    limit, micrometres = AssetSettings().response.log_stretch_limit, 1e3 * millimetres(UNIT)
    folds = measured_folds(device, mesh, expressions, limit, UNIT, lambda *_: None, directly)
    udim, views = busiest_udim(mesh), []
    lines = {}
    for age in arguments.ages:
        grown = AssetSettings.parse(
            {"unit": UNIT, "graph": {"wrinkles": arguments.wrinkles, "age": age}}
        ).for_synthesis()
        made = synthesize(mesh, grown.graph, device, folds=folds, unit=UNIT)
        lines[age] = joined(made.graph)
        views = views or skin_views(mesh, folds, udim, SIDE_MM * 1e3 / micrometres)
        settings = grown.with_lengths(made.lengths)
        settings = settings.changed({"resolution": RESOLUTION, "shape": {"undulation": 0.0}})
        with resident(device, mesh, made.graph, settings) as asset:
            drawn = drawn_under(asset, udim, [v.surface for v in views], lambda *_: None)
        for view in views:
            heights = view.surface.heights(drawn) * micrometres
            found = rough(less_plane(heights, view.surface.seen.covered))
            figures = ", ".join(f"{value:5.1f}" for value in found)
            sys.stdout.write(f"{view.region:12} {age:3g} years: Sa, Rz, Rz upright {figures}\n")
    for age, kept in lines.items() if UNCHANGED in lines else ():
        share = len(kept & lines[UNCHANGED]) / len(kept)
        sys.stdout.write(f"{share:.1%} of the lines at {age:g} join the same two pores as at 35\n")


if __name__ == "__main__":
    main()
