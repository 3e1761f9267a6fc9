"""Frames of a scene as files of displacement."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path

from numpy.typing import ArrayLike

from rhytid_client.hosts.files import replaced, slug
from rhytid_client.hosts.sequences import MapSequence
from rhytid_client.hosts.server import Drawing, Server
from rhytid_client.hosts.work import Step


def baking(
    server: Server,
    asset: str,
    maps: MapSequence,
    positions: Callable[[int], ArrayLike],
    drawing: Drawing,
) -> Generator[Step, None, tuple[str, ...]]:
    """Draw each frame of `maps` and write its files, one frame a step; returns warnings.

    positions: (V, 3) at a frame. Closed, it leaves the files of the frames before, whole. Raises
    Trouble.
    """
    warned: dict[str, None] = {}
    count, who = len(maps.frames), f"bake-{slug(maps.name)}"
    for done, frame in enumerate(maps.frames):
        yield done / count, f"frame {frame} of {maps.frames[-1]}", 0.0
        drawn, found = server.drawn(asset, who, positions(frame), maps.udims, drawing)
        warned |= dict.fromkeys(found)
        for udim, data in drawn.items():
            replaced(Path(maps.file(udim, frame)), data)
    return tuple(warned)
