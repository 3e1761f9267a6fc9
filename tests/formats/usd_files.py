"""USD files for the readers under test, written by usd-core."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

# A quadrilateral and a triangle on five points, with a UV seam between them.
POINTS = np.array([[0, 0, 0.5], [1, 0, 0], [1, 1, 0.25], [0, 1, 0], [2, 0.5, 0.125]], np.float32)
COUNTS = np.array([4, 3], np.int32)
CORNERS = np.array([0, 1, 2, 3, 1, 4, 2], np.int32)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2]], np.int32)
UV = np.array(
    [[0.125, 0.125], [0.5, 0.125], [0.5, 0.5], [0.125, 0.5], [0.625, 0.25], [0.875, 0.5], [0.75, 1]]
)
UV_CORNERS = np.arange(7, dtype=np.int32)
UV_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32)


def vectors(values: Any, kind: Any = Vt.Vec3fArray) -> Any:
    return kind.FromNumpy(np.ascontiguousarray(values, np.float32))


def add_mesh(
    stage: Any,
    path: str,
    *,
    points: NDArray[Any] | None = POINTS,
    samples: Mapping[float, NDArray[Any]] | None = None,
    counts: NDArray[Any] = COUNTS,
    corners: NDArray[Any] = CORNERS,
    uv: NDArray[Any] | None = UV,
    uv_indices: NDArray[Any] | None = UV_CORNERS,
    interpolation: str = "faceVarying",
    primvar: str = "st",
) -> Any:
    """A UsdGeom.Mesh; `points` is the default value, `samples` those by time code."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.GetFaceVertexCountsAttr().Set(Vt.IntArray.FromNumpy(np.asarray(counts, np.int32)))
    mesh.GetFaceVertexIndicesAttr().Set(Vt.IntArray.FromNumpy(np.asarray(corners, np.int32)))
    mesh.GetSubdivisionSchemeAttr().Set("none")
    if points is not None:
        mesh.GetPointsAttr().Set(vectors(points))
    for time, values in (samples or {}).items():
        mesh.GetPointsAttr().Set(vectors(values), time)
    if uv is not None:
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(primvar, kind, interpolation)
        st.Set(vectors(uv, Vt.Vec2fArray))
        if uv_indices is not None:
            st.SetIndices(Vt.IntArray.FromNumpy(np.asarray(uv_indices, np.int32)))
    return mesh


def new_stage(file: Path, meters: float | None = None, up: str = "Y") -> Any:
    stage = Usd.Stage.CreateNew(str(file))
    UsdGeom.SetStageUpAxis(stage, up)
    if meters is not None:
        UsdGeom.SetStageMetersPerUnit(stage, meters)
    return stage


def matrix(rows: Any) -> Any:
    return Gf.Matrix4d(np.asarray(rows, float).tolist())


def write_usd(file: Path, meters: float | None = None, up: str = "Y", **mesh: Any) -> Path:
    """A stage of one mesh, /root/face."""
    stage = new_stage(file, meters, up)
    UsdGeom.Xform.Define(stage, "/root")
    add_mesh(stage, "/root/face", **mesh)
    stage.GetRootLayer().Save()
    return file
