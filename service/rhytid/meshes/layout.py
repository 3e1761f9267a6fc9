"""How a mesh lies in UV: charts, overlap, mirrored parts, and the size of texels on the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import MeasuredMesh
from rhytid.domain.tiles import mesh_udims, udim_origin
from rhytid.domain.uv_layout import Overlap, overlap_of, overlapping, texel_extremes, texel_sides
from rhytid.meshes.topology import distinct, joined

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Layout:
    """UV of the F triangles of a mesh, drawn at `resolution` texels per side of a UDIM.

    udims: those that triangles reach into, ascending.  charts: parts whose triangles share edges in
    UV.  overlaps: by UDIM, its `uv` within the square; UDIMs without any are left out.
    overlapping, mirrored, flat: (F,) over or under another triangle; mirrored, seen from outside;
    without area in UV.  mirrored_share: of the UV area.
    texels: (F,) side of a texel on the surface, mesh units; nan for triangles that have none.
    extremes: triangles with the least, the median and the most of these, by area, half a hundredth
    of it at either end left out, as the warning `texel-size` has them.
    """

    udims: tuple[int, ...]
    charts: int
    overlaps: dict[int, Overlap]
    overlapping: Mask
    mirrored: Mask
    mirrored_share: float
    flat: Mask
    texels: NDArray[np.float64]
    extremes: tuple[int, int, int]

    @classmethod
    def of(cls, mesh: Mesh, resolution: int) -> Layout:
        """The layout of a mesh; its unit plays no part."""
        measured = MeasuredMesh(mesh, "", resolution)
        used, udims = np.flatnonzero(measured.used), mesh_udims(mesh)
        overlaps, over = _overlaps(measured, udims)
        sense = measured.uv_sense()
        side = texel_sides(measured.area, np.abs(measured.uv_area), resolution)
        least, median, most = used[texel_extremes(side, measured.area)].tolist()
        texels = np.full(len(mesh.faces), np.nan)
        texels[used] = side
        return cls(
            udims, _charts(mesh), overlaps, _spread(over, measured.used),
            _spread(sense < 0, measured.used),
            float(np.abs(sense[sense < 0]).sum() / np.abs(sense).sum()),
            ~mesh.triangles_with_uv(), texels, (least, median, most),
        )  # fmt: skip


def _overlaps(measured: MeasuredMesh, udims: tuple[int, ...]) -> tuple[dict[int, Overlap], Mask]:
    """The overlap of each UDIM, and a mask of the usable triangles that overlap."""
    found, over = {}, np.zeros(len(measured.uv), bool)
    for udim in udims:
        origin = np.array(udim_origin(udim))
        near = np.flatnonzero(measured.reaches(origin))
        local = measured.uv[near] - origin
        overlap = overlap_of(local)
        if overlap is not None:
            found[udim] = overlap
            over[near[overlapping(local)]] = True
    return found, over


def _charts(mesh: Mesh) -> int:
    """Parts of triangles with area in UV that share corners both in space and in UV."""
    kept = mesh.triangles_with_uv()
    place = _numbered(mesh.positions)[mesh.faces[kept]]
    uv = _numbered(mesh.uv)[mesh.face_uv[kept]]
    _, corner = np.unique(place * len(mesh.uv) + uv, return_inverse=True)
    corner = corner.reshape(-1, 3)
    ends = np.concatenate([corner[:, :2], corner[:, 1:]])
    return len(distinct(joined(ends, int(corner.max()) + 1)))


def _numbered(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """(N,) a number for each of points (N, D), the same for equal ones."""
    order = np.lexsort(points.T)
    new = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    number = np.zeros(len(points), np.int64)
    number[order[1:]] = np.cumsum(new)
    return number


def _spread(mask: Mask, used: Mask) -> Mask:
    """(F,) a mask of the usable triangles as one of all."""
    whole = np.zeros(len(used), bool)
    whole[used] = mask
    return whole
