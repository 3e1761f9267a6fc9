"""What a host application gives: one mesh in its scene, and how maps are shown on it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from numpy.typing import ArrayLike

from rhytid_client.hosts.meshes import MeshArrays
from rhytid_client.hosts.sequences import MapSequence, Style
from rhytid_client.hosts.work import Progress


@dataclass(frozen=True)
class Display:
    """Maps, and the values that they are shown with.

    start: the frame of the scene that plays the first of them.  scale: factor of their heights,
    which makes them lengths of the scene, times strength.  bound: no height is farther from 0 then;
    None where unknown.
    """

    maps: MapSequence
    start: int
    scale: float
    bound: float | None


class Scene(Protocol):
    """One mesh in the scene of a host.

    name: of the mesh, for messages and files.  unit: of its positions, as "cm".
    """

    @property
    def name(self) -> str: ...  # noqa: D102

    @property
    def unit(self) -> str: ...  # noqa: D102

    def rest(self) -> MeshArrays | Path:
        """The mesh that is not deformed, or a file of it; raises Trouble."""

    def positions(self, frame: int) -> ArrayLike:
        """Where its vertices are at a frame, (V, 3), in its own space; raises Trouble."""

    def frame(self) -> int:
        """The frame that the scene shows."""

    def frames(self) -> Sequence[int]:
        """The frames of the animation."""

    def working(self, title: str) -> AbstractContextManager[Progress]:
        """While work is done: shows how far it is, and the frame of before is back at the end."""

    def style(self, udims: Sequence[int]) -> Style:
        """What files of maps must be called, so that the host reads them."""

    def show(self, display: Display) -> list[str]:
        """Set nodes up for maps; returns what was done, and what is left for the user."""
