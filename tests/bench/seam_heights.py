"""How much heights differ on the two sides of the UV seams of a mesh, in float64:

    python tests/bench/seam_heights.py MESH GRAPH.safetensors

Places stand a third of a pore spacing apart on the seam. Left out are those within two spacings of
a corner, where charts bend by angles that differ by more than 20 degrees or a seam ends, and those
where a spacing is less than a texel of a map of 4096² on one of the sides.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from reference import redraw
from reference.inputs import Shape
from rhytid.cli.input_files import graph_file, mesh_file
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.spacing import mean_spacing
from rhytid.synthesis.surface import Surface
from synthesis.seam_places import seam_places

TEXELS = 4096


def seam_figures(mesh: Mesh, graph: WrinkleGraph, spacing: float) -> dict[str, float]:
    """share: of the seam that is compared.  rms: of the difference over that of the heights.
    within: share of places that differ by less than 0.01 of depth.  median: difference, depths."""
    found = seam_places(mesh, Surface.of(mesh).carries, 0.3 * spacing, np.radians(20))
    both = np.concatenate([found.here, found.there])
    heights = redraw.neutral(both, graph, Shape(), 1.0).reshape(2, -1)
    texels = np.min([_texels(uv, found.weight, spacing) for uv in (found.here, found.there)], 0)
    kept = (found.corner > 2 * spacing) & (texels > 1)
    weight = found.weight[kept]
    gap = np.abs(heights[0] - heights[1])[kept]
    total = weight.sum()
    return {
        "share": float(total / found.weight.sum()),
        "rms": float(np.sqrt((gap**2 @ weight) / (heights[0][kept] ** 2 @ weight))),
        "within": float(weight @ (gap < 0.01) / total),
        "median": float(np.median(gap)),
    }


def _texels(uv: np.ndarray, weight: np.ndarray, spacing: float) -> np.ndarray:
    """(P,) texels to a pore spacing along the seam, from the nearer neighbour on it."""
    step = np.linalg.norm(np.diff(uv, axis=0), axis=1)
    nearer = np.minimum(np.append(step, np.inf), np.insert(step, 0, np.inf))
    return TEXELS * spacing * nearer / weight


if __name__ == "__main__":
    mesh, graph = mesh_file(Path(sys.argv[1])).mesh, graph_file(Path(sys.argv[2]))
    assert graph.node_triangle is not None
    figures = seam_figures(mesh, graph, mean_spacing(mesh, graph, graph.node_triangle))
    sys.stdout.write(f"{figures}\n")
