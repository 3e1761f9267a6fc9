"""Where the server is. The key is kept with the user's preferences, never in a .blend file."""

import bpy
from bpy.props import StringProperty


class RhytidPreferences(bpy.types.AddonPreferences):
    """Address and key of the server."""

    bl_idname = __package__

    server: StringProperty(
        name="Server",
        description="Address of the rhytid service",
        default="http://127.0.0.1:8717",
    )
    key: StringProperty(
        name="Key",
        description="API key of the service, as 'rhytid keys create' prints it; empty where the "
        "service asks for none",
        subtype="PASSWORD",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """The two fields."""
        self.layout.prop(self, "server")
        self.layout.prop(self, "key")


def preferences() -> RhytidPreferences:
    """Those of this extension."""
    return bpy.context.preferences.addons[__package__].preferences


CLASSES = (RhytidPreferences,)
