"""Where the server is. The key is kept with the user's preferences, never in a .blend file."""

from typing import TYPE_CHECKING

import bpy
from bpy.props import StringProperty

from rhytid_client.hosts import Trouble


class RhytidPreferences(bpy.types.AddonPreferences):
    """Address and key of the server."""

    bl_idname = __package__

    if TYPE_CHECKING:
        server: str
        key: str
    else:  # Blender reads annotations, which hold calls
        server: StringProperty(
            name="Server",
            description="Address of the rhytid service",
            default="http://127.0.0.1:8717",
        )
        key: StringProperty(
            name="Key",
            description="API key of the service, as 'rhytid keys create' prints it; empty where "
            "the service asks for none",
            subtype="PASSWORD",
        )

    def draw(self, context: bpy.types.Context) -> None:
        """The two fields."""
        self.layout.prop(self, "server")
        self.layout.prop(self, "key")


def preferences() -> RhytidPreferences:
    """Those of this extension."""
    given = bpy.context.preferences
    kept = given.addons[__package__].preferences if given is not None else None
    if not isinstance(kept, RhytidPreferences):
        raise Trouble("Enable the extension 'Rhytid' in Preferences first")
    return kept


CLASSES = (RhytidPreferences,)
