"""A tile or a map that another process plans and draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rhytid.engine.messages import Tile, TilePlan
from rhytid.engine_process.requests import Request
from rhytid.formats.tile_header import TileHeader

# Key, header and side.
Facts = tuple[str, TileHeader, int]


class RemotePlan(TilePlan):
    """As `TilePlan`; it is planned by the call that draws it, where nobody asks for the key before.

    call: asks the process.  kind: tile, map or once.  side: where it is known.  facts: the same.
    """

    def __init__(
        self,
        call: Callable[[Request], Any],
        kind: str,
        arguments: tuple[Any, ...],
        side: int | None,
        facts: Facts | None = None,
    ) -> None:
        self._call, self._kind, self._arguments = call, kind, arguments
        self._facts, self._side = facts, side
        self._drawn = ""

    def facts(self) -> Facts:
        """Key, header and side, asked for where they are not known."""
        if self._facts is None:
            facts: Facts = self._call(Request(f"plan_{self._kind}", self._arguments))
            self._facts = facts
        return self._facts

    @property
    def key(self) -> str:
        """As of `TilePlan`."""
        return self.facts()[0]

    @property
    def header(self) -> TileHeader:
        """As of `TilePlan`."""
        return self.facts()[1]

    @property
    def side(self) -> int:
        """As of `TilePlan`."""
        return self.facts()[2] if self._side is None else self._side

    def draw(self) -> Tile:
        """As of `TilePlan`."""
        request = Request(f"draw_{self._kind}", self._arguments, room=self.nbytes)
        tile: Tile
        tile, facts, self._drawn = self._call(request)
        self._facts = self._facts or facts
        return tile

    def key_now(self) -> str:
        """As of `TilePlan`."""
        return self._drawn
