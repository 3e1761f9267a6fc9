"""Meshes and animation of USD files (.usd, .usda, .usdc, .usdz): UsdGeom.Mesh, its points sampled.

The neutral is the value of `points` without a time, the default; where there is none, the first
sample. Positions are in the space of the stage: transforms are applied, those that move frame by
frame, and its axes stay as they are. Where points have no samples, blend shapes and joints
(UsdSkel) are applied. Faces of more than three corners are cut as a fan, holes left out. A stage
may call its winding left-handed; here it is right-handed.

A subdivision scheme makes no other triangles. Stretch is measured on the control mesh, and heights
are along the normal of the surface that a renderer makes of it; `notes` say so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.frame import check_positions
from rhytid.domain.mesh import ORIGIN, Centre, Mesh
from rhytid.domain.wording import plural
from rhytid.errors import FrameError, MeshError
from rhytid.formats.frame_set import Clip, Frame, FrameSet, checked_numbers, frames_between
from rhytid.formats.limits import check_size
from rhytid.formats.meshes import MeshFile
from rhytid.formats.polygons import fan
from rhytid.formats.usd_stage import (
    bake_skin,
    find_mesh,
    open_stage,
    stage_notes,
    stage_unit,
    usd_modules,
)
from rhytid.formats.usd_uv import read_uv


class UsdMesh:
    """One mesh of a stage. Raises MeshError naming the prim, and FrameError naming the frame.

    neutral: (V, 3) positions; float64 where a transform moves them, else float32.
    """

    def __init__(self, file: Path, prim: str | None = None) -> None:
        self._usd, self._geom, _ = usd_modules()
        self.stage = open_stage(file)
        self._mesh = find_mesh(self.stage, prim)
        self._points = self._mesh.GetPointsAttr()
        self.path = str(self._mesh.GetPath())
        self._earliest = self._usd.TimeCode.EarliestTime()
        self._still = None if self._moves() else self._transform(self._earliest)
        default = self._usd.TimeCode.Default()
        self.neutral = self._at(
            self._earliest if self._points.Get(default) is None else default, self._earliest
        )
        if not self.animated:
            bake_skin(self.stage, self._mesh.GetPrim())

    def mesh(self) -> Mesh:
        """The neutral mesh."""
        positions = self.neutral
        try:
            counts, corners = self._polygons(len(positions))
            uv, places = read_uv(self._mesh, corners, len(positions))
            keep = np.ones(len(counts), bool)
            holes = self._array(self._mesh.GetHoleIndicesAttr(), np.int64)
            keep[holes[(holes >= 0) & (holes < len(counts))]] = False
            triangles = fan(counts)[np.repeat(keep, counts - 2)]
            if self._turned_over():
                triangles = triangles[:, [0, 2, 1]]
            return Mesh.centred(positions, corners[triangles], uv, places[triangles])
        except MeshError as exc:
            raise MeshError(f"{self.path}: {exc}") from exc

    def frames(self, vertices: int, centre: Centre = ORIGIN) -> FrameSet:
        """The whole time codes from the start of the stage to its end; from the first sample of the
        points to the last, where the stage does not say. USD interpolates between samples.

        A mesh without samples is one frame, which has no number.
        """
        numbers = self._numbers()
        if numbers is None:
            return FrameSet(1, lambda _: self._frame(None, vertices, centre))

        def read(index: int) -> Frame:
            return self._frame(numbers[index], vertices, centre)

        return FrameSet(len(numbers), read, numbers)

    @property
    def animated(self) -> bool:
        """Whether the points have samples."""
        return bool(self._points.GetNumTimeSamples())

    def notes(self) -> tuple[str, ...]:
        """What is worth knowing of the stage and of the mesh."""
        scheme = str(self._mesh.GetSubdivisionSchemeAttr().Get())
        if scheme == "none":
            return stage_notes(self.stage)
        found = (
            f"{self.path} has the subdivision scheme {scheme}: stretch is measured on its control "
            "mesh, heights are along the normal of the surface that is rendered"
        )
        return (*stage_notes(self.stage), found)

    def _numbers(self) -> tuple[int, ...] | None:
        samples = self._points.GetTimeSamples()
        if not samples:
            return None
        first, last = samples[0], samples[-1]
        if len(samples) > 1 and self.stage.HasAuthoredTimeCodeRange():
            first, last = self.stage.GetStartTimeCode(), self.stage.GetEndTimeCode()
        try:
            return checked_numbers(frames_between(first, last))
        except FrameError as exc:
            raise FrameError(f"{self.path}: {exc}") from exc

    def _frame(self, number: int | None, vertices: int, centre: Centre) -> Frame:
        where = self.path if number is None else f"{self.path}, frame {number}"
        try:
            if number is None:
                return check_positions(self.neutral, vertices, centre)
            return check_positions(self._at(self._usd.TimeCode(number)), vertices, centre)
        except (FrameError, MeshError) as exc:
            raise FrameError(f"{where}: {exc}") from exc

    def _at(self, time: Any, placed: Any = None) -> NDArray[np.floating[Any]]:
        """Positions at a time.  placed: that of the transform; None: the same. Transforms with
        samples alone have no default."""
        points = self._points.Get(time)
        if points is None or not len(points):
            raise MeshError(f"{self.path} has no points")
        check_size(f"{self.path} points", 3 * len(points))
        local = np.array(points, np.float32).reshape(-1, 3)
        matrix = self._still
        if matrix is None:
            matrix = self._transform(time if placed is None else placed)
        if np.array_equal(matrix, np.eye(4)):
            return local
        return local.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]

    def _polygons(self, vertices: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(P,) corners of each polygon, and (C,) their vertices."""
        topology = self._mesh.GetFaceVertexCountsAttr(), self._mesh.GetFaceVertexIndicesAttr()
        counts, corners = (self._array(attribute, np.int64) for attribute in topology)
        for attribute in topology:
            self._check_still(attribute)
        check_size("faceVertexIndices", 3 * len(corners))
        if len(counts) == 0 or counts.min() < 3:
            found = plural(int(counts.min()), "corner") if len(counts) else "no faces"
            raise MeshError(f"faceVertexCounts: {found}; a face has at least 3")
        if counts.sum() != len(corners):
            raise MeshError(f"faceVertexCounts add up to {counts.sum()}, not {len(corners)}")
        wrong = (corners < 0) | (corners >= vertices)
        if wrong.any():
            bad = int(np.argmax(wrong))
            raise MeshError(f"faceVertexIndices[{bad}]: no point {corners[bad]} of {vertices}")
        return counts, corners

    def _array(self, attribute: Any, dtype: type[np.generic]) -> NDArray[Any]:
        value = attribute.Get(self._earliest)
        return np.array([] if value is None else value, dtype)

    def _check_still(self, attribute: Any) -> None:
        """Raise MeshError where an array of the topology has samples that differ."""
        times = attribute.GetTimeSamples()
        first = attribute.Get(times[0]) if times else None
        for time in times[1:]:
            if attribute.Get(time) != first:
                raise MeshError(f"{attribute.GetName()} changes at time code {time:g}")

    def _turned_over(self) -> bool:
        """Whether faces wind the other way: called left-handed, or mirrored by the transform."""
        left: bool = self._mesh.GetOrientationAttr().Get(self._earliest) == "leftHanded"
        matrix = self._transform(self._earliest) if self._still is None else self._still
        return left != bool(np.linalg.det(matrix[:3, :3]) < 0.0)

    def _moves(self) -> bool:
        """Whether a transform of the mesh, or of a prim above it, changes over time."""
        prim = self._mesh.GetPrim()
        while prim and not prim.IsPseudoRoot():
            form = self._geom.Xformable(prim)
            if form and form.TransformMightBeTimeVarying():
                return True
            prim = prim.GetParent()
        return False

    def _transform(self, time: Any) -> NDArray[np.float64]:
        """(4, 4) from the space of the mesh to that of the stage, for rows."""
        cache = self._geom.XformCache(time)
        return np.array(cache.GetLocalToWorldTransform(self._mesh.GetPrim()), np.float64)


def read_usd(file: Path, clip: Clip) -> MeshFile:
    """The mesh of a USD file, with its animation, its unit and notes."""
    found = UsdMesh(file, clip.prim)
    mesh, unit = found.mesh(), stage_unit(found.stage)
    frames = (lambda: found.frames(len(mesh.positions), mesh.centre)) if found.animated else None
    return MeshFile(mesh, animation=frames, unit=unit, notes=found.notes())


def read_usd_frames(file: Path, vertices: int, centre: Centre, clip: Clip) -> FrameSet:
    """The frames of a USD file, for a neutral mesh from elsewhere."""
    return UsdMesh(file, clip.prim).frames(vertices, centre)
