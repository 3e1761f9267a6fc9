"""Sheets and tubes with UV layouts made by rule, for tests of synthesis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.synthesis.edges import Edges, candidates
from rhytid.synthesis.pores import scatter_pores
from rhytid.synthesis.progress import silent
from rhytid.synthesis.seams.charts import neighbours
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.workspace import Workspace

Floats = NDArray[np.float64]
Layout = Callable[[Floats], Floats]


def even(xy: Floats) -> Floats:
    """The unit square in the middle of tile 1001."""
    return 0.1 + 0.8 * xy


def uneven(xy: Floats) -> Floats:
    """UV density varies 20-fold along x, and v is squeezed to a third."""
    x, y = xy.T
    return np.stack([0.05 + 0.9 * (0.1 * x + 0.9 * x**3), 0.1 + 0.3 * y], axis=-1)


def sheet(layout: Layout = even, n: int = 24, scale: float = 1.0) -> Mesh:
    """The square from 0 to `scale`, facing +z, of 2n² triangles."""
    xy = _lattice(n)
    positions = np.concatenate([xy, np.zeros((len(xy), 1))], axis=1) * scale
    faces = _quads(n)
    return Mesh(positions.astype(np.float32), faces, layout(xy), faces)


def with_hole(n: int = 24) -> Mesh:
    """A sheet without its middle ninth."""
    whole = sheet(n=n)
    centre = whole.positions[whole.faces].mean(axis=1)[:, :2]
    rim = (np.abs(centre - 0.5) > 1 / 6).any(axis=1)
    return Mesh(whole.positions, whole.faces[rim], whole.uv, whole.face_uv[rim])


def face_to_face(gap: float = 1e-4) -> Mesh:
    """Two sheets that all but touch, with the outsides facing each other, in two charts."""
    lower = sheet(lambda xy: 0.05 + 0.4 * xy)
    above = lower.positions + np.float32([0, 0, gap])
    faces = np.concatenate([lower.faces, lower.faces[:, ::-1] + len(above)])
    uv = np.concatenate([lower.uv, lower.uv[:, ::-1] + [0.5, 0.5]])
    return Mesh(np.concatenate([lower.positions, above]), faces, uv, faces)


def tube(n: int = 24) -> Mesh:
    """A tube around the y axis, cut open in UV along one line: u = 0.1 there, and u = 0.9."""
    angle, height = (_lattice(n) * [2 * np.pi, 1]).T
    positions = np.stack([np.cos(angle), np.pi * height, -np.sin(angle)], axis=-1)
    columns = np.arange((n + 1) ** 2) % (n + 1)
    joined = np.where(columns == n, np.arange((n + 1) ** 2) - n, np.arange((n + 1) ** 2))
    faces = _quads(n)
    return Mesh(positions.astype(np.float32), joined[faces], even(_lattice(n)), faces)


def places(surface: Surface, graph: WrinkleGraph) -> Floats:
    """(N, 3) where the nodes of a graph are on the surface."""
    assert graph.node_triangle is not None
    return surface.place(graph.node_triangle.astype(np.int64), graph.node_uv.astype(np.float64))


def wanted(count: int, seed: int = 1) -> GraphSettings:
    """Settings for `count` wrinkles, and pores alone."""
    return GraphSettings(wrinkles=count, seed=seed, events=0.0)


def scattered(device: Device, mesh: Mesh, radius: float, seed: int = 3) -> Points:
    """Pores on a mesh."""
    with Workspace(device) as work:
        return scatter_pores(work, Surface.of(mesh), radius, seed, silent)


def net(
    device: Device, mesh: Mesh, radius: float, seed: int = 3, count: int = 8
) -> tuple[Points, Edges]:
    """Pores on a mesh and the candidates among their `count` nearest."""
    pores, surface = scattered(device, mesh, radius, seed), Surface.of(mesh)
    with Workspace(device) as work:
        found, _ = candidates(work, surface, neighbours(mesh), pores, radius, count, silent)
    return pores, found


def _lattice(n: int) -> Floats:
    x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
    return np.stack([x, y], axis=-1).reshape(-1, 2)


def _quads(n: int) -> NDArray[np.int64]:
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).reshape(-1, 1)
    lower, upper = corner + np.array([0, 1, n + 2]), corner + np.array([0, n + 2, n + 1])
    return np.stack([lower, upper], axis=1).reshape(-1, 3)
