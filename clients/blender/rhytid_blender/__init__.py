"""Wrinkles of the rhytid service on an animated mesh, as displacement."""

import bpy

from . import bake, handlers, operators, panel, preferences, properties, state

MODULES = (preferences, properties, operators, bake, panel)


def register() -> None:
    """Make classes, properties and handlers known to Blender."""
    for module in MODULES:
        for kind in module.CLASSES:
            bpy.utils.register_class(kind)
    pointer = bpy.props.PointerProperty(type=properties.RhytidProperties)  # type: ignore[func-returns-value]
    bpy.types.Object.rhytid = pointer  # type: ignore[attr-defined]
    handlers.add()


def unregister() -> None:
    """Take back what `register` did; maps and materials of a file stay as they are."""
    handlers.remove()
    state.forget()
    del bpy.types.Object.rhytid  # type: ignore[attr-defined]
    for module in reversed(MODULES):
        for kind in reversed(module.CLASSES):
            bpy.utils.unregister_class(kind)
