"""What host applications, programs with a scene of their own, have in common: Blender, Maya,
Houdini, Unreal. Python and numpy alone.

A host gives a `Scene`: the rest shape of a mesh, its positions at a frame, and how maps are shown.
A `Skin` over it sends the mesh, bakes its frames and has them shown.
"""

from __future__ import annotations

from rhytid_client.hosts.meshes import MeshArrays, polygons, welded
from rhytid_client.hosts.scene import Display, Scene
from rhytid_client.hosts.sequences import MapSequence, found
from rhytid_client.hosts.server import Drawing, Scan, Server
from rhytid_client.hosts.skin import Skin
from rhytid_client.hosts.trouble import Trouble
from rhytid_client.hosts.work import Cancelled, Progress, finish

__all__ = [
    "Cancelled",
    "Display",
    "Drawing",
    "MapSequence",
    "MeshArrays",
    "Progress",
    "Scan",
    "Scene",
    "Server",
    "Skin",
    "Trouble",
    "finish",
    "found",
    "polygons",
    "welded",
]
