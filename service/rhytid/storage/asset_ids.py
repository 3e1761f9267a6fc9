"""The id of an asset, which names the content that it is built from."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import PRESETS, AssetSettings, GraphSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls, Stiffness
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.storage.canonical import canonical

# Part of every id: raise it where what was stored before must not be taken for what the same input
# builds. Skin whose lines grow otherwise than before keeps its id: stored assets keep their look,
# and keys of what is drawn have `drawing_version`, which goes with the code that grows lines.
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
# Settings that came later still, beside others at their defaults: at what `paper` has, they make
# the asset that was made before them.
_OFF = {"graph": dict(PRESETS["paper"].graph), "response": {"folds": 0.0}}
_MESH_ARRAYS = ("positions", "faces", "uv", "face_uv")


def asset_id(
    mesh: Mesh,
    settings: AssetSettings,
    graph: WrinkleGraph | None,
    stiffness: Stiffness | None = None,
    controls: Controls | None = None,
    expressions: Expressions | None = None,
    residual: Residual | None = None,
    scan: ScanRelief | None = None,
) -> str:
    """The id of the asset that is built from this content: 16 hex digits of a SHA-256 over it.

    expressions: those that lines grow by. The same arrays and settings give the same id on every
    machine.
    """
    identity = _identity(settings, graph is not None)
    digest = hashlib.sha256(canonical({"version": ID_VERSION, "settings": identity}))
    _add_arrays(digest, "mesh", mesh_arrays(mesh))
    _add_arrays(digest, "graph", {} if graph is None else graph.arrays())
    if graph is not None and graph.origin is not None:
        digest.update(canonical(["origin", graph.origin.metadata()]))
    if stiffness is not None:
        _add_arrays(digest, "stiffness", stiffness.arrays())
    if controls is not None:
        _add_arrays(digest, "controls", controls.arrays())
    if expressions is not None:
        digest.update(canonical(["expressions", expressions.digest().hex()]))
    if residual is not None:
        _add_arrays(digest, "residual", residual.arrays())
    if scan is not None:
        _add_arrays(digest, "scan", scan.arrays())
    return digest.hexdigest()[:16]


def mesh_arrays(mesh: Mesh) -> dict[str, NDArray[Any]]:
    """The arrays of a mesh by name, as they are stored and as its id is made of them."""
    arrays = {name: getattr(mesh, name) for name in _MESH_ARRAYS}
    # Only where there is one: a mesh near the origin keeps its id.
    return {**arrays, "centre": mesh.centre} if mesh.centre.any() else arrays


def _identity(settings: AssetSettings, given: bool) -> dict[str, Any]:
    """The settings that count for an id.  given: whether a graph was sent."""
    values, plain = settings.drawn(), GraphSettings()
    values["unit"] = settings.length_unit
    graph = values["graph"]
    if given and graph["wrinkles"] is None:
        graph["wrinkles"] = _WRINKLES_BEFORE
    graph["seed"] = settings.graph.start
    # The expressions that lines grow by are part of the id themselves.
    graph["lines"] = None
    values["graph"] = {k: v for k, v in graph.items() if k not in _LATER or v != getattr(plain, k)}
    for part, off in _OFF.items():
        kept = values[part].items()
        unread = given and part == "graph"
        values[part] = {k: v for k, v in kept if k not in off or not (unread or v == off[k])}
    return values


def _add_arrays(digest: hashlib._Hash, group: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Add name, dtype, shape and bytes of each array: no two sets of arrays give one stream."""
    digest.update(canonical([group, len(arrays)]))
    for name in sorted(arrays):
        little = arrays[name].astype(arrays[name].dtype.newbyteorder("<"), copy=False)
        digest.update(canonical([name, little.dtype.str, little.shape]))
        digest.update(np.ascontiguousarray(little).data)
