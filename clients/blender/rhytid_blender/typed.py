"""What Blender gives, as the type that it has where this extension asks for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar

import bpy

from rhytid_client.hosts import Trouble

from .words import NO_MESH

if TYPE_CHECKING:
    # What operators share is a part of one, whose methods type checkers then know.
    OperatorPart = bpy.types.Operator
else:
    OperatorPart = object

T = TypeVar("T")
# What a method of an operator returns.
Result = set[Literal["RUNNING_MODAL", "CANCELLED", "FINISHED", "PASS_THROUGH", "INTERFACE"]]


def mesh_of(obj: bpy.types.Object) -> bpy.types.Mesh:
    """The mesh of an object; raises Trouble for one of another kind."""
    if not isinstance(obj.data, bpy.types.Mesh):
        raise Trouble(NO_MESH)
    return obj.data


def scene_of(context: bpy.types.Context) -> bpy.types.Scene:
    """The scene of a context."""
    return there(context.scene, "a scene")


def window_manager_of(context: bpy.types.Context) -> bpy.types.WindowManager:
    """The window manager of a context."""
    return there(context.window_manager, "a window manager")


def tree_of(material: bpy.types.Material) -> bpy.types.ShaderNodeTree:
    """The nodes of a material, made where it has none."""
    if material.node_tree is None:
        material.use_nodes = True
    return there(material.node_tree, f"nodes in '{material.name}'")


def there(value: T | None, what: str) -> T:
    """A value that is always there, though Blender's types let it be missing; raises Trouble."""
    if value is None:
        raise Trouble(f"Blender has not given {what}")
    return value
