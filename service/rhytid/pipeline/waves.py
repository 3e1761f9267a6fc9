"""How wrinkles wave across their segments: the parameters of wave.clh, found once per asset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import ShapeSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_geometry import node_places, seam_halves
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.convolve import neutral_jacobians

# The largest amplitude, as a share of a wrinkle's own length, on the surface and in UV: beyond,
# short wrinkles would be loops.
LARGEST = 0.2


def wrinkle_waves(
    mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.int32], shape: ShapeSettings
) -> NDArray[np.float32] | None:
    """The waves (M, 4) float32 of every wrinkle, as in wave.clh: amplitude in uv units, waves along
    the whole wrinkle, phase in waves, share of the whole. None where all are straight.

    triangle: (M,) that each samples, the number of triangles for none: such a wrinkle is straight,
    as is one on a triangle without area. Amplitude and frequency are meant on the neutral surface;
    a shift across the wrinkle is det J / |J θ| times as long there as in UV. The phase comes from
    the row of the wrinkle. The halves of one across a seam are parts of one wave, and a copy runs
    as its original does, its amplitude in proportion to its half width.
    """
    if shape.wave_amplitude == 0.0:
        return None
    assert shape.wave_frequency is not None
    uv_length, length, density = _measured(mesh, graph, triangle)
    whole, part, row = length.copy(), np.ones(len(length)), np.arange(len(length))
    sense = np.ones(len(length))
    if len(pairs := seam_halves(mesh, graph)):
        there, back = pairs.T
        row[back] = there
        whole[pairs] = _apart(mesh, graph, pairs)[:, None]
        part[pairs] = length[pairs] / whole[pairs] * [1.0, -1.0]
        # Left on the way back is right on the way there; in mirrored UV left is right, too.
        sense[pairs] = _handed(mesh, triangle[pairs]) * [1.0, -1.0]
    shift = np.minimum(shape.wave_amplitude, LARGEST * whole) * length
    across = uv_length * density
    in_uv = np.divide(shift, across, out=np.zeros_like(shift), where=across > 0)
    columns = (
        sense * np.minimum(in_uv, LARGEST * uv_length / np.maximum(np.abs(part), 1e-6)),
        shape.wave_frequency * whole,
        _phase(row),
        part,
    )
    waves = np.stack(columns, axis=1).astype(np.float32)
    if graph.edge_copy_of is not None:
        _take_over(mesh, graph, triangle, waves)
    return waves


def _take_over(
    mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.int32], waves: NDArray[np.float32]
) -> None:
    """Give copies the waves of their originals, in place."""
    assert graph.edge_copy_of is not None
    copies = np.flatnonzero(~graph.own_edges)
    first = graph.edge_copy_of[copies]
    waves[copies] = waves[first]
    wider = graph.edge_half_width[copies] / graph.edge_half_width[first]
    mirrored = _handed(mesh, triangle[copies]) * _handed(mesh, triangle[first])
    waves[copies, 0] *= (wider * mirrored).astype(np.float32)


def _measured(
    mesh: Mesh, graph: WrinkleGraph, triangle: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(M,) lengths in UV and on the surface, and surface area per UV area."""
    ends = graph.node_uv.astype(np.float64)[graph.edge_nodes]
    step = ends[:, 1] - ends[:, 0]
    jacobian = neutral_jacobians(mesh)[triangle].reshape(-1, 2, 2).astype(np.float64)
    on_surface = np.einsum("mij,mj->mi", jacobian, step)
    density = np.abs(np.linalg.det(jacobian))
    return np.linalg.norm(step, axis=1), np.linalg.norm(on_surface, axis=1), density


def _apart(mesh: Mesh, graph: WrinkleGraph, pairs: NDArray[np.int64]) -> NDArray[np.float64]:
    """(P,) the distance between the pores of wrinkles stored as two halves."""
    one, two = (node_places(mesh, graph, graph.edge_nodes[half, 0]) for half in pairs.T)
    apart: NDArray[np.float64] = np.linalg.norm(one - two, axis=1)
    return apart


def _handed(mesh: Mesh, triangle: NDArray[np.int32]) -> NDArray[np.float64]:
    """(...) -1 where the UV of a triangle is mirrored, else 1; also 1 for no triangle."""
    index = np.minimum(triangle.ravel(), len(mesh.faces) - 1)
    a, b, c = np.moveaxis(mesh.triangle_uv()[index], 1, 0)
    u, w = b - a, c - a
    mirrored = u[:, 0] * w[:, 1] < u[:, 1] * w[:, 0]
    return np.where(mirrored, -1.0, 1.0).reshape(triangle.shape)


def _phase(row: NDArray[np.int64]) -> NDArray[np.float64]:
    """(M,) numbers in [0, 1) that look random: the last step of MurmurHash3 of a row number."""
    bits = row.astype(np.uint32) * np.uint32(0x9E3779B1)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        bits = (bits ^ (bits >> np.uint32(shift))) * np.uint32(factor)
    bits ^= bits >> np.uint32(16)
    phase: NDArray[np.float64] = (bits >> np.uint32(8)) / 2.0**24
    return phase
