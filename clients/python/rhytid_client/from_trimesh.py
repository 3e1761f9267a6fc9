"""Meshes that are objects of trimesh, known by their module's name: trimesh is not imported."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class TrimeshLike(Protocol):
    """What is read of a `trimesh.Trimesh`."""

    vertices: Any
    faces: Any
    visual: Any


def arrays(mesh: TrimeshLike) -> dict[str, NDArray[Any]]:
    """positions, faces, uv and face_uv, vertices in the order that they have.

    Raises TypeError for what is no `trimesh.Trimesh`, ValueError where there is no uv for every
    vertex.
    """
    _check(mesh)
    positions, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    found = getattr(mesh.visual, "uv", None)
    uv = np.zeros((0, 2)) if found is None else np.asarray(found)
    if uv.shape != (len(positions), 2):
        has = "no uv" if found is None else f"uv of shape {uv.shape}"
        raise ValueError(
            f"the trimesh.Trimesh has {has} for its {len(positions)} vertices: give it "
            "mesh.visual = trimesh.visual.TextureVisuals(uv=uv), (V, 2), v up"
        )
    return {"positions": positions, "faces": faces, "uv": uv, "face_uv": faces}


def _check(given: object) -> None:
    names = [kind.__name__ for kind in type(given).__mro__ if _root(kind) == "trimesh"]
    if "Trimesh" in names:
        return
    wanted = "a path, bytes, arrays or a trimesh.Trimesh with UV"
    if "Scene" in names:
        wanted = "one mesh of it, as in scene.geometry"
    what = f"trimesh.{names[0]}" if names else type(given).__name__
    raise TypeError(f"mesh is a {what}: send {wanted}")


def _root(kind: type) -> str:
    return kind.__module__.partition(".")[0]
