"""What is inside stored files: meshes and painted maps as safetensors; the id of a content."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load, save

from rhytid.domain.asset_settings import AssetSettings, GraphSettings
from rhytid.domain.expressions import Expressions, Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls, Stiffness
from rhytid.storage.canonical import canonical

# Part of every id: raise it when the same input shall build another asset.
ID_VERSION = 1
# Settings that came later: at their defaults they make the asset that was made before them.
_LATER = (
    "spacing",
    "lines",
    "region",
    "age",
    "density",
    "strength",
    "turn",
    "anisotropy",
    "scale",
    "pore_radius",
)
# The defaults of these before they could be left open. With a given graph the number of wrinkles
# makes no difference.
_WRINKLES_BEFORE = 300_000
_MESH_ARRAYS = ("positions", "faces", "uv", "face_uv")


def asset_id(
    mesh: Mesh,
    settings: AssetSettings,
    graph: WrinkleGraph | None,
    stiffness: Stiffness | None = None,
    controls: Controls | None = None,
    expressions: Expressions | None = None,
) -> str:
    """The id of the asset that these build: 16 hex digits of a SHA-256 over their content.

    expressions: what lines grow by. The same arrays and settings give the same id on every machine.
    """
    identity = _identity(settings, graph is not None)
    digest = hashlib.sha256(canonical({"version": ID_VERSION, "settings": identity}))
    _add_arrays(digest, "mesh", _mesh_arrays(mesh))
    _add_arrays(digest, "graph", {} if graph is None else graph.arrays())
    if graph is not None and graph.origin is not None:
        digest.update(canonical(["origin", graph.origin.metadata()]))
    if stiffness is not None:
        _add_arrays(digest, "stiffness", stiffness.arrays())
    if controls is not None:
        _add_arrays(digest, "controls", controls.arrays())
    if expressions is not None:
        digest.update(canonical(["expressions", expressions.digest().hex()]))
    return digest.hexdigest()[:16]


def write_mesh(mesh: Mesh) -> bytes:
    """The mesh as safetensors; uv stay float64."""
    data: bytes = save(_mesh_arrays(mesh))
    return data


def read_mesh(data: bytes) -> Mesh:
    """The inverse of `write_mesh`; raises MeshError, TypeError or SafetensorError."""
    return Mesh(**load(data))


def write_stiffness(stiffness: Stiffness) -> bytes:
    """The maps as safetensors, by UDIM."""
    data: bytes = save(stiffness.arrays())
    return data


def read_stiffness(data: bytes) -> Stiffness:
    """The inverse of `write_stiffness`; raises InputError, ValueError or SafetensorError."""
    return Stiffness.of_arrays(load(data))


def write_controls(controls: Controls) -> bytes:
    """The maps as safetensors, by name and UDIM."""
    data: bytes = save(controls.arrays())
    return data


def read_controls(data: bytes) -> Controls:
    """The inverse of `write_controls`; raises InputError, ValueError or SafetensorError."""
    return Controls.of_arrays(load(data))


def write_folds(folds: Folds) -> bytes:
    """The arrays as safetensors."""
    data: bytes = save(folds.arrays())
    return data


def read_folds(data: bytes) -> Folds:
    """The inverse of `write_folds`; raises InputError, KeyError or SafetensorError."""
    return Folds.of_arrays(load(data))


def write_expressions(expressions: Expressions) -> bytes:
    """The positions as safetensors, without the names."""
    data: bytes = save({"shapes": expressions.positions})
    return data


def read_expressions(data: bytes, names: Any) -> Expressions:
    """The inverse of `write_expressions`; raises FrameError, KeyError, TypeError or
    SafetensorError."""
    shapes = load(data)["shapes"]
    return Expressions.checked(shapes, shapes.shape[1], list(names))


def _identity(settings: AssetSettings, given: bool) -> dict[str, Any]:
    """given: whether the graph is."""
    values, plain = settings.drawn(), GraphSettings()
    values["unit"] = settings.length_unit
    graph = values["graph"]
    if given and graph["wrinkles"] is None:
        graph["wrinkles"] = _WRINKLES_BEFORE
    graph["seed"] = settings.graph.start
    # By expressions or not, what lines grow by is part of the id itself.
    graph["lines"] = None
    values["graph"] = {k: v for k, v in graph.items() if k not in _LATER or v != getattr(plain, k)}
    return values


def _mesh_arrays(mesh: Mesh) -> dict[str, NDArray[Any]]:
    arrays = {name: getattr(mesh, name) for name in _MESH_ARRAYS}
    # Only where there is one: a mesh near the origin keeps its id.
    return {**arrays, "centre": mesh.centre} if mesh.centre.any() else arrays


def _add_arrays(digest: hashlib._Hash, group: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Add name, dtype, shape and bytes of each array: no two sets of arrays give one stream."""
    digest.update(canonical([group, len(arrays)]))
    for name in sorted(arrays):
        little = arrays[name].astype(arrays[name].dtype.newbyteorder("<"), copy=False)
        digest.update(canonical([name, little.dtype.str, little.shape]))
        digest.update(np.ascontiguousarray(little).data)
