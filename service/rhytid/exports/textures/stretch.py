"""Stretch of a frame as textures that drive shaders: log stretch as a tensor, and a mask of blood.

The tensor is Hencky's strain of the posed surface: its eigenvalues are log rho_1 and log rho_2, its
eigenvectors the directions on the frame's surface along which lines became longest and shortest. A
texel has its components along the tangent T and the bitangent B that normal maps use, so that three
numbers hold both values and the axis, without the wrap of an angle, and may be filtered.

At a vertex stands the mean of its triangles; the part without direction and the one with it are
averaged apart, and the latter is turned into the plane of the vertex first. Inside a triangle both
are interpolated. The places of vertices are those of the surface, not of UV, so that seams do not
show: a step of the numbers over a seam is that of the tangents alone. All in double.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.exports.meshes import welded
from rhytid.exports.textures.frame_map import Chart, Facts, FrameMap, VertexField, attributes
from rhytid.exports.textures.tangents import FloatArray, Posed, dot, unit
from rhytid.exports.textures.writers import as_bytes, write_parts, write_png, write_signed
from rhytid.formats.exr_encoder import exr_parts

# |log rho| of a triangle at most: four times or a quarter as long. Slivers and triangles that
# collapse have more, and would be all that a vertex shows.
MOST = float(np.log(4.0))
# |log ratio| of weight 1: twice or half as long.
FULL = float(np.log(2.0))
_CHANNELS = ("R", "G", "B")
# Points whose numbers are worked on at once.
_CACHED = 1 << 12
Vectors = FloatArray | tuple[FloatArray, FloatArray, FloatArray]
# Rows and columns of the six numbers of a symmetric matrix: xx, yy, zz, xy, xz, yz.
_SIX = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)


def weight_facts(map: FrameMap) -> Facts:
    """Facts of weights: red is stretch, green compression; |log ratio| of lengths is value times
    `scale`."""
    return {"scale": FULL, "midlevel": 0.0, "red": "stretch", "green": "compression"}


def write_weights(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write stretch, compression and 0 as RGB PNG of 8 bits."""
    values = weight_map(map.chart(), map.weights())
    codes = np.zeros((*values.shape[:2], 3), np.uint8)
    codes[..., :2] = as_bytes(values)
    return write_png(path, codes, map, facts, values)


def corner_weights(mesh: Mesh, ratios: NDArray[np.float32]) -> FloatArray:
    """(F, 3, 2) stretch and compression at the corners of triangles, each from 0 to 1.

    ratios: (F, 2) of length in the frame to length in the neutral, along both axes of stretch. A
    triangle has max(log ratio, 0) and max(-log ratio, 0), the larger of both axes, over FULL; a
    vertex has the mean of its triangles by their areas in the neutral.
    """
    logs = np.log(np.clip(ratios.astype(np.float64), 1e-6, 1e6)) / FULL
    shares = np.stack([logs.max(axis=1), -logs.min(axis=1)], axis=1).clip(0.0, 1.0)
    mean = mean_at_places(mesh, np.repeat(shares[:, None], 3, axis=1))
    return mean.values[mean.places]


def weight_map(chart: Chart, corners: FloatArray) -> NDArray[np.float32]:
    """(R, R, 2) weights of texels, from those of corners (F, 3, 2)."""
    return chart.sampled(2, lambda found, share: np.einsum("kc,kcx->kx", share, corners[found]))


def vertex_stretch(
    mesh: Mesh, posed: Posed, ratios: NDArray[np.float32], axes: NDArray[np.float32]
) -> VertexField:
    """(P, 7) at the places of a mesh: the mean of both log stretches, and the six numbers of the
    tensor less it, in space.

    ratios: (F, 2) of length in the frame to length in the neutral.  axes: (F, 2, 2), their
    directions in UV. A vertex has the mean of its triangles by their areas in the neutral.
    """
    logs = np.log(np.clip(ratios.astype(np.float64), np.exp(-MOST), np.exp(MOST)))
    even, half = logs.mean(axis=1), (logs[:, 0] - logs[:, 1]) / 2.0
    first = _on_surface(posed, axes[:, 0].astype(np.float64))
    normal = posed.signs[:, None] * np.cross(posed.along, posed.across)
    turned = _turned(first[:, None], normal[:, None], posed.normals)
    second = np.cross(posed.normals, turned)
    rows, columns = _SIX
    shear = turned[..., rows] * turned[..., columns] - second[..., rows] * second[..., columns]
    values = np.concatenate(
        [np.broadcast_to(even[:, None, None], (*shear.shape[:2], 1)), half[:, None, None] * shear],
        axis=-1,
    )
    return mean_at_places(mesh, values)


def mean_at_places(mesh: Mesh, values: FloatArray) -> VertexField:
    """Values (F, 3, K) of corners as means at the places of the mesh, by the areas of triangles in
    the neutral."""
    places = welded(mesh)[mesh.faces]
    area = np.repeat(_areas(mesh, mesh.positions), 3)
    number, flat = places.reshape(-1), values.reshape(-1, values.shape[-1])
    size = np.maximum(np.bincount(number, area), 1e-300)
    mean = [np.bincount(number, area * column) / size for column in flat.T]
    return VertexField(np.stack(mean, axis=1), places)


def area_sums(mesh: Mesh, positions: NDArray[np.float32]) -> VertexField:
    """(P, 1) twice the areas of the triangles at each place of a mesh, summed; mesh units squared.

    positions: (V, 3).
    """
    places = welded(mesh)[mesh.faces]
    area = np.repeat(_areas(mesh, positions), 3)
    sums = np.bincount(places.reshape(-1), area).astype(np.float64)
    return VertexField(sums[:, None], places)


def _areas(mesh: Mesh, positions: NDArray[np.float32]) -> FloatArray:
    corners = positions.astype(np.float64)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found: FloatArray = np.linalg.norm(cross, axis=1)
    return found


def _on_surface(posed: Posed, axes: FloatArray) -> FloatArray:
    """(F, 3) unit vectors in the planes of posed triangles along directions (F, 2) of UV. One of
    the neutral's principal directions is carried to one of the frame's."""
    du, across_u, dv = posed.scale.T[..., None]
    u, v = axes[:, :1], axes[:, 1:]
    return unit((du * u + across_u * v) * posed.along + dv * v * posed.across)


def _turned(vectors: FloatArray, normal: FloatArray, to: FloatArray) -> FloatArray:
    """Vectors orthogonal to unit normals, turned with them to other unit normals `to` the shortest
    way."""
    both = normal + to
    lean = dot(vectors, to) / np.maximum(dot(both, both) / 2.0, 1e-12)
    return vectors - lean * both


def stretch_map(chart: Chart, posed: Posed, field: VertexField) -> NDArray[np.float32]:
    """(R, R, 3) log stretch of texels along T, along B, and between both: h_TT, h_BB, h_TB."""
    return chart.sampled(3, partial(_components, Corners.of(posed, field)))


@dataclass(frozen=True, eq=False)
class Corners:
    """What texels are computed from, number by number, so that numpy runs along them.

    normals, tangents (3, 3, F): by corner and axis.  values (3, 7, F): by corner.  signs (F,).
    """

    normals: FloatArray
    tangents: FloatArray
    values: FloatArray
    signs: FloatArray

    @classmethod
    def of(cls, posed: Posed, field: VertexField) -> Corners:
        """Those of a frame."""
        normals, tangents, values = (
            np.ascontiguousarray(np.moveaxis(one, 0, -1))
            for one in (posed.normals, posed.tangents, field.values[field.places])
        )
        return cls(normals, tangents, values, posed.signs)


def _components(corners: Corners, found: NDArray[np.int32], share: FloatArray) -> FloatArray:
    """(N, 3) at points with weights (N, 3) in triangles (N,), some at a time, which a cache
    holds."""
    out = np.empty((len(found), 3))
    for start in range(0, len(found), _CACHED):
        part = slice(start, start + _CACHED)
        out[part] = _some_components(corners, found[part], np.ascontiguousarray(share[part].T)).T
    return out


def _some_components(corners: Corners, found: NDArray[np.int32], weights: FloatArray) -> FloatArray:
    """(3, N) at points with weights (3, N) in triangles (N,)."""
    normals, values = (np.take(one, found, axis=-1) for one in (corners.normals, corners.values))
    tangents = np.take(corners.tangents, found, axis=-1)
    normal, along = _mean(normals, weights), _mean(tangents, weights)
    normal /= np.maximum(np.sqrt(_dot(normal, normal)), 1e-300)
    along -= _dot(along, normal) * normal
    along /= np.maximum(np.sqrt(_dot(along, along)), 1e-300)
    sign, out = corners.signs[found], np.zeros((3, len(found)))
    for weight, own, (even, *tensor) in zip(weights, normals, values, strict=True):
        t = along - _dot(along, own) / np.maximum(1.0 + _dot(normal, own), 1e-12) * (normal + own)
        xx, yy, zz, xy, xz, yz = tensor
        x, y, z = t
        pulled = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
        b = own[1] * z - own[2] * y, own[2] * x - own[0] * z, own[0] * y - own[1] * x
        shear = _dot(t, pulled)
        out[0] += weight * (even + shear)
        out[1] += weight * (even - shear)
        out[2] += weight * sign * _dot(b, pulled)
    return out


def _mean(corners: FloatArray, weights: FloatArray) -> FloatArray:
    """(3, N) means of vectors (3, 3, N) at corners with weights (3, N)."""
    found: FloatArray = (corners * weights[:, None]).sum(axis=0)
    return found


def _dot(a: Vectors, b: Vectors) -> FloatArray:
    """(N,) scalar products of vectors, by axis."""
    found: FloatArray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return found


def stretch_facts(map: FrameMap) -> Facts:
    """Facts of stretch: texels are log stretch themselves, in the tangent space of the frame."""
    names = {"red": "along T", "green": "along B", "blue": "between T and B"}
    return {"scale": 1.0, "midlevel": 0.0, **names}


def write_stretch(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write the tensor as OpenEXR of half floats with channels R, G and B."""
    values = stretch_map(map.chart(), map.posed(), map.stretch()).astype(np.float16)
    ends = values.min(), values.max()
    return write_parts(path, exr_parts(values, attributes(map.header, facts, *ends), _CHANNELS))


def blood_facts(map: FrameMap) -> Facts:
    """Facts of blood: the late log of the ratio of areas is (p - 32768) / 32767 times `scale`; 0.5
    is skin at rest."""
    return {"scale": FULL, "midlevel": 32768 / 65535, "range": FULL * 65535 / 32767, **map.lag}


def write_blood(path: Path, map: FrameMap, facts: Facts) -> str:
    """Write the mask as a grey PNG of 16 bits: black where the area is half, white where double."""
    late = map.chart().sampled(1, map.blood().at)[..., 0]
    return write_signed(path, late, FULL, map, facts)
