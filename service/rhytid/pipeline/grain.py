"""Relief between the lines, fine grain and broad undulation: noise of the neutral surface, the same
on both sides of a seam.
Kernels: grain_codes.cl, grain.cl, grain_smooth.cl.

Its codes are made once per tile and kept; a frame only scales them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.patch_noise import CELLS as PATCH_CELLS
from rhytid.domain.patch_noise import (
    DEVIATION,
    GRAIN_SALT,
    LEAST,
    MOST_DEVIATION,
    STRENGTH_SALT,
    cell_size,
    placement,
    table,
)
from rhytid.domain.skin import COARSE
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.nearby import Groups
from rhytid.pipeline.reach import response_defines
from rhytid.pipeline.smooth import SmoothFields
from rhytid.pipeline.stiffness import stiffness_of_texels
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.vectors import VECTOR, VectorTriangles

# Of the noise to a wave, as grain_codes.cl has it.
CELLS = 2.0
# How its layer of codes is called.
GRAIN = "grain"
# Codes for the root mean square of the noise where texels carry all of it; the same where swells
# differ by region or patch, and how many times as high as on even skin these are at most.
CODES, UNEVEN_CODES, MOST_UNDULATION = 32.0, 16.0, 2.6
# Of even skin, at the corners of a triangle: factor of the grain, patchiness.
_EVEN = np.array([1.0] * 6 + [0.0] * 3, np.float32)
# How many edges from a pore on its value is carried over vertices without any; beyond, the mean.
_CARRIED = 64


@dataclass(frozen=True)
class GrainPlace(BufferGroup):
    """A square of `side`² texels of level 0 from (row, column) on, with the triangles of its
    texels.

    stiffness: float32 of each texel, or None: 1 throughout.
    """

    row: int
    column: int
    side: int
    triangles: VectorTriangles
    stiffness: Buffer | None = None

    @property
    def _buffers(self) -> tuple[VectorTriangles | Buffer | None, ...]:
        return (self.triangles, self.stiffness)


class GrainPlanes(BufferGroup):
    """Where in space the texels of each triangle are, in cells of the noise, and how rough they
    are.

    settings: resolved.  shares: the result of `relief_shares`; None: even skin.
    middle: (3,) of the mesh, where the noise begins.  cell: of the noise, mesh units.  table: the
    noise of patches, None on even skin.  wave: the longest of patches, where the graph says it.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        settings: AssetSettings,
        shares: NDArray[np.float32] | None = None,
        wave: float | None = None,
    ) -> None:
        assert settings.shape.grain_size is not None
        self._wave = wave
        self.middle, self.cell = _middle(mesh), settings.shape.grain_size / CELLS
        planes = _planes(mesh, self.middle, self.cell)
        if shares is None:
            shares = np.tile(_EVEN, (len(planes), 1))
        self.values = device.upload(np.concatenate([planes, shares], axis=1))
        self.table = device.upload(table()) if shares[:, 6:].any() else None

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return self.values, self.table

    def patches(self, settings: AssetSettings) -> NDArray[np.float32]:
        """(2, 3, 4) where in the table of patches places of the planes are, of the grain and of the
        undulation: rows as of `placement`."""
        cell = cell_size(settings, self._wave)
        seed = settings.graph.start
        found = np.array([placement(seed, salt) for salt in (GRAIN_SALT, STRENGTH_SALT)])
        found[..., 3] += found[..., :3] @ (self.middle / cell)
        found[..., :3] *= self.cell / cell
        return found.astype(np.float32)


def grain_codes(
    device: Device, planes: GrainPlanes, located: UdimTriangles, settings: AssetSettings,
    square: tuple[int, int, int],
) -> Buffer:  # fmt: skip
    """The code, int8, of each texel of a square (row, column, texels per side) of level 0.

    settings: resolved, with a relief above 0.
    """
    row, column, side = square
    triangles = located.texels(settings.resolution, row, column, side)
    codes = device.empty(side * side, np.int8)
    patches = device.upload(planes.patches(settings))
    device.launch(
        "grain_codes", "grain_codes", (side * side,),
        triangles, located.none, located.corners, planes.values, np.int32(side),
        np.int32(settings.resolution), np.int32(row), np.int32(column),
        np.uint32(settings.graph.start), *_shares(settings), planes.table, patches,
        np.array([DEVIATION, MOST_DEVIATION], np.float32), np.float32(_codes(settings)), codes,
        defines={
            "PATCH_CELLS": PATCH_CELLS, "PATCH_LEAST": f"{LEAST}f",
            "MOST_UNDULATION": f"{MOST_UNDULATION}f",
        },
    )  # fmt: skip
    device.finish()
    patches.release()
    triangles.release()
    return codes


def grain_place(
    device: Device, located: UdimTriangles, settings: AssetSettings, stiffness: Stiffness | None,
    square: tuple[int, int, int],
) -> GrainPlace:  # fmt: skip
    """The GrainPlace of a square (row, column, texels per side) of level 0, which no frame
    changes."""
    row, column, side = square
    triangles = located.texels(settings.resolution, row, column, side)
    vectors = VectorTriangles.of(device, triangles, side * side)
    triangles.release()
    stiff = stiffness_of_texels(
        device, stiffness, located.udim, settings.resolution, row, column, side
    )
    return GrainPlace(row, column, side, vectors, stiff)


def grain_amplitude(settings: AssetSettings) -> float:
    """Displacement of one code in the neutral, mesh units."""
    assert settings.depth is not None
    return relief(settings) * settings.depth / _codes(settings)


def _codes(settings: AssetSettings) -> float:
    """Codes for the root mean square of even skin."""
    graph = settings.graph
    return CODES if graph.anatomy == COARSE and graph.patches == 0.0 else UNEVEN_CODES


def relief(settings: AssetSettings) -> float:
    """Root mean square of grain and undulation together, depths; 0 where there is none."""
    return math.hypot(settings.shape.grain, settings.shape.undulation)


def _shares(settings: AssetSettings) -> tuple[np.float32, NDArray[np.float32]]:
    """The ratio of the wavelengths of grain and undulation, and the share of each in the relief."""
    shape = settings.shape
    finer = 1.0
    if shape.undulation > 0.0:
        assert shape.grain_size is not None
        assert shape.undulation_size is not None
        finer = shape.grain_size / shape.undulation_size
    shares = np.array([shape.grain, shape.undulation]) / relief(settings)
    return np.float32(finer), shares.astype(np.float32)


def grain_exponent(settings: AssetSettings) -> float:
    """The exponent of the stretch ratio along either axis: half of that of the depth of
    wrinkles."""
    return settings.response.alpha_d / 2


def fill_gains(
    device: Device, settings: AssetSettings, stretch: StretchBuffers, gains: Buffer,
    wanted: Groups | None,
) -> None:  # fmt: skip
    """Fill float32 gains: factors of the grain of the neutral, in some triangles; None: in all."""
    groups, exponent = wanted or Groups.of(stretch.count), np.float32(grain_exponent(settings))
    device.launch(
        "grain", "grain_gains", (groups.items,),
        groups.numbers, stretch.logs, exponent, np.int32(stretch.count), gains,
        defines=response_defines(settings.response.soft_limits),
    )  # fmt: skip


def tiles_of_square(row: int, column: int, side: int, tile: int) -> list[tuple[int, int]]:
    """(row, column) of the tiles of `tile`² texels that a square of level 0 overlaps."""
    rows, columns = (range(at // tile * tile, at + side, tile) for at in (row, column))
    return list(product(rows, columns))


@dataclass(frozen=True)
class Grain:
    """The grain of a frame, ready to be added to what is drawn.

    fields: where every texel has a stretch of its own (smooth sampling), else None."""

    device: Device
    settings: AssetSettings
    located: UdimTriangles
    stretch: StretchBuffers
    gains: Buffer
    fields: SmoothFields | None = None

    def add(
        self, out: Buffer, square: tuple[int, int, int], tile: GrainPlace, codes: Buffer
    ) -> None:
        """Add grain to the part of a square (row, column, texels per side) of level 0 that lies in
        a tile.

        out: side² float32 of the square, mesh units; more may follow.  codes: of the tile.
        """
        row, column, side = square
        top, left = max(row, tile.row), max(column, tile.column)
        height = min(row + side, tile.row + tile.side) - top
        width = min(column + side, tile.column + tile.side) - left
        first = (top - tile.row) * tile.side + left - tile.column
        to = (top - row) * side + left - column
        settings = self.settings
        assert settings.depth is not None
        last = (
            np.float32(grain_exponent(settings)), np.float32(grain_amplitude(settings)),
            np.float32(settings.depth),
            np.int32(tile.side), np.int32(first), np.int32(side), np.int32(to), out,
        )  # fmt: skip
        texels = (tile.triangles.firsts, tile.triangles.members, codes, tile.stiffness)
        size = (width // VECTOR, height)
        if self.fields is None:
            self.device.launch(
                "grain", "add_grain", size, *texels, self.gains, self.stretch.logs, *last,
                defines={
                    **response_defines(settings.response.soft_limits), **self.device.ahead_defines,
                },
            )  # fmt: skip
            return
        place = (settings.resolution, tile.row, tile.column)
        self.device.launch(
            "grain_smooth", "add_smooth_grain", size, *texels,
            *self.fields.arguments(self.located), *(np.int32(at) for at in place), *last,
            defines=response_defines(settings.response.soft_limits),
        )  # fmt: skip


def _middle(mesh: Mesh) -> NDArray[np.float64]:
    """(3,) the middle of the box around a mesh."""
    places = mesh.positions.astype(np.float64)
    middle: NDArray[np.float64] = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return middle


def _planes(mesh: Mesh, middle: NDArray[np.float64], size: float) -> NDArray[np.float32]:
    """(F, 10): of each triangle the place of its first corner from the middle of the mesh, ∂X/∂u,
    ∂X/∂v, and the longest step of a unit of UV, all over `size`; 0 where it has no area in UV."""
    used = np.flatnonzero(mesh.triangles_with_uv())
    places = mesh.positions.astype(np.float64)
    uv, corners = mesh.triangle_uv()[used], (places[mesh.faces[used]] - middle) / size
    edges, edges_uv = (np.swapaxes(c[:, 1:] - c[:, :1], 1, 2) for c in (corners, uv))
    jacobians = edges @ np.linalg.inv(edges_uv)
    longest = np.linalg.svd(jacobians, compute_uv=False)[:, :1]
    found = np.zeros((len(mesh.faces), 10), np.float32)
    columns = [corners[:, 0], jacobians[:, :, 0], jacobians[:, :, 1], longest]
    found[used] = np.clip(np.concatenate(columns, axis=1), -1e37, 1e37)
    return found


def relief_shares(
    mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.integer]
) -> NDArray[np.float32] | None:
    """(F, 9) at the corners of each triangle, three each, the factors of the grain and of the
    undulation, and the patchiness; None where the graph has none of them.

    triangle: (N,) of each node, F for none. A vertex takes the mean of the pores on its triangles,
    so that there is no step at seams or edges; where there are none, that of its neighbours.
    """
    given = graph.node_grain, graph.node_undulation, graph.node_patchiness
    if all(values is None for values in given):
        return None
    own = np.flatnonzero(graph.own_nodes & (triangle >= 0) & (triangle < len(mesh.faces)))
    found = np.tile(_EVEN, (len(mesh.faces), 1))
    for first, values in zip((0, 3, 6), given, strict=True):
        if values is not None:
            found[:, first : first + 3] = _at_corners(mesh, triangle[own], values[own])
    return found


def _at_corners(
    mesh: Mesh, triangle: NDArray[np.integer], given: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(F, 3) values at the corners of triangles from those of pores (N,)."""
    vertices, values = mesh.faces[triangle], given.astype(np.float64)
    total, count = (
        np.bincount(vertices.ravel(), weights, len(mesh.positions)).astype(np.float64)
        for weights in (np.repeat(values, 3), None)
    )
    if not count.any():
        return np.ones((len(mesh.faces), 3), np.float32)
    found = np.divide(total, count, out=np.zeros_like(total), where=count > 0)
    _carry(mesh, found, count > 0)
    return found[mesh.faces].astype(np.float32)


def _carry(mesh: Mesh, values: NDArray[np.float64], known: NDArray[np.bool_]) -> None:
    """Give vertices without a value the mean of those around them, in place, from known vertices
    outwards."""
    mean = float(values[known].mean())
    one, two = mesh.faces.ravel(), np.roll(mesh.faces, 1, axis=1).ravel()
    to, of = np.concatenate([one, two]), np.concatenate([two, one])
    for _ in range(_CARRIED):
        reached = known[of] & ~known[to]
        if not reached.any():
            break
        count = np.bincount(to[reached], None, len(values))
        total = np.bincount(to[reached], values[of[reached]], len(values))
        fresh = count > 0
        values[fresh] = total[fresh] / count[fresh]
        known |= fresh
    values[~known] = mean
