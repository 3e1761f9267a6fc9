"""From the present shape of an object to its map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from hashlib import sha256
from time import monotonic

import bpy

from rhytid_client import Sampling, TileFormat, npy
from rhytid_client.hosts import Drawing, Trouble, baking
from rhytid_client.hosts.files import slug
from rhytid_client.hosts.trouble import NOT_SENT

from . import connection, images, meshes, shine, state
from .properties import ours, trees
from .typed import there
from .words import copied

# After a failure live updates leave the server alone that long.
SILENCE_SECONDS = 5.0


def following(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects of the scene whose map is to follow the frame."""
    return [obj for obj in scene.objects if _has_map(obj) and ours(obj).live]


def live(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Those of them that are in a view layer, copies last."""
    layers = scene.view_layers
    found = [o for o in following(scene) if any(o.name in layer.objects for layer in layers)]
    return sorted(found, key=_is_of_copy)


def _is_of_copy(obj: bpy.types.Object) -> tuple[bool, bool]:
    """What drew the present map comes first, then what the image was made for."""
    image = ours(obj).image
    drew = image is not None and state.status(obj).path == image.filepath
    return not drew, images.is_of_copy(obj)


def rendered(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Those of them that are not disabled in renders."""
    shown = in_renders(scene)
    return [obj for obj in live(scene) if obj in shown]


def in_renders(scene: bpy.types.Scene) -> set[bpy.types.Object]:
    """The meshes of the scene's view layers that are not disabled in renders."""
    of_layers = {obj for layer in scene.view_layers for obj in layer.objects}
    return {obj for obj in _shown(scene.collection) if obj.type == "MESH" and obj in of_layers}


def _shown(collection: bpy.types.Collection) -> Iterator[bpy.types.Object]:
    yield from (obj for obj in collection.objects if not obj.hide_render)
    for child in collection.children:
        if not child.hide_render:
            yield from _shown(child)


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


def update(
    obj: bpy.types.Object, graph: bpy.types.Depsgraph, others: Sequence[bpy.types.Object] = ()
) -> None:
    """Draw the map of the present shape and show it; raises Trouble.

    Where shape and settings are those of the map that is shown, nothing is asked.  others: objects
    that follow the frame. The first that has the image of `obj` draws it; a copy of it, which has
    the same image, must have its shape.
    """
    status = state.status(obj)
    try:
        now, asked = positions(obj, graph), drawing(obj)
        settings = f"{ours(obj).asset} {asked} {_roughness(obj)}"
        digest = sha256(now.tobytes() + settings.encode()).hexdigest()
        drawer = _drawer(obj, graph, others)
        if not _is_shown(drawer, digest):
            if drawer != obj:
                raise _not_drawn(obj, drawer)
            _draw(obj, now, asked)
            status.digest = digest
    except Trouble as trouble:
        status.text, status.failed, status.digest = str(trouble), True, ""
        status.silent_until = monotonic() + SILENCE_SECONDS
        raise
    status.text, status.failed = "Up to date", False


def _drawer(
    obj: bpy.types.Object, graph: bpy.types.Depsgraph, others: Sequence[bpy.types.Object]
) -> bpy.types.Object:
    image = ours(obj).image
    if image is None:
        return obj
    same = (other for other in others if ours(other).image == image)
    return next((other for other in same if other.evaluated_get(graph).is_evaluated), obj)


def _not_drawn(obj: bpy.types.Object, drawer: bpy.types.Object) -> Trouble:
    status = state.status(drawer)
    return Trouble(status.text if status.failed else copied(obj.name, drawer.name))


def _roughness(obj: bpy.types.Object) -> float | None:
    """Of skin without relief; None where no shine is asked for."""
    return ours(obj).roughness if ours(obj).shine else None


def _is_shown(obj: bpy.types.Object, digest: str) -> bool:
    status, given, udims = state.status(obj), ours(obj), ours(obj).udim_list()
    shown = images.shows(given.image, status.path, udims)
    if given.shine:
        shown = shown and images.shows(given.shine_image, status.shine_path, udims)
    return shown and digest == status.digest


def _draw(obj: bpy.types.Object, now: meshes.Array, asked: Drawing) -> None:
    given, status, roughness = ours(obj), state.status(obj), _roughness(obj)
    udims, drawings = given.udim_list(), [asked]
    if roughness is not None:
        drawings.append(baking.slopes(asked))
    found, status.of_frame = connection.server().drawn_each(
        given.asset, slug(obj.name), now, udims, drawings
    )
    image = images.image_of(obj, images.written(obj, found[0]), udims)
    status.path = image.filepath
    if roughness is not None:
        files = {
            udim: baking.shine(npy.decode(data), roughness, quick=True)
            for udim, data in found[1].items()
        }
        image = images.shine_of(obj, images.written(obj, files, "png"), udims)
        status.shine_path = image.filepath
        show_shine(obj, image, roughness)


def show_shine(obj: bpy.types.Object, image: bpy.types.Image, roughness: float) -> None:
    """Have materials shine by a map that was drawn, once they have our displacement; raises Trouble
    where none can."""
    shine.set_base(obj, roughness)
    if trees(obj) and not shine.connected(obj, image):
        shine.connect(obj, image)


def quietly(
    obj: bpy.types.Object, graph: bpy.types.Depsgraph, others: Sequence[bpy.types.Object]
) -> None:
    """The same for the viewport: what goes wrong is shown by the panel."""
    if monotonic() < state.status(obj).silent_until:
        return
    try:
        update(obj, graph, others)
    except Trouble as trouble:
        print(f"rhytid: {trouble}")  # noqa: T201
