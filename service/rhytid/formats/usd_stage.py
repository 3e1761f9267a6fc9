"""A USD stage: its one mesh, or the one that is asked for. Needs the extra `usd` (usd-core).

Files are opened by their path, since a stage may refer to others, which USD opens, too. The HTTP
service reads none.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rhytid.domain.lengths import MILLIMETRES
from rhytid.domain.wording import install_hint, plural
from rhytid.errors import InputError, MeshError

# Named in an error.
_LISTED = 20
# Relative: metersPerUnit of 0.0254 may be written with few digits.
_SAME_LENGTH = 1e-4
INSTALL = f"USD files need usd-core; {install_hint('usd')}"


def usd_modules() -> tuple[Any, Any, Any]:
    """`Usd`, `UsdGeom` and `Tf`; raises InputError where usd-core is not installed."""
    try:
        from pxr import Tf, Usd, UsdGeom
    except ImportError as exc:
        raise InputError(INSTALL) from exc
    return Usd, UsdGeom, Tf


def open_stage(file: Path) -> Any:
    """The stage of a file; raises MeshError where it cannot be opened."""
    usd, _, tf = usd_modules()
    try:
        return usd.Stage.Open(str(file))
    except tf.ErrorException as exc:
        reason = str(exc).strip().splitlines()[-1].strip()
        raise MeshError(f"USD cannot open it: {reason:.300}") from exc


def stage_unit(stage: Any) -> str | None:
    """The unit that metersPerUnit is; None where the stage does not say it, or it is no unit known
    here."""
    geom = usd_modules()[1]
    if not geom.StageHasAuthoredMetersPerUnit(stage):
        return None
    length = 1000.0 * float(geom.GetStageMetersPerUnit(stage))
    near = (n for n, known in MILLIMETRES.items() if abs(length - known) <= _SAME_LENGTH * known)
    return next(near, None)


def stage_notes(stage: Any) -> tuple[str, ...]:
    """What is worth knowing of the stage."""
    geom = usd_modules()[1]
    axis, length = str(geom.GetStageUpAxis(stage)), float(geom.GetStageMetersPerUnit(stage))
    notes = []
    if axis != "Y":
        notes.append(f"upAxis is {axis} and is kept: lines without expressions run level around y")
    if geom.StageHasAuthoredMetersPerUnit(stage) and stage_unit(stage) is None:
        known = ", ".join(f"{mm / 1000.0:g}" for mm in MILLIMETRES.values())
        notes.append(f"metersPerUnit is {length:g}, none of {known}: set the unit yourself")
    return tuple(notes)


def find_mesh(stage: Any, wanted: str | None) -> Any:
    """The UsdGeom.Mesh at the path `wanted`, or of that name where only one has it; without
    `wanted` the only one. Raises MeshError naming those that there are."""
    usd, geom, _ = usd_modules()
    every = usd.PrimRange(stage.GetPseudoRoot(), usd.TraverseInstanceProxies())
    meshes = [geom.Mesh(prim) for prim in every if prim.IsA(geom.Mesh)]
    if wanted is None:
        found = meshes
    else:
        found = [mesh for mesh in meshes if wanted in (str(mesh.GetPath()), _name(mesh))]
    if len(found) == 1:
        return found[0]
    if not meshes:
        raise MeshError("the stage has no mesh (UsdGeom.Mesh)")
    if wanted is None:
        raise MeshError(f"the stage has {len(meshes)} meshes, one must be chosen: {_list(meshes)}")
    if found:
        raise MeshError(f"{len(found)} meshes are called {wanted!r}: {_list(found)}")
    raise MeshError(f"no mesh {wanted!r:.200} on the stage; there are: {_list(meshes)}")


def bake_skin(stage: Any, prim: Any) -> None:
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
        points = mesh.GetPointsAttr().Get(usd_modules()[0].TimeCode.EarliestTime())
        listed.append(f"{mesh.GetPath()} ({plural(0 if points is None else len(points), 'point')})")
    return ", ".join(listed[:_LISTED]) + (", …" if len(listed) > _LISTED else "")
