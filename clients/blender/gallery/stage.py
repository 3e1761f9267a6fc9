"""The scene around the maps: face with its animation, skin, eyes, camera and lights.

None of it is the extension's: that brings displacement, subdivision and the settings of Cycles.
"""

from __future__ import annotations

from math import cos, radians, sin

import bpy
import numpy as np
from face import Face
from mathutils import Matrix, Vector
from shots import View

SKIN_COLOUR = (0.56, 0.35, 0.27, 1.0)
LIGHT_FAR, KEY_SIZE, KEY_POWER = 60.0, 8.0, 62000.0
FILL_SIZE, FILL_POWER = 45.0, 5000.0
# The lids stay in front of the eye when their edges are displaced.
EYE_SHARE = 0.985


def build(face: Face, weights: np.ndarray, eyes: bool = True) -> bpy.types.Object:
    """An empty scene with the animated face, eyes unless it has its own, and a grey world; returns
    the face."""
    scene = bpy.context.scene
    obj = _face_object(face)
    _animate(obj, face, weights)
    for centre, radius in face.eyes() if eyes else ():
        _eye(centre, EYE_SHARE * radius)
    scene.frame_start, scene.frame_end = 1, len(weights)
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.05, 0.05, 0.06, 1)
    scene.view_settings.view_transform = "Filmic"
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


def look(view: View) -> None:
    """Set camera, lights and size of the picture to those of a view."""
    scene = bpy.context.scene
    for kind in ("camera", "key", "fill"):
        if old := bpy.data.objects.get(kind):
            bpy.data.objects.remove(old)
    target, turn = _up(view.at), radians(view.turn)
    away = max(2.5 * view.width, 16.0)
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.sensor_width, lens.lens = "HORIZONTAL", 36.0, 36.0 * away / view.width
    lens.clip_start, lens.clip_end = 0.1, 1000.0
    scene.camera = _placed("camera", lens, target + away * _up((sin(turn), 0.0, cos(turn))), target)
    _light("key", KEY_SIZE, KEY_POWER, (1.0, 0.97, 0.93), view.light, target)
    _light("fill", FILL_SIZE, FILL_POWER, (0.8, 0.9, 1.0), (-0.5, 0.2, 1.0), target)
    scene.render.resolution_x, scene.render.resolution_y = view.size


def _face_object(face: Face) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("face")
    mesh.from_pydata(face.rest.tolist(), [], face.quads.tolist())
    corners = np.ascontiguousarray(face.uv[face.quads_uv], np.float32)
    mesh.uv_layers.new(name="uv").uv.foreach_set("vector", corners.ravel())
    mesh.materials.append(_skin())
    obj = bpy.data.objects.new("face", mesh)
    # y is up in the file, z in Blender; its importers turn the object as well.
    obj.rotation_euler = (radians(90), 0.0, 0.0)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _animate(obj: bpy.types.Object, face: Face, weights: np.ndarray) -> None:
    """Shape keys of all expressions, with a key at every frame."""
    obj.shape_key_add(name="Basis")
    for name, offset, curve in zip(face.names, face.offsets, weights.T, strict=True):
        key = obj.shape_key_add(name=name, from_mix=False)
        key.slider_min, key.slider_max = -1.0, 2.0
        key.data.foreach_set("co", (face.rest + offset).astype(np.float32).ravel())
        for frame, weight in enumerate(curve, start=1):
            key.value = weight
            key.keyframe_insert("value", frame=frame)


def _skin() -> bpy.types.Material:
    material = bpy.data.materials.new("skin")
    material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = SKIN_COLOUR
    inputs["Roughness"].default_value = 0.42
    inputs["Subsurface Weight"].default_value = 0.15
    inputs["Subsurface Radius"].default_value = (0.1, 0.04, 0.02)
    return material


def _eye(centre: np.ndarray, radius: float) -> None:
    """A sphere that looks ahead: white, with a dark disc for the iris."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=radius)
    eye = bpy.context.object
    eye.location = _up(centre)
    # Its pole, around which the rings run, looks ahead.
    eye.rotation_euler = (radians(90), 0.0, 0.0)
    for polygon in eye.data.polygons:
        polygon.use_smooth = True
    for name, colour in (("white", (0.55, 0.5, 0.47, 1)), ("iris", (0.03, 0.025, 0.02, 1))):
        material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
        material.use_nodes = True
        inputs = material.node_tree.nodes["Principled BSDF"].inputs
        inputs["Base Color"].default_value, inputs["Roughness"].default_value = colour, 0.2
        eye.data.materials.append(material)
    for polygon in eye.data.polygons:
        polygon.material_index = int(polygon.center.z > 0.915 * radius)


def _light(
    name: str,
    size: float,
    power: float,
    colour: tuple[float, float, float],
    direction: tuple[float, float, float],
    target: Vector,
) -> None:
    light = bpy.data.lights.new(name, "AREA")
    light.size, light.energy, light.color = size, power, colour
    _placed(name, light, target + LIGHT_FAR * _up(direction).normalized(), target)


def _placed(name: str, data: bpy.types.ID, place: Vector, target: Vector) -> bpy.types.Object:
    """An object of the data, at a place, that faces the target."""
    obj = bpy.data.objects.new(name, data)
    obj.matrix_world = Matrix.Translation(place) @ (
        (target - place).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    )
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _up(point: object) -> Vector:
    """A point of the face in the world of Blender, whose z is up."""
    x, y, z = point
    return Vector((x, -z, y))
