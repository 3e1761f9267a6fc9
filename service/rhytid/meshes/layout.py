"""How a mesh lies in UV: charts, overlap, mirrored parts, and the size of texels on the surface."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import MeasuredMesh
from rhytid.domain.tiles import mesh_udims, udim_origin
from rhytid.domain.uv_layout import Overlap, overlapping, texel_extremes, texel_sides
from rhytid.domain.warnings import InputWarning
from rhytid.meshes.topology import distinct, joined, numbered

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
    warnings: about the mesh, those of `mesh_warnings`.
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
    warnings: tuple[InputWarning, ...]

    @classmethod
    def of(cls, mesh: Mesh, unit: str, resolution: int) -> Layout:
        """The layout of a mesh; its unit plays a part in `warnings` alone."""
        measured = MeasuredMesh(mesh, unit, resolution)
        used, udims = np.flatnonzero(measured.used), mesh_udims(mesh)
        overlaps = measured.overlaps(udims)
        over = _overlapping(measured, overlaps)
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
            measured.warnings(overlaps),
        )  # fmt: skip


def _overlapping(measured: MeasuredMesh, udims: Iterable[int]) -> Mask:
    """A mask of the usable triangles that overlap in UDIMs."""
    over = np.zeros(len(measured.uv), bool)
    for udim in udims:
        origin = np.array(udim_origin(udim))
        near = np.flatnonzero(measured.reaches(origin))
        over[near[overlapping(measured.uv[near] - origin)]] = True
    return over


def _charts(mesh: Mesh) -> int:
    """Parts of triangles with area in UV that share corners both in space and in UV."""
    kept = mesh.triangles_with_uv()
    place = numbered(mesh.positions)[mesh.faces[kept]]
    uv = numbered(mesh.uv)[mesh.face_uv[kept]]
    _, corner = np.unique(place * len(mesh.uv) + uv, return_inverse=True)
    corner = corner.reshape(-1, 3)
    ends = np.concatenate([corner[:, :2], corner[:, 1:]])
    return len(distinct(joined(ends, int(corner.max()) + 1)))


def _spread(mask: Mask, used: Mask) -> Mask:
    """(F,) a mask of the usable triangles as one of all."""
    whole = np.zeros(len(used), bool)
    whole[used] = mask
    return whole
