"""Camera, light and colour for a face, so that wrinkles are seen."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from mathutils import Vector

SKIN = (0.55, 0.34, 0.26, 1.0)


def light_up(
    obj: bpy.types.Object, at: Sequence[float] | None, width: float | None, size: Sequence[int]
) -> None:
    """A camera in front, a grazing light from the side and a weak one from the front.

    at: where the camera looks, in the object's own numbers, its middle if None.  width: of the
    picture there.  size: pixels.
    """
    scene = bpy.context.scene
    bpy.context.view_layer.update()
    corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
    low = Vector(min(c[axis] for c in corners) for axis in range(3))
    high = Vector(max(c[axis] for c in corners) for axis in range(3))
    target = obj.matrix_world @ Vector(at) if at else (low + high) / 2
    reach = (high - low).length
    wide = width or 1.1 * max(high.x - low.x, (high.z - low.z) * size[0] / size[1])
    scene.camera = _camera(target, wide, reach)
    _light("key", target + Vector((1.0, -0.1, 0.35)) * 2 * reach, target, 0.2 * reach, 14.0)
    _light("fill", target + Vector((-0.4, -1.0, 0.2)) * 2 * reach, target, reach, 2.0)
    _world(scene)
    _skin(obj)
    render = scene.render
    render.resolution_x, render.resolution_y = size
    render.image_settings.file_format = "PNG"
    # What a denoiser takes for noise is skin.
    scene.cycles.samples, scene.cycles.use_denoising = 16, False
    scene.cycles.dicing_rate, scene.cycles.offscreen_dicing_scale = 1.0, 16.0


def _camera(target: Vector, wide: float, reach: float) -> bpy.types.Object:
    """In front of the face, which looks along -y, far enough away for true proportions."""
    camera = bpy.data.cameras.new("camera")
    away = max(2.5 * wide, 0.5 * reach)
    camera.sensor_width, camera.lens, camera.clip_end = 36.0, 36.0 * away / wide, 10.0 * reach
    seat = bpy.data.objects.new("camera", camera)
    bpy.context.scene.collection.objects.link(seat)
    side = 0.35 if target.x > 0.05 * reach else 0.0
    seat.location = target + Vector((side, -1.0, 0.05)).normalized() * away
    seat.rotation_euler = (target - seat.location).to_track_quat("-Z", "Y").to_euler()
    return seat


def _light(name: str, place: Vector, target: Vector, size: float, strength: float) -> None:
    """strength: as bright at any distance."""
    light = bpy.data.lights.new(name, "AREA")
    light.size, light.energy = size, strength * (target - place).length_squared
    thing = bpy.data.objects.new(name, light)
    bpy.context.scene.collection.objects.link(thing)
    thing.location = place
    thing.rotation_euler = (target - place).to_track_quat("-Z", "Y").to_euler()


def _world(scene: bpy.types.Scene) -> None:
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"].inputs[0]
    background.default_value = (0.05, 0.05, 0.06, 1.0)


def _skin(obj: bpy.types.Object) -> None:
    shader = obj.active_material.node_tree.nodes.get("Principled BSDF")
    if shader is None:
        tree = obj.active_material.node_tree
        shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
        output = tree.get_output_node("CYCLES")
        tree.links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    shader.inputs["Base Color"].default_value = SKIN
    shader.inputs["Roughness"].default_value = 0.4
