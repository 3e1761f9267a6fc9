"""The skin of one mesh of a host: sent, drawn, baked, shown."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhytid_client.choices import Method
from rhytid_client.hosts.baking import baking
from rhytid_client.hosts.files import folder_at, slug
from rhytid_client.hosts.meshes import Floats, counted
from rhytid_client.hosts.scene import Display, Scene
from rhytid_client.hosts.sequences import MapSequence, copied, found
from rhytid_client.hosts.server import Drawing, Server
from rhytid_client.hosts.trouble import NOT_SENT, Trouble
from rhytid_client.hosts.units import factor
from rhytid_client.hosts.work import Step, finish
from rhytid_client.results import Asset

_EDITED = "it was edited, or something in its history changes them; send it again"


class Skin:
    """The skin of one mesh: sent to the service, drawn by it, and shown by the host.

    strength: factor of the heights.  Every method raises Trouble, whose text is for the user, and
    those that take long Cancelled.
    """

    def __init__(self, scene: Scene, server: Server, *, strength: float = 1.0) -> None:
        self._scene = scene
        self._server = server
        self._strength = strength
        self._asset: Asset | None = None

    @property
    def asset(self) -> Asset:
        """The mesh as the server has it; raises Trouble before it was sent."""
        if self._asset is None:
            raise Trouble(NOT_SENT)
        return self._asset

    def send(
        self,
        *,
        resolution: int = 2048,
        expressions: Iterable[int] = (),
        settings: Mapping[str, Any] | None = None,
    ) -> tuple[str, ...]:
        """Send the rest shape and have skin grown on it; returns warnings.

        resolution: texels per side of a map.  expressions: frames of strong expressions: lines grow
        where they fold the face.  settings: more of those of an asset. The same mesh with the same
        settings is found again and not grown anew.
        """
        given = {"resolution": resolution, **(settings or {}), "unit": self._scene.unit}
        with self._scene.working("Send the mesh") as progress:
            shapes = {f"frame {n}": np.asarray(self._scene.positions(n)) for n in expressions}
            steps = self._server.sending(self._scene.rest(), given, shapes or None)
            self._asset = finish(steps, progress)
        return tuple(str(warning) for warning in self._asset.warnings)

    def draw(self, folder: str | Path, *, method: Method = "redraw") -> list[str]:
        """Draw the maps of the frame that the scene shows, and show them; returns what was done."""
        return self.bake(folder, [self._scene.frame()], method=method)

    def bake(
        self,
        folder: str | Path,
        frames: Sequence[int] | None = None,
        *,
        method: Method = "redraw",
        half: bool = False,
    ) -> list[str]:
        """Draw frames as files, and show them; returns what was done, and warnings.

        frames: ascending, those of the animation unless given.  half: 16-bit floats, within 0.05 %
        of each height.
        """
        drawing = Drawing(method, format="exr16" if half else "exr")
        maps = self._maps(folder_at(Path(folder)), frames)
        with self._scene.working("Bake maps") as progress:
            warned = finish(self._steps(maps, drawing), progress)
        return [*self._show(maps, maps.frames[0]), *warned]

    def open(self, folder: str | Path, name: str = "", start: int | None = None) -> list[str]:
        """Show the maps that `rhytid bake` left in a folder; returns what was done.

        name: NAME of NAME.<UDIM>.<FRAME>.exr, needed where there are several.  start: the frame of
        the scene that plays the first file, its number unless given. Where the host needs other
        names, files are copied into a folder `renamed` in it.
        """
        maps = found(Path(folder), name)
        style = self._scene.style(maps.udims)
        if style[0] != _pattern(maps) or style[1] < maps.digits:
            maps = copied(maps, folder_at(Path(folder) / "renamed"), style)
        return self._show(maps, maps.frames[0] if start is None else start)

    def _maps(self, folder: Path, frames: Sequence[int] | None) -> MapSequence:
        asset, numbers = self.asset, sorted(set(self._scene.frames() if frames is None else frames))
        if frames is None:  # a range that begins before 0 has a part that can be baked
            numbers = [number for number in numbers if number >= 0]
        if not numbers:
            raise Trouble("There are no frames to bake: they are numbered from 0 on")
        if numbers[0] < 0:
            raise Trouble(f"Frame {numbers[0]} cannot be baked: they are numbered from 0 on")
        name, style = slug(self._scene.name), self._scene.style(asset.udims)
        maps = MapSequence.of(folder, name, style, asset.udims, numbers)
        return replace(maps, unit=self._scene.unit, bound=self._server.bound(asset))

    def _steps(self, maps: MapSequence, drawing: Drawing) -> Generator[Step, None, tuple[str, ...]]:
        return baking(self._server, self.asset.id, maps, self._positions, drawing)

    def _positions(self, frame: int) -> Floats:
        now = self._scene.positions(frame)
        return counted(self._scene.name, now, self.asset.vertices, _EDITED)

    def _show(self, maps: MapSequence, start: int) -> list[str]:
        scale = factor(maps.unit, self._scene.unit) * self._strength
        bound = None if maps.bound is None else maps.bound * abs(scale)
        return self._scene.show(Display(maps, start, scale, bound))


def _pattern(maps: MapSequence) -> str:
    """The names of a sequence, as a style has them."""
    return Path(maps.pattern).name.replace(maps.name, "{name}", 1)
