"""Meshes of Blender as arrays: the rest shape, its shapes, and what modifiers make of it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from rhytid_client.hosts import Trouble, welded
from rhytid_client.hosts.trouble import no_uv

from .typed import mesh_of
from .words import count_changed, hidden

Array = np.ndarray
# Modifiers that may change the number of vertices.
COUNT_CHANGING = {
    *(
        "ARRAY",
        "BEVEL",
        "BOOLEAN",
        "BUILD",
        "DECIMATE",
        "EDGE_SPLIT",
        "MASK",
        "MESH_SEQUENCE_CACHE",
    ),
    *("MIRROR", "MULTIRES", "NODES", "REMESH", "SCREW", "SKIN", "SOLIDIFY", "SUBSURF", "WELD"),
    *("WIREFRAME",),
}


def rest(obj: bpy.types.Object) -> dict[str, Array]:
    """positions (V, 3), faces (F, 3), uv (T, 2), face_uv (F, 3) of the shape without modifiers.

    In the object's own space; faces are Blender's triangles. Raises Trouble without faces or UV.
    """
    obj.update_from_editmode()
    mesh = mesh_of(obj)
    layer = _uv_layer(mesh)
    if layer is None:
        raise Trouble(no_uv(obj.name))
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    if count == 0:
        raise Trouble(f"'{obj.name}' has no faces")
    faces = _ints(mesh.loop_triangles, "vertices", 3 * count).reshape(-1, 3)
    corners = _ints(mesh.loop_triangles, "loops", 3 * count).reshape(-1, 3)
    uv, of_corner = _welded(mesh, layer)
    return {"positions": _rest(mesh), "faces": faces, "uv": uv, "face_uv": of_corner[corners]}


def uv_map(obj: bpy.types.Object) -> str:
    """The name of the UV map that is sent, the one that renders."""
    layer = _uv_layer(mesh_of(obj))
    return "" if layer is None else layer.name


def shapes(obj: bpy.types.Object) -> dict[str, Array] | None:
    """Positions (V, 3) of each shape key by name, as if it alone were on; None where there are
    none."""
    keys = mesh_of(obj).shape_keys
    if keys is None or len(keys.key_blocks) < 2:
        return None
    found = {}
    reference = _rest(mesh_of(obj))
    for key in keys.key_blocks:
        if key != keys.reference_key:
            offset = _of_key(key) - _of_key(key.relative_key)
            found[key.name] = reference + offset if keys.use_relative else _of_key(key)
    return found


def evaluated(obj: bpy.types.Object, graph: bpy.types.Depsgraph, vertices: int) -> Array:
    """Positions (V, 3) after shape keys and modifiers, in the object's own space.

    graph: of the viewport.  vertices: how many were sent. Raises Trouble where there are others.
    """
    made = obj.evaluated_get(graph)
    if not made.is_evaluated:
        raise Trouble(hidden(obj.name))
    mesh = mesh_of(made)
    count = len(mesh.vertices)
    if count != vertices:
        shown = [m.name for m in obj.modifiers if m.show_viewport and m.type in COUNT_CHANGING]
        raise Trouble(count_changed(obj.name, vertices, count, shown))
    return _floats(mesh.vertices, "co", 3 * count).reshape(-1, 3)


def _uv_layer(mesh: bpy.types.Mesh) -> Any:
    return next((layer for layer in mesh.uv_layers if layer.active_render), None)


def rest_positions(obj: bpy.types.Object) -> Array:
    """Positions (V, 3) of the shape without modifiers and with no shape key on."""
    return _rest(mesh_of(obj))


def _rest(mesh: bpy.types.Mesh) -> Array:
    if mesh.shape_keys is not None:
        return _of_key(mesh.shape_keys.reference_key)
    return _floats(mesh.vertices, "co", 3 * len(mesh.vertices)).reshape(-1, 3)


def _of_key(key: bpy.types.ShapeKey) -> Array:
    return _floats(key.data, "co", 3 * len(key.data)).reshape(-1, 3)


def _welded(mesh: bpy.types.Mesh, layer: Any) -> tuple[Array, Array]:
    """uv (T, 2) and the row of each corner."""
    count = len(mesh.loops)
    vertices = _ints(mesh.loops, "vertex_index", count)
    return welded(vertices, _floats(layer.uv, "vector", 2 * count))


def _floats(items: Any, name: str, count: int) -> Array:
    values = np.empty(count, np.float32)
    items.foreach_get(name, values)
    return values


def _ints(items: Any, name: str, count: int) -> Array:
    values = np.empty(count, np.int32)
    items.foreach_get(name, values)
    return values
