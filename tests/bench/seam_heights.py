"""How much heights differ on the two sides of the UV seams of a mesh:

    python tests/bench/seam_heights.py MESH GRAPH.safetensors [--maps 4096 8192] [--worst 20]

Exact heights are float64, of the reference: of straight lines, and of lines that bend and taper as
the usual look has them; on the neutral mesh and on one that is stretched and waved by a formula, by
up to a third. With --maps the service draws the same by `redraw` and `binned`, in the usual look
and with the preset `paper`, at these resolutions; the maps are read at both sides of the seam by
bilinear and by cubic interpolation. Exact heights at the centres of texels, read in the same way,
tell what of the difference is that furrows are as narrow as texels.

Places stand a third of a pore spacing apart on the seam. Counted are those that no rule leaves out:

corner     within two spacings charts bend by angles that differ by more than 20 degrees, or the
           seam ends
texel      a spacing is less than a texel of a map of 4096² on one of the sides
slit       the two sides are less than such a texel apart: one texel shows both
crumpled   within a spacing the metric of the UV changes more than fourfold on one of the sides: no
           affine copy of a wrinkle is as wide along all of the seam that it reaches over

Figures: share of the seam that is counted; rms of the difference over rms of the heights; within:
share of it that differs by less than 0.01 of depth; median difference in depths. They are told
after each rule. --worst tells the places that differ most after all rules, straight and neutral,
and what differs there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.seam_maps import seam_maps
from bench.seam_worst import worst_places
from reference import bends, redraw
from reference.drawing import Pores, Wrinkles
from reference.inputs import Shape
from reference.response import on_surface, scales, wrinkle_stretch
from rhytid.baking.input_files import graph_file, mesh_file
from rhytid.domain.asset_settings import ResponseSettings, ShapeSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.spacing import mean_spacing
from rhytid.synthesis.surface import Surface
from synthesis.seam_change import MetricChange
from synthesis.seam_places import SeamPlaces, seam_places

TEXELS = 4096
CHANGE = 4.0
FIRST = "straight, neutral"
RULES = ("corner", "texel", "slit", "crumpled")
Heights = tuple[np.ndarray, np.ndarray]
Drawing = Callable[[np.ndarray], np.ndarray]


class Seam(NamedTuple):
    """Places on the seams of a mesh, and (4, P) what each of RULES leaves."""

    places: SeamPlaces
    kept: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, spacing: float) -> Seam:
        found = seam_places(mesh, Surface.of(mesh).carries, 0.3 * spacing, np.radians(20))
        sides = found.here, found.there
        texels = np.min([_texels(uv, found.weight, spacing) for uv in sides], 0)
        gap = TEXELS * np.linalg.norm(found.here - found.there, axis=1)
        change = MetricChange(mesh)
        most = [
            max(change.around(t, place, spacing) for t in both)
            for place, both in zip(found.position, found.triangles, strict=True)
        ]
        rules = found.corner > 2 * spacing, texels > 1, gap >= 1, np.array(most) <= CHANGE
        return cls(found, np.logical_and.accumulate(rules))

    def figures(self, heights: Heights, kept: np.ndarray) -> dict[str, float]:
        weight, total = self.places.weight[kept], self.places.weight.sum()
        one, gap = heights[0][kept], np.abs(heights[0] - heights[1])[kept]
        return {
            "share": float(weight.sum() / total),
            "rms": float(np.sqrt((gap**2 @ weight) / (one**2 @ weight))),
            "within": float(weight @ (gap < 0.01) / weight.sum()),
            "median": float(np.median(gap)),
        }


def moved(mesh: Mesh) -> np.ndarray:
    """(V, 3) positions stretched along the axes and waved."""
    middle = 0.5 * (mesh.positions.max(axis=0) + mesh.positions.min(axis=0))
    size = float(np.ptp(mesh.positions, axis=0).max())
    p = (mesh.positions.astype(float) - middle) / size
    wave = 0.015 * np.sin(13 * p[:, [1]] + 1) * np.cos(9 * p[:, [0]] + 11 * p[:, [2]])
    found = p * [1.15, 0.9, 1.05] + wave * [0.6, 1.0, 0.8]
    return (found * size + middle).astype(np.float32)


def drawings(mesh: Mesh, graph: WrinkleGraph, found: SeamPlaces) -> Iterator[tuple[str, Drawing]]:
    """Names, and what tells the heights in depths at places near those of the seam."""
    sides = np.concatenate([found.here, found.there])
    plain = ResponseSettings(ends=0.0, soft_limits=False)
    for frame, positions in (("neutral", mesh.positions), ("moved", moved(mesh))):
        lines, pores = _stretches(mesh, graph, positions)
        wide, deep = scales(lines, plain.alpha_w, plain.alpha_d)
        straight = redraw.wrinkles(graph, wide, deep)
        discs = redraw.pores(graph, *scales(pores, plain.beta_w, plain.beta_d))
        yield f"straight, {frame}", _drawing(_near(straight, sides), discs, Shape())
        usual, shape = ResponseSettings(), ShapeSettings()
        bent = bends.lines(graph, lines, usual, shape, 0.0, (0.0, 0.0))
        discs = bends.discs(graph, pores, usual, shape, 0.0)
        yield f"usual lines, {frame}", _drawing(_near(bent, sides), discs, shape)


def _drawing(lines: Wrinkles, discs: Pores, shape: Any) -> Drawing:
    return lambda uv: redraw.draw(uv, lines, discs, shape, 1.0)


def sampled(draw: Drawing, uv: np.ndarray, resolution: int) -> np.ndarray:
    """(P,) heights at places (P, 2) by bilinear interpolation of those at the centres of texels."""
    place = uv * resolution - 0.5
    first = np.floor(place)
    share = place - first
    found = np.zeros(len(uv))
    for i, j in np.ndindex(2, 2):
        weight = np.abs(1 - i - share[:, 0]) * np.abs(1 - j - share[:, 1])
        found += weight * draw((first + [i, j] + 0.5) / resolution)
    return found


def _near(lines: Wrinkles, uv: np.ndarray) -> Wrinkles:
    """Those that may reach one of the places: of most the boxes around their arcs take long."""
    length = np.linalg.norm(np.diff(lines.segments, axis=1)[:, 0], axis=1)
    width = lines.half_width.reshape(len(length), -1).max(axis=1)
    if lines.metric is not None:
        least = np.linalg.eigvalsh(lines.metric[:, [0, 1, 1, 2]].reshape(-1, 2, 2))[:, 0]
        width = np.where(least > 0, width / np.sqrt(np.where(least > 0, least, 1.0)), width)
    away, _ = cKDTree(uv).query(lines.segments.mean(axis=1))
    # An arc is less than a chord aside, which in UV may be as much longer as the widest is.
    near = np.flatnonzero(away <= 2 * length + 8 * width)
    return lines._replace(
        **{
            name: values[near]
            for name, values in lines._asdict().items()
            if isinstance(values, np.ndarray)
        }
    )


def _stretches(mesh: Mesh, graph: WrinkleGraph, positions: np.ndarray) -> Heights:
    """(M,) and (N,) log stretch of wrinkles and pores: copies take that of their originals."""
    from pipeline.scenes import reference_stretch
    from reference import stretch

    ratios, axes = reference_stretch(mesh, positions)
    logs = stretch.log_stretch(ratios, ResponseSettings().log_stretch_limit)
    at = graph.edge_triangle
    _, r = np.linalg.qr(Surface.of(mesh).jacobian[at])
    ways = on_surface(r, redraw.directions(graph))
    lines = wrinkle_stretch(logs[at], on_surface(r[:, None], axes[at]), ways)
    edges, nodes = (
        np.where(copy_of < 0, np.arange(len(copy_of)), copy_of)
        for copy_of in (graph.edge_copy_of, graph.node_copy_of)
    )
    return lines[edges], logs[graph.node_triangle].mean(axis=-1)[nodes]


def _texels(uv: np.ndarray, weight: np.ndarray, spacing: float) -> np.ndarray:
    """(P,) texels to a pore spacing along the seam, from the nearer neighbour on it."""
    step = np.linalg.norm(np.diff(uv, axis=0), axis=1)
    nearer = np.minimum(np.append(step, np.inf), np.insert(step, 0, np.inf))
    return TEXELS * spacing * nearer / weight


def _tell(name: str, seam: Seam, heights: Heights, each: bool) -> None:
    for rule, kept in zip(RULES, seam.kept, strict=True):
        if each or rule == RULES[-1]:
            figures = seam.figures(heights, kept)
            told = "  ".join(f"{key} {value:.5f}" for key, value in figures.items())
            sys.stdout.write(f"{name + (f', less {rule}' if each else ''):56} {told}\n")


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.partition("\n")[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("graph", type=Path)
    parser.add_argument("--maps", type=int, nargs="*", default=[], metavar="R")
    parser.add_argument("--worst", type=int, default=0, metavar="N")
    given = parser.parse_args()
    mesh, graph = mesh_file(given.mesh).mesh, graph_file(given.graph)
    assert graph.node_triangle is not None
    spacing = mean_spacing(mesh, graph, graph.node_triangle)
    seam = Seam.of(mesh, spacing)
    sides = seam.places.here, seam.places.there
    for name, draw in drawings(mesh, graph, seam.places):
        first, heights = name == FIRST, (draw(sides[0]), draw(sides[1]))
        _tell(f"exact, {name}", seam, heights, each=first)
        if first and given.worst:
            sys.stdout.writelines(worst_places(graph, seam, heights, given.worst))
        for resolution in given.maps if first else ():
            heights = (sampled(draw, sides[0], resolution), sampled(draw, sides[1], resolution))
            _tell(f"{resolution}, exact in texels, {name}, bilinear", seam, heights, each=False)
    for resolution in given.maps:
        for name, heights in seam_maps(mesh, graph, moved(mesh), seam.places, resolution):
            _tell(name, seam, heights, each=False)


if __name__ == "__main__":
    main()
