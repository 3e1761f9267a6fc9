"""The server of the preferences, and whether Blender may ask it."""

from __future__ import annotations

from urllib.parse import urlsplit

import bpy

from rhytid_client.hosts import Server, Trouble
from rhytid_client.hosts.server import address

from .preferences import preferences

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def server() -> Server:
    """The server; raises Trouble where Blender may not go online and it is another machine."""
    given = preferences()
    url = address(given.server)
    if urlsplit(url).hostname not in _LOOPBACK and not bpy.app.online_access:
        raise Trouble(
            f"{url} is another machine, and Blender may not go online: allow it in Preferences, "
            "System, Network"
        )
    return Server(url, given.key.strip())
