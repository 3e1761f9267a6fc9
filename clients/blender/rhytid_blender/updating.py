"""From the present shape of an object to its map."""

from __future__ import annotations

from hashlib import sha256
from time import monotonic

import bpy

from . import connection, images, meshes, state
from .words import NOT_SENT, Trouble

# After a failure live updates leave the server alone that long.
SILENCE_SECONDS = 5.0


def live(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of the scene whose map follows the frame."""
    return [obj for obj in scene.objects if _has_map(obj) and obj.rhytid.live]


def _has_map(obj: bpy.types.Object) -> bool:
    return obj.type == "MESH" and obj.rhytid.asset != "" and not obj.rhytid.baked


def graph_of(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Depsgraph:
    """The dependency graph of the viewport that computes the object; raises Trouble."""
    for layer in scene.view_layers:
        if obj.name in layer.objects:
            layer.update()
            return layer.depsgraph
    raise Trouble(f"'{obj.name}' is in no view layer of the scene")


def query(obj: bpy.types.Object, format: str = "exr") -> dict[str, str]:
    """How maps of the object are asked for."""
    sampling = "smooth" if obj.rhytid.smooth else "nearest"
    return {"method": obj.rhytid.method, "sampling": sampling, "format": format}


def positions(obj: bpy.types.Object, graph: bpy.types.Depsgraph) -> meshes.Array:
    """Where its vertices are now; raises Trouble."""
    if not obj.rhytid.asset:
        raise Trouble(NOT_SENT)
    return meshes.evaluated(obj, graph, obj.rhytid.vertices)


def update(obj: bpy.types.Object, graph: bpy.types.Depsgraph) -> None:
    """Draw the map of the present shape and show it; raises Trouble.

    Where shape and settings are those of the map that is shown, nothing is asked.
    """
    status, given = state.status(obj.name), obj.rhytid
    try:
        now, asked = positions(obj, graph), query(obj)
        digest = sha256(now.tobytes() + f"{given.asset} {asked}".encode()).hexdigest()
        if digest == status.digest and given.image is not None:
            status.text, status.failed = "Up to date", False
            return
        udims = given.udim_list()
        who = images.slug(obj.name)
        maps, status.of_frame = connection.drawn(given.asset, who, now, udims, asked)
        images.image_of(obj, images.written(obj.name, maps), udims)
    except Trouble as trouble:
        status.text, status.failed, status.digest = str(trouble), True, ""
        status.silent_until = monotonic() + SILENCE_SECONDS
        raise
    status.text, status.failed, status.digest = "Up to date", False, digest


def quietly(obj: bpy.types.Object, graph: bpy.types.Depsgraph) -> None:
    """The same for the viewport: what goes wrong is shown by the panel."""
    if monotonic() < state.status(obj.name).silent_until:
        return
    try:
        update(obj, graph)
    except Trouble as trouble:
        print(f"rhytid: {trouble}")  # noqa: T201
