"""From the present shape of an object to its map."""

from __future__ import annotations

from hashlib import sha256
from time import monotonic

import bpy

from rhytid_client import Sampling, TileFormat
from rhytid_client.hosts import Drawing, Trouble
from rhytid_client.hosts.files import slug
from rhytid_client.hosts.trouble import NOT_SENT

from . import connection, images, meshes, state
from .typed import ours, there

# After a failure live updates leave the server alone that long.
SILENCE_SECONDS = 5.0


def live(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of the scene whose map follows the frame."""
    return [obj for obj in scene.objects if _has_map(obj) and ours(obj).live]


def _has_map(obj: bpy.types.Object) -> bool:
    return obj.type == "MESH" and ours(obj).asset != "" and not ours(obj).baked


def graph_of(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Depsgraph:
    """The dependency graph of the viewport that computes the object; raises Trouble."""
    for layer in scene.view_layers:
        if obj.name in layer.objects:
            layer.update()
            return there(layer.depsgraph, "a dependency graph")
    raise Trouble(f"'{obj.name}' is in no view layer of the scene")


def drawing(obj: bpy.types.Object, format: TileFormat = "exr") -> Drawing:
    """How maps of the object are asked for."""
    sampling: Sampling = "smooth" if ours(obj).smooth else "nearest"
    return Drawing(ours(obj).method, sampling, format)


def positions(obj: bpy.types.Object, graph: bpy.types.Depsgraph) -> meshes.Array:
    """Where its vertices are now; raises Trouble."""
    if not ours(obj).asset:
        raise Trouble(NOT_SENT)
    return meshes.evaluated(obj, graph, ours(obj).vertices)


def update(obj: bpy.types.Object, graph: bpy.types.Depsgraph) -> None:
    """Draw the map of the present shape and show it; raises Trouble.

    Where shape and settings are those of the map that is shown, nothing is asked.
    """
    status, given = state.status(obj.name), ours(obj)
    try:
        now, asked = positions(obj, graph), drawing(obj)
        digest = sha256(now.tobytes() + f"{given.asset} {asked}".encode()).hexdigest()
        if digest == status.digest and given.image is not None:
            status.text, status.failed = "Up to date", False
            return
        udims = given.udim_list()
        server, who = connection.server(), slug(obj.name)
        maps, status.of_frame = server.drawn(given.asset, who, now, udims, asked)
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
