"""What Cycles and the mesh need beside a material, so that displacement is true."""

from __future__ import annotations

from typing import Any, cast

import bpy

from .typed import mesh_of, there

SUBDIVISION = "Rhytid subdivision"


def set_up(obj: bpy.types.Object, scene: bpy.types.Scene) -> list[str]:
    """Set scene and object up for true displacement; returns what was done."""
    return [*_engine(scene), *_subdivision(obj), *_smooth(obj)]


def _engine(scene: bpy.types.Scene) -> list[str]:
    # The stubs know only the engine that Blender starts with.
    scene.render.engine = "CYCLES"  # type: ignore[assignment]
    # Maps are changed while Blender renders: the viewport must not read them meanwhile.
    scene.render.use_lock_interface = True
    cycles = there(scene.cycles, "the settings of Cycles")
    if bpy.app.version < (5, 0, 0):
        # Before 5.0 adaptive subdivision is there with experimental features alone.
        cycles.feature_set = "EXPERIMENTAL"
    return ["Cycles with adaptive subdivision, interface locked while it renders"]


def _subdivision(obj: bpy.types.Object) -> list[str]:
    modifier = obj.modifiers[-1] if obj.modifiers else None
    if not isinstance(modifier, bpy.types.SubsurfModifier):
        modifier = cast("bpy.types.SubsurfModifier", obj.modifiers.new(SUBDIVISION, "SUBSURF"))
        modifier.subdivision_type = "CATMULL_CLARK" if _mostly_quads(mesh_of(obj)) else "SIMPLE"
    # The map is drawn for UV that are linear on each face.
    modifier.uv_smooth = "NONE"
    # Where it shows in the viewport, vertices are no longer those that were sent.
    modifier.show_viewport, modifier.show_render = False, True
    _adaptive(obj, modifier)
    return [f"'{modifier.name}' adaptive, at render time only, UV not smoothed"]


def _adaptive(obj: bpy.types.Object, modifier: Any) -> None:
    # Blender 5.0 moved it from the object to the modifier.
    if hasattr(modifier, "use_adaptive_subdivision"):
        modifier.use_adaptive_subdivision = True
    else:
        there(obj.cycles, "the settings of Cycles").use_adaptive_subdivision = True


def _smooth(obj: bpy.types.Object) -> list[str]:
    mesh = mesh_of(obj)
    if all(polygon.use_smooth for polygon in mesh.polygons):
        return []
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.update()
    return ["smooth shading: flat faces come apart where they are displaced"]


def _mostly_quads(mesh: bpy.types.Mesh) -> bool:
    return 2 * sum(len(polygon.vertices) == 4 for polygon in mesh.polygons) > len(mesh.polygons)
