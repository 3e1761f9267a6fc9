"""What is probably wrong with a neutral mesh; `warnings.py` has the limits and their reasons."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.origin import number_step, put_back
from rhytid.domain.texel_sizes import texel_spread
from rhytid.domain.tiles import mesh_udims, udim_origin
from rhytid.domain.units import MILLIMETRES, OF_MESHES, beside_number, millimetres
from rhytid.domain.uv_overlap import overlap_of
from rhytid.domain.warnings import (
    FAR_FROM_ORIGIN,
    INWARD_COSINE,
    LEAST_SIZE,
    MESH_SIZE,
    MIRRORED_SHARE,
    MOST_SIZE,
    NORMALS_INWARD,
    OVERLAP_SHARE,
    STEP_OF_EDGE,
    TEXEL_RATIO,
    TEXEL_SIZE,
    TEXEL_USUAL,
    USUAL_SIZE,
    UV_MIRRORED,
    UV_OVERLAP,
    InputWarning,
)


def mesh_warnings(
    mesh: Mesh, unit: str, resolution: int, udims: tuple[int, ...] | None = None
) -> tuple[InputWarning, ...]:
    """Everything about a mesh of that length unit, drawn at so many texels per side.

    udims: those of the mesh, where the caller has them: finding them takes as long as the rest.
    """
    found = MeasuredMesh(mesh, unit, resolution)
    return (
        *found.size(),
        *found.far(),
        *found.inward(),
        *found.mirrored(),
        *found.texels(),
        *found.overlaps(mesh_udims(mesh) if udims is None else udims),
    )


def median_edge(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> float:
    """The median length of the first edges of triangles, mesh units."""
    a, b = (positions[faces[:, i]].astype(np.float64) for i in (0, 1))
    return float(np.median(np.linalg.norm(b - a, axis=1)))


def far_detail(step: float, edge: float, farthest: float, unit: str) -> str:
    """What far-from-origin says of a mesh or a frame."""
    named = beside_number(unit)
    return (
        f"numbers this far from the origin ({farthest:.4g} {named}) come in steps of {step:.2g} "
        f"{named}, {step / edge:.1g} of an edge: stretch is that coarse. Send doubles (npy or npz "
        "of float64, OBJ), or bring neutral and frames to the origin"
    )


class MeasuredMesh:
    """A mesh with what several of the checks need of it.

    used (F,): usable triangles; of these, K: corners (K, 3, 3), uv (K, 3, 2), area (K,) in space
    and uv_area (K,), signed.  turned: normals point inward.
    """

    def __init__(self, mesh: Mesh, unit: str, resolution: int) -> None:
        self.mesh, self.unit, self.resolution = mesh, unit, resolution
        self.used = mesh.usable_triangles()
        self.corners = mesh.positions[mesh.faces[self.used]].astype(np.float64)
        self.uv = mesh.triangle_uv()[self.used]
        a, b, c = np.moveaxis(self.corners, 1, 0)
        self.normals = 0.5 * np.cross(b - a, c - a)
        self.area = np.linalg.norm(self.normals, axis=1)
        u, w = self.uv[:, 1] - self.uv[:, 0], self.uv[:, 2] - self.uv[:, 0]
        self.uv_area = 0.5 * (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])
        self.turned = self._cosine() < INWARD_COSINE

    def size(self) -> Iterator[InputWarning]:
        """The longest side of the box around the mesh."""
        length = millimetres(self.unit)
        if length is None:
            return
        flat = self.corners.reshape(-1, 3)
        units = max(float(np.ptp(flat[:, axis])) for axis in range(3))
        size = units * length
        if LEAST_SIZE <= size <= MOST_SIZE:
            return
        fits = [n for n in OF_MESHES if LEAST_SIZE <= units * MILLIMETRES[n] <= MOST_SIZE]
        fits.sort(key=lambda n: abs(np.log(units * MILLIMETRES[n] / USUAL_SIZE)))
        detail = (
            f"{_length(size)} across ({units:.4g} {beside_number(self.unit)}), a face or a head is "
            f"{LEAST_SIZE / 10:g} to {MOST_SIZE / 10:g} cm"
        )
        if fits:
            would = _length(units * MILLIMETRES[fits[0]])
            detail += f": if it is the head alone, in the unit {fits[0]!r} it would be {would}"
        detail += (
            "; is the unit wrong? Where shoulders or a body belong to it, measure the head: a "
            "number and a unit are taken, too, as '5.5cm'"
        )
        yield InputWarning(MESH_SIZE, detail, "mesh")

    def far(self) -> Iterator[InputWarning]:
        """The step of the numbers over an edge."""
        mesh = self.mesh
        step = number_step(mesh.positions, mesh.centre)
        edge = median_edge(mesh.positions, mesh.faces[self.used])
        if step > STEP_OF_EDGE * edge:
            farthest = float(np.abs(put_back(mesh.positions, mesh.centre)).max())
            yield InputWarning(FAR_FROM_ORIGIN, far_detail(step, edge, farthest, self.unit), "mesh")

    def inward(self) -> Iterator[InputWarning]:
        """Normals against the way out."""
        if self.turned:
            detail = (
                "the faces are wound inside out: their normals point inward, so furrows would "
                "stand out as ridges; turn the faces over"
            )
            yield InputWarning(NORMALS_INWARD, detail, "mesh")

    def mirrored(self) -> Iterator[InputWarning]:
        """UV area that runs clockwise where the surface runs counterclockwise, seen from outside.

        Turning faces over turns both, so that a mesh inside out is not mirrored for that alone.
        """
        signed = self.uv_sense()
        sizes = np.abs(signed)
        share = float(sizes[signed < 0].sum() / sizes.sum())
        if share > MIRRORED_SHARE:
            worst = int(np.argmax(np.where(signed < 0, sizes, 0.0)))
            detail = (
                f"{_percent(share)} of the UV area is mirrored, seen from outside the surface: "
                "directions and turns that are painted there run the other way; flip these charts"
            )
            yield InputWarning(UV_MIRRORED, detail, self._place(worst))

    def uv_sense(self) -> NDArray[np.float64]:
        """(K,) UV areas, below 0 where mirrored, seen from outside the surface."""
        return -self.uv_area if self.turned else self.uv_area

    def texels(self) -> Iterator[InputWarning]:
        """The side of a texel on the surface, largest over smallest without the tails."""
        area_uv, faces = np.abs(self.uv_area), self.mesh.faces[self.used]
        found = texel_spread(self.area, area_uv, faces, self.resolution)
        if found is None:
            return
        detail = (
            f"a texel is {self._texel(found.least)} to {self._texel(found.most)} wide on the "
            f"surface at {self.resolution} x {self.resolution}, {found.most / found.least:.0f} "
            f"times apart, usually {self._texel(found.usual)}: "
            f"{'largest' if found.coarse else 'smallest'} here{_and_more(found.more)}. Up to "
            f"{TEXEL_USUAL:g} times is usual, and more than {TEXEL_RATIO:g} is warned of; give "
            f"such places {'more' if found.coarse else 'less'} room in UV"
        )
        yield InputWarning(TEXEL_SIZE, detail, self._place(found.worst))

    def overlaps(self, udims: tuple[int, ...]) -> Iterator[InputWarning]:
        """Triangles on top of one another in UV, by UDIM."""
        for udim in udims:
            origin = np.array(udim_origin(udim))
            found = overlap_of(self.uv[self.reaches(origin)] - origin)
            if found is not None and found.share > OVERLAP_SHARE:
                u, v = np.array(found.uv) + origin
                detail = (
                    f"{_percent(found.share)} of the UV area lies under more than one triangle "
                    f"(up to {found.most}): the triangle that comes first in the file wins, skin "
                    "on the others is drawn over it"
                )
                place = f"UDIM {udim}, uv ({u:.3f}, {v:.3f})"
                yield InputWarning(UV_OVERLAP, detail, place)

    def _cosine(self) -> float:
        """The mean cosine, by area, between normals and the way out from the middle."""
        middles = self.corners.mean(axis=1)
        out = middles - (self.area @ middles) / self.area.sum()
        along = np.einsum("fi,fi->f", self.normals, out)
        reach = np.linalg.norm(out, axis=1)
        cosines = np.divide(along, reach, out=np.zeros_like(along), where=reach > 0)
        return float(cosines.sum() / self.area.sum())

    def reaches(self, origin: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Which triangles may have a part in the unit square at `origin`."""
        near = np.ones(len(self.uv), bool)
        for axis in (0, 1):
            a, b, c = (self.uv[:, corner, axis] for corner in range(3))
            near &= (np.maximum(np.maximum(a, b), c) > origin[axis]) & (
                np.minimum(np.minimum(a, b), c) < origin[axis] + 1
            )
        return near

    def _place(self, triangle: int) -> str:
        uv = self.uv[triangle].mean(axis=0)
        point = put_back(self.corners[triangle].mean(axis=0), self.mesh.centre)
        index = int(np.flatnonzero(self.used)[triangle])
        at = ", ".join(f"{x:.6g}" for x in point)
        return (
            f"triangle {index}, uv ({uv[0]:.3f}, {uv[1]:.3f}), at ({at}) {beside_number(self.unit)}"
        )

    def _texel(self, side: float) -> str:
        length = millimetres(self.unit)
        if length is not None:
            return f"{side * length:.2g} mm"
        return f"{side:.2g} {beside_number(self.unit)}"


def _length(millimetres: float) -> str:
    """In millimetres, centimetres or metres, whichever reads best."""
    if millimetres < 10.0:
        return f"{millimetres:.3g} mm"
    return f"{millimetres / 10:.3g} cm" if millimetres < 1000.0 else f"{millimetres / 1000:.3g} m"


def _and_more(places: int) -> str:
    return f" and at {places} more {'place' if places == 1 else 'places'}" if places else ""


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
