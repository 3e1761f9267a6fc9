"""Meshes for the tests, and what the service says of them when it is asked without Blender."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import bpy
import numpy as np

SMILE = 10
# Frames of the animation: neutral at the first, the whole shape at the last.
FIRST, LAST = 1, 11


def add(name: str, positions: np.ndarray, faces: np.ndarray, uv: np.ndarray) -> bpy.types.Object:
    """An object of a mesh; uv (F, 3 or 4, 2) by corner."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    layer = mesh.uv_layers.new(name="map")
    layer.uv.foreach_set("vector", np.ascontiguousarray(uv, np.float32).ravel())
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


def animate(obj: bpy.types.Object, name: str, shape: np.ndarray) -> None:
    """A shape key that is off at FIRST and on at LAST, in even steps."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis")
    key = obj.shape_key_add(name=name, from_mix=False)
    key.data.foreach_set("co", np.ascontiguousarray(shape, np.float32).ravel())
    for frame, value in ((FIRST, 0.0), (LAST, 1.0)):
        key.value = value
        key.keyframe_insert("value", frame=frame)
    for curve in _curves(obj.data.shape_keys.animation_data.action):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = FIRST, LAST
    bpy.context.scene.frame_set(FIRST)


def _curves(action: bpy.types.Action) -> list[bpy.types.FCurve]:
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def share(frame: int) -> float:
    """How far the shape key is on."""
    return (frame - FIRST) / (LAST - FIRST)


def grid(
    count: int, side: float, udims: int = 1, texels: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A flat sheet of count² vertices that stand at centres of texels.

    side: of the square that a whole map covers.  texels: of a map's side, count if None; the sheet
    is in the middle of it.  udims: so many sheets beside each other.
    """
    texels = texels or count
    at = ((texels - count) // 2 + np.arange(count) + 0.5) / texels
    x, y = np.meshgrid(at, at)
    one = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
    i = np.arange(count * count).reshape(count, count)
    quads = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]], -1).reshape(-1, 4)
    positions = np.concatenate([one + np.array([u, 0.0, 0.0]) for u in range(udims)])
    faces = np.concatenate([quads + u * count * count for u in range(udims)])
    return positions * side, faces, positions[faces][..., :2]


def face() -> tuple[bpy.types.Object, np.ndarray, np.ndarray]:
    """The real face of RHYTID_FACE_DATA that smiles, else a sheet that is pressed together.

    Object, rest and shape, (V, 3) each.
    """
    data = Path(os.environ.get("RHYTID_FACE_DATA", "missing")) / "ict_face"
    rest, faces, uv, shape = _ict(data) if data.is_dir() else _sheet()
    obj = add("Face", rest, faces, uv)
    animate(obj, "smile", shape)
    return obj, rest, shape


def _sheet() -> tuple[np.ndarray, ...]:
    rest, faces, uv = grid(48, 12.0)
    shape = rest * (0.8, 1.1, 1.0)
    return rest, faces, uv, shape


def _ict(data: Path) -> tuple[np.ndarray, ...]:
    with np.load(data / "face.npz") as stored:
        rest, faces = stored["positions"], stored["quads"]
        uv = stored["uv"][stored["quads_uv"]]
        names = [str(name) for name in stored["expr_names"]]
        deltas = stored["expr_deltas"].astype(np.float32)
    weights = json.loads((data / "composites.json").read_text())["smile"]
    moved = sum(weight * deltas[names.index(name)] for name, weight in weights.items())
    return rest, faces, uv, rest + moved


def client_of(service: str) -> Any:
    """A client of the SDK that the package brings."""
    from rhytid_client import PlainClient

    return PlainClient(service)


def counts() -> dict[str, int]:
    """How many datablocks there are of each kind."""
    kinds = [p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"]
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}
