"""Checks of neutral meshes and of frames for what is probably wrong; `warnings.py` has the limits
and their reasons.

A frame is judged by a sample of its triangles, on the host and in double: the cost is the same for
a mesh of any size, and the device is not needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.lengths import MESH_UNITS, MILLIMETRES, millimetres, unit_after_number, unit_pair
from rhytid.domain.mesh import Mesh, add_centre, float_step
from rhytid.domain.tiles import mesh_udims, udim_origin
from rhytid.domain.uv_layout import Overlap, overlap_of, texel_spread
from rhytid.domain.warnings import (
    CALIBRATION_STILL,
    CLAMP_MEDIAN,
    FAR_FROM_ORIGIN,
    FRAME_SCALED,
    INWARD_COSINE,
    LEAST_SIZE,
    MESH_SIZE,
    MIRRORED_SHARE,
    MOST_SIZE,
    NORMALS_INWARD,
    OVERLAP_SHARE,
    SCALED_MEDIAN,
    SCALED_SPREADS,
    STEP_OF_EDGE,
    STILL_STRETCH,
    STRETCH_AT_CLAMP,
    TEXEL_RATIO,
    TEXEL_SIZE,
    TEXEL_USUAL,
    UNIT_TOLERANCE,
    USUAL_SIZE,
    UV_MIRRORED,
    UV_OVERLAP,
    InputWarning,
)

# Triangles that are sampled: their median is off by some 4 % of the spread.
_TRIANGLES = 512
# Log stretch of a triangle that has no area left.
_NOTHING = 1e-30
# Share of mirrored UV from which on it is not single charts, but all of them.
_ALL_MIRRORED = 0.9


def mesh_warnings(
    mesh: Mesh, unit: str, resolution: int, udims: tuple[int, ...] | None = None
) -> tuple[InputWarning, ...]:
    """The warnings about a mesh.

    unit: length unit of the mesh.  resolution: texels per side of its maps.  udims: of the mesh,
    where the caller has them; to find them takes as long as all checks.
    """
    found = MeasuredMesh(mesh, unit, resolution)
    return found.warnings(found.overlaps(mesh_udims(mesh) if udims is None else udims))


class MeasuredMesh:
    """A mesh with the measures that its checks share; each check yields its warnings.

    used: (F,) whether a triangle is usable.  corners: (K, 3, 3) of the K usable ones.
    uv: (K, 3, 2).  normals: (K, 3), as long as the area.  area: (K,) in space.  uv_area: (K,),
    signed.  turned: whether normals point inward.
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

    def warnings(self, overlaps: Mapping[int, Overlap]) -> tuple[InputWarning, ...]:
        """All warnings; overlaps: of the UDIMs of the mesh, as `overlaps` finds them."""
        return (
            *self.size(),
            *self.far(),
            *self.inward(),
            *self.mirrored(),
            *self.texels(),
            *self.overlapping(overlaps),
        )

    def size(self) -> Iterator[InputWarning]:
        """mesh-size: the longest side of the box around the mesh."""
        length = millimetres(self.unit)
        if length is None:
            return
        flat = self.corners.reshape(-1, 3)
        units = max(float(np.ptp(flat[:, axis])) for axis in range(3))
        size = units * length
        if LEAST_SIZE <= size <= MOST_SIZE:
            return
        fits = [n for n in MESH_UNITS if LEAST_SIZE <= units * MILLIMETRES[n] <= MOST_SIZE]
        fits.sort(key=lambda n: abs(np.log(units * MILLIMETRES[n] / USUAL_SIZE)))
        detail = (
            f"{_length(size)} across ({units:.4g} {unit_after_number(self.unit)}), a face or a "
            f"head is {LEAST_SIZE / 10:g} to {MOST_SIZE / 10:g} cm"
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
        """far-from-origin: the step of the numbers over the length of an edge."""
        mesh = self.mesh
        step = float_step(mesh.positions, mesh.centre)
        edge = median_edge(mesh.positions, mesh.faces[self.used])
        if step > STEP_OF_EDGE * edge:
            farthest = float(np.abs(add_centre(mesh.positions, mesh.centre)).max())
            yield InputWarning(FAR_FROM_ORIGIN, far_detail(step, edge, farthest, self.unit), "mesh")

    def inward(self) -> Iterator[InputWarning]:
        """normals-inward: normals against the way out."""
        if self.turned:
            detail = (
                "the faces are wound inside out: their normals point inward, so furrows would "
                "stand out as ridges; turn the faces over"
            )
            yield InputWarning(NORMALS_INWARD, detail, "mesh")

    def mirrored(self) -> Iterator[InputWarning]:
        """uv-mirrored: area that is clockwise in UV and counterclockwise on the surface, from
        outside.

        Turning faces over turns both, so a mesh that is inside out is not mirrored for that alone.
        """
        signed = self.uv_sense()
        sizes = np.abs(signed)
        share = float(sizes[signed < 0].sum() / sizes.sum())
        if share > MIRRORED_SHARE:
            worst = int(np.argmax(np.where(signed < 0, sizes, 0.0)))
            wrong = (
                "v runs the other way, as after an export that turned it over (or u does): give "
                "1 - v in the file, or turn painted maps over as well (scans: with `--flip v`, "
                "where it is not given)"
                if share > _ALL_MIRRORED
                else "directions and turns that are painted there run the other way; flip these "
                "charts"
            )
            detail = (
                f"{_percent(share)} of the UV area is mirrored, seen from outside the surface: "
                f"{wrong}"
            )
            yield InputWarning(UV_MIRRORED, detail, self._place(worst))

    def uv_sense(self) -> NDArray[np.float64]:
        """(K,) UV areas, below 0 where mirrored, seen from outside the surface."""
        return -self.uv_area if self.turned else self.uv_area

    def texels(self) -> Iterator[InputWarning]:
        """texel-size: the side of a texel on the surface, largest over smallest without tails."""
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

    def overlaps(self, udims: tuple[int, ...]) -> dict[int, Overlap]:
        """The overlap of each UDIM, its `uv` within the square; UDIMs without any are left out."""
        found = {}
        for udim in udims:
            origin = np.array(udim_origin(udim))
            overlap = overlap_of(self.uv[self.reaches(origin)] - origin)
            if overlap is not None:
                found[udim] = overlap
        return found

    def overlapping(self, overlaps: Mapping[int, Overlap]) -> Iterator[InputWarning]:
        """uv-overlap: triangles on top of one another in UV, UDIM by UDIM."""
        for udim, found in overlaps.items():
            if found.share > OVERLAP_SHARE:
                u, v = np.array(found.uv) + udim_origin(udim)
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
        """(K,) whether a triangle may have a part in the unit square at `origin`."""
        near = np.ones(len(self.uv), bool)
        for axis in (0, 1):
            a, b, c = (self.uv[:, corner, axis] for corner in range(3))
            near &= (np.maximum(np.maximum(a, b), c) > origin[axis]) & (
                np.minimum(np.minimum(a, b), c) < origin[axis] + 1
            )
        return near

    def _place(self, triangle: int) -> str:
        uv = self.uv[triangle].mean(axis=0)
        point = add_centre(self.corners[triangle].mean(axis=0), self.mesh.centre)
        index = int(np.flatnonzero(self.used)[triangle])
        at = ", ".join(f"{x:.6g}" for x in point)
        unit = unit_after_number(self.unit)
        return f"triangle {index}, uv ({uv[0]:.3f}, {uv[1]:.3f}), at ({at}) {unit}"

    def _texel(self, side: float) -> str:
        length = millimetres(self.unit)
        if length is not None:
            return f"{side * length:.2g} mm"
        return f"{side:.2g} {unit_after_number(self.unit)}"


class FrameCheck:
    """Checks the frames of a mesh by a sample of its triangles, spread evenly over the file."""

    def __init__(self, mesh: Mesh, unit: str) -> None:
        self.unit, self.centre = unit, mesh.centre
        usable = np.flatnonzero(mesh.usable_triangles())
        step = -(-len(usable) // _TRIANGLES)
        corners = mesh.faces[usable[::step]]
        self._corners = np.ascontiguousarray(corners.T)
        first, second = self._edges(mesh.positions)
        length = np.linalg.norm(first, axis=0)
        height = np.linalg.norm(_cross(first, second), axis=0) / length
        along = _dot(first, second) / length
        # The columns of F in the frame of the first edge, from the edges of the deformed triangle.
        self._one = 1.0 / length
        self._two = -along / (length * height), 1.0 / height
        self._edge = median_edge(mesh.positions, corners)
        self._neutral_far = self._is_far(mesh.positions)

    def warnings(self, positions: NDArray[np.float32], where: str) -> tuple[InputWarning, ...]:
        """The warnings about a frame.

        positions: (V, 3) in mesh units, less the centre.  where: names the frame.
        """
        return tuple(self._found(positions, where))

    def calibration_warnings(
        self, positions: NDArray[np.float32], where: str
    ) -> tuple[InputWarning, ...]:
        """The warnings about a frame that precomputed maps are to reach as far as; the rest as in
        `warnings`."""
        size = np.sort(np.abs(self.log_stretch(positions)), axis=None)
        most = float(size[int(0.9 * (size.size - 1))])
        if most > STILL_STRETCH:
            return ()
        detail = (
            f"nine tenths of the skin are stretched or compressed by {100 * np.expm1(most):.2g} % "
            "or less: is it the neutral? Precomputed maps will be right for hardly more than that"
        )
        return (InputWarning(CALIBRATION_STILL, detail, where),)

    def _found(self, positions: NDArray[np.float32], where: str) -> Iterator[InputWarning]:
        logs = self.log_stretch(positions)
        places = [int(share * (logs.size - 1)) for share in (0.1, 0.5, 0.9)]
        low, middle, high = np.partition(logs, places, axis=None)[places].tolist()
        if abs(middle) >= max(SCALED_MEDIAN, SCALED_SPREADS * (high - low)):
            yield InputWarning(FRAME_SCALED, self._scaled(float(np.exp(middle))), where)
        elif np.count_nonzero(np.abs(logs) >= CLAMP_MEDIAN) * 2 > logs.size:
            size = float(np.exp(np.median(np.abs(logs))))
            detail = (
                f"half of the triangles are stretched or compressed by {size:.3g} times or more; "
                "faces do not reach 1.5. Are its vertices in the order of the neutral mesh, and is "
                "it a frame of this mesh?"
            )
            yield InputWarning(STRETCH_AT_CLAMP, detail, where)
        # Where the neutral is far itself, there is a warning already.
        if not self._neutral_far and self._is_far(positions):
            step = float_step(positions, self.centre)
            sent = add_centre(positions, self.centre)
            detail = far_detail(step, self._edge, float(np.abs(sent).max()), self.unit)
            yield InputWarning(FAR_FROM_ORIGIN, detail, where)

    def log_stretch(self, positions: NDArray[np.float32]) -> NDArray[np.float64]:
        """(K, 2) log ρ of the sampled triangles, the larger first, unclamped."""
        first, second = self._edges(positions)
        one = first * self._one
        two = first * self._two[0] + second * self._two[1]
        a, b, c, across = _dot(one, one), _dot(one, two), _dot(two, two), _cross(one, two)
        root = np.sqrt((0.5 * (a - c)) ** 2 + b * b)
        larger = np.maximum(0.5 * (a + c) + root, _NOTHING)
        # The determinant over the larger one: the difference would lose its digits.
        smaller = np.maximum(_dot(across, across) / larger, _NOTHING)
        logs: NDArray[np.float64] = 0.5 * np.log(np.stack([larger, smaller], axis=1))
        return logs

    def _edges(
        self, positions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3, K) from the first corner to the second and to the third."""
        a, b, c = positions[self._corners].transpose(0, 2, 1).astype(np.float64, order="C")
        return b - a, c - a

    def _is_far(self, positions: NDArray[np.float32]) -> bool:
        return float_step(positions, self.centre) > STEP_OF_EDGE * self._edge

    def _scaled(self, factor: float) -> str:
        detail = f"it is the neutral mesh made {factor:.4g} times as large"
        pair = unit_pair(factor, self.unit, UNIT_TOLERANCE)
        if pair is not None:
            times = f"multiply it by {1.0 / factor:.4g}"
            if pair[0] == self.unit:
                return f"{detail}: it looks like {pair[1]} beside a neutral in {pair[0]}; {times}"
            # None of the usual units makes this factor of that of the asset.
            return f"{detail}, as one length has in {pair[1]} and in {pair[0]}; {times}"
        return f"{detail}: skin does not grow everywhere by the same factor"


def median_edge(positions: NDArray[np.float32], faces: NDArray[np.int32]) -> float:
    """The median length of the first edges of triangles, mesh units."""
    a, b = (positions[faces[:, i]].astype(np.float64) for i in (0, 1))
    lengths = np.sort(np.linalg.norm(b - a, axis=1))
    # As np.median, which imports numpy.ma: that takes longer than a small mesh does.
    middle = lengths[(len(lengths) - 1) // 2 : len(lengths) // 2 + 1]
    return float(middle.mean())


def far_detail(step: float, edge: float, farthest: float, unit: str) -> str:
    """The detail of a far-from-origin warning about a mesh or a frame."""
    named = unit_after_number(unit)
    return (
        f"numbers this far from the origin ({farthest:.4g} {named}) come in steps of {step:.2g} "
        f"{named}, {step / edge:.1g} of an edge: stretch is that coarse. Send doubles (npy or npz "
        "of float64, OBJ), or bring neutral and frames to the origin"
    )


def _length(millimetres: float) -> str:
    """In millimetres, centimetres or metres, whichever reads best."""
    if millimetres < 10.0:
        return f"{millimetres:.3g} mm"
    return f"{millimetres / 10:.3g} cm" if millimetres < 1000.0 else f"{millimetres / 1000:.3g} m"


def _and_more(places: int) -> str:
    return f" and at {places} more {'place' if places == 1 else 'places'}" if places else ""


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    products: NDArray[np.float64] = np.einsum("ik,ik->k", a, b)
    return products


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, K) cross products; numpy's own takes longer to begin than these few take."""
    (x, y, z), (u, v, w) = a, b
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u])
