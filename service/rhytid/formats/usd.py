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

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.frame import check_positions
from rhytid.domain.lengths import MILLIMETRES
from rhytid.domain.mesh import ORIGIN, Centre, Mesh
from rhytid.domain.wording import install_hint, plural
from rhytid.errors import FrameError, InputError, MeshError
from rhytid.formats.frame_set import Clip, Frame, FrameSet, checked_numbers, frames_between
from rhytid.formats.limits import check_size
from rhytid.formats.meshes import MeshFile
from rhytid.formats.polygons import fan

# Named in an error.
_LISTED = 20
# Relative: metersPerUnit of 0.0254 may be written with few digits.
_SAME_LENGTH = 1e-4
_INSTALL = f"USD files need usd-core; {install_hint('usd')}"
_TYPES = ("texCoord2f[]", "texCoord2h[]", "texCoord2d[]", "float2[]", "half2[]", "double2[]")
_BY_CORNER, _BY_VERTEX = ("faceVarying",), ("vertex", "varying")


def read_usd(file: Path, clip: Clip) -> MeshFile:
    """The mesh of a USD file, with its animation, its unit and notes."""
    found = _UsdMesh(file, clip.prim)
    mesh, unit = found.mesh(), _stage_unit(found.stage)
    frames = (lambda: found.frames(len(mesh.positions), mesh.centre)) if found.animated else None
    return MeshFile(mesh, animation=frames, unit=unit, notes=found.notes())


def read_usd_frames(file: Path, vertices: int, centre: Centre, clip: Clip) -> FrameSet:
    """The frames of a USD file, for a neutral mesh from elsewhere."""
    return _UsdMesh(file, clip.prim).frames(vertices, centre)


class _UsdMesh:
    """One mesh of a stage. Raises MeshError naming the prim, and FrameError naming the frame.

    neutral: (V, 3) positions; float64 where a transform moves them, else float32.
    """

    def __init__(self, file: Path, prim: str | None = None) -> None:
        self._usd, self._geom, _ = _modules()
        self.stage = _open_stage(file)
        self._mesh = _find_mesh(self.stage, prim)
        self._points = self._mesh.GetPointsAttr()
        self.path = str(self._mesh.GetPath())
        self._earliest = self._usd.TimeCode.EarliestTime()
        self._still = None if self._moves() else self._transform(self._earliest)
        default = self._usd.TimeCode.Default()
        self.neutral = self._at(
            self._earliest if self._points.Get(default) is None else default, self._earliest
        )
        if not self.animated:
            _bake_skin(self.stage, self._mesh.GetPrim())

    def mesh(self) -> Mesh:
        """The neutral mesh."""
        positions = self.neutral
        try:
            counts, corners = self._polygons(len(positions))
            uv, places = _read_uv(self._mesh, corners, len(positions))
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
        """Remarks on the stage and on the mesh for the user."""
        scheme = str(self._mesh.GetSubdivisionSchemeAttr().Get())
        if scheme == "none":
            return _stage_notes(self.stage)
        found = (
            f"{self.path} has the subdivision scheme {scheme}: stretch is measured on its control "
            "mesh, heights are along the normal of the surface that is rendered"
        )
        return (*_stage_notes(self.stage), found)

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


def _modules() -> tuple[Any, Any, Any]:
    """`Usd`, `UsdGeom` and `Tf`; raises InputError where usd-core is not installed."""
    try:
        from pxr import Tf, Usd, UsdGeom
    except ImportError as exc:
        raise InputError(_INSTALL) from exc
    return Usd, UsdGeom, Tf


def _open_stage(file: Path) -> Any:
    """The stage of a file; raises MeshError where it cannot be opened."""
    usd, _, tf = _modules()
    try:
        return usd.Stage.Open(str(file))
    except tf.ErrorException as exc:
        reason = str(exc).strip().splitlines()[-1].strip()
        raise MeshError(f"USD cannot open it: {reason:.300}") from exc


def _stage_unit(stage: Any) -> str | None:
    """The unit of length that metersPerUnit stands for; None where the stage does not state it, or
    it is none of those known here."""
    geom = _modules()[1]
    if not geom.StageHasAuthoredMetersPerUnit(stage):
        return None
    length = 1000.0 * float(geom.GetStageMetersPerUnit(stage))
    near = (n for n, known in MILLIMETRES.items() if abs(length - known) <= _SAME_LENGTH * known)
    return next(near, None)


def _stage_notes(stage: Any) -> tuple[str, ...]:
    """Remarks on the stage for the user."""
    geom = _modules()[1]
    axis, length = str(geom.GetStageUpAxis(stage)), float(geom.GetStageMetersPerUnit(stage))
    notes = []
    if axis != "Y":
        notes.append(f"upAxis is {axis} and is kept: lines without expressions run level around y")
    if geom.StageHasAuthoredMetersPerUnit(stage) and _stage_unit(stage) is None:
        known = ", ".join(f"{mm / 1000.0:g}" for mm in MILLIMETRES.values())
        notes.append(f"metersPerUnit is {length:g}, none of {known}: set the unit yourself")
    return tuple(notes)


def _find_mesh(stage: Any, name: str | None) -> Any:
    """The UsdGeom.Mesh at the path `name`, or of that name where only one has it; without a name
    the only one. Raises MeshError naming those that there are."""
    usd, geom, _ = _modules()
    every = usd.PrimRange(stage.GetPseudoRoot(), usd.TraverseInstanceProxies())
    meshes = [geom.Mesh(prim) for prim in every if prim.IsA(geom.Mesh)]
    if name is None:
        found = meshes
    else:
        found = [mesh for mesh in meshes if name in (str(mesh.GetPath()), _name(mesh))]
    if len(found) == 1:
        return found[0]
    if not meshes:
        raise MeshError("the stage has no mesh (UsdGeom.Mesh)")
    if name is None:
        raise MeshError(f"the stage has {len(meshes)} meshes, one must be chosen: {_list(meshes)}")
    if found:
        raise MeshError(f"{len(found)} meshes are called {name!r}: {_list(found)}")
    raise MeshError(f"no mesh {name!r:.200} on the stage; there are: {_list(meshes)}")


def _bake_skin(stage: Any, prim: Any) -> None:
    """Have USD bake blend shapes and joints that move a mesh into samples of its points.

    They are held in memory, all frames of all meshes of that skeleton; the file is not changed. A
    mesh without a skeleton is left as it is.
    """
    from pxr import Gf, UsdSkel

    root = UsdSkel.Root.Find(prim)
    if not root or prim.IsInstanceProxy() or not prim.HasAPI(UsdSkel.BindingAPI):
        return
    stage.SetEditTarget(stage.GetSessionLayer())
    if not UsdSkel.BakeSkinning(root, Gf.Interval.GetFullInterval()):
        raise MeshError(f"USD cannot pose {prim.GetPath()} by its skeleton")


def _name(mesh: Any) -> str:
    return str(mesh.GetPrim().GetName())


def _list(meshes: Iterable[Any]) -> str:
    listed = []
    for mesh in meshes:
        points = mesh.GetPointsAttr().Get(_modules()[0].TimeCode.EarliestTime())
        listed.append(f"{mesh.GetPath()} ({plural(0 if points is None else len(points), 'point')})")
    return ", ".join(listed[:_LISTED]) + (", …" if len(listed) > _LISTED else "")


def _read_uv(
    mesh: Any, corners: NDArray[np.int64], vertices: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(T, 2) texture coordinates and (C,) which of them each corner has.

    corners: (C,) the vertex of each. Values that are not indexed are shared by the corners of one
    vertex that have the same, so that charts hang together. Raises MeshError naming the primvar.
    """
    primvar = _chosen(mesh)
    name, interpolation = str(primvar.GetPrimvarName()), str(primvar.GetInterpolation())
    time = _modules()[0].TimeCode.EarliestTime()
    values = primvar.Get(time)
    uv = np.array([] if values is None else values, np.float64).reshape(-1, 2)
    check_size(f"primvar {name}", 2 * len(uv))
    if interpolation not in _BY_CORNER + _BY_VERTEX:
        raise MeshError(f"primvar {name} is {interpolation}: must be faceVarying or vertex")
    rows = len(corners) if interpolation in _BY_CORNER else vertices
    places = _places(primvar, time, name, len(uv), rows)
    if interpolation in _BY_VERTEX:
        return uv, places[corners]
    return (uv, places) if primvar.IsIndexed() else _shared(uv, corners)


def _chosen(mesh: Any) -> Any:
    api = _modules()[1].PrimvarsAPI(mesh.GetPrim())
    fit = {
        str(primvar.GetPrimvarName()): primvar
        for primvar in api.FindPrimvarsWithInheritance()
        if primvar.HasValue() and str(primvar.GetTypeName()) in _TYPES
    }
    if "st" in fit:
        return fit["st"]
    if len(fit) == 1:
        return next(iter(fit.values()))
    listed = ", ".join(sorted(fit)) or "none"
    raise MeshError(f"no primvar st of texture coordinates; pairs of numbers there: {listed}")


def _places(primvar: Any, time: Any, name: str, values: int, rows: int) -> NDArray[np.int64]:
    """(rows,) which value each corner or vertex has."""
    if not primvar.IsIndexed():
        if values != rows:
            raise MeshError(f"primvar {name} has {plural(values, 'value')}, not {rows}")
        return np.arange(rows)
    places = np.array(primvar.GetIndices(time), np.int64)
    if len(places) != rows:
        raise MeshError(f"primvar {name} has {plural(len(places), 'index', 'indices')}, not {rows}")
    wrong = (places < 0) | (places >= values)
    if wrong.any():
        bad = int(np.argmax(wrong))
        raise MeshError(f"primvar {name}, index {bad}: no value {places[bad]} of {values}")
    return places


def _shared(
    uv: NDArray[np.float64], corners: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The values that differ at a vertex, by vertex, and which of them each corner has."""
    rows = np.column_stack([corners, uv])
    _, first, places = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return uv[first], places.reshape(-1)
