"""What the process of a device answers: the calls of its engine."""

from __future__ import annotations

import io
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.tiles import TileAddress
from rhytid.engine.engine import Engine
from rhytid.engine.messages import AssetInfo, MapQuery, NewAsset
from rhytid.engine.tile_plan import Tile, TilePlan
from rhytid.engine_process.remote_plan import Facts
from rhytid.engine_process.requests import Call
from rhytid.errors import NotFoundError

# Calls that go to the parts of the engine as they are.
_PLAIN = {
    "assets": (
        "all",
        "info",
        "change",
        "delete",
        "follow",
        "leave",
        "content",
        "graph",
        "mesh",
        "shapes",
        "shapes_nbytes",
        "curves",
        "calibrate",
    ),
    "frames": ("put", "warnings", "all", "info", "positions", "delete", "stretch"),
    "tiles": ("triangles", "bins", "bin_tile"),
    "jobs": ("info", "cancel"),
    "packages": ("of",),
}
Drawn = tuple[Tile, Facts, str]


class Calls:
    """Performs calls on an engine.  stored: called with the token of an upload once its frames are
    stored."""

    def __init__(self, engine: Engine, stored: Callable[[int], None]) -> None:
        self._engine, self._stored = engine, stored
        self._calls: dict[str, Callable[..., Any]] = {
            "ready": engine.ready,
            "devices": engine.devices,
            "create": self._create,
            "plan_tile": self._plan_tile,
            "plan_map": self._plan_map,
            "plans_once": self._plans_once,
            "draw_tile": self._draw_tile,
            "draw_map": self._draw_map,
            "draw_once": self._draw_once,
            "snapshot": self._snapshot,
            "restore": self._restore,
        }
        for part, names in _PLAIN.items():
            for name in names:
                self._calls[f"{part}.{name}"] = getattr(getattr(engine, part), name)

    def perform(self, call: Call) -> Any:
        """What the engine answers; raises what it raises."""
        return self._calls[call.name](*call.positional, **call.named)

    def _create(
        self, new: NewAsset, token: int, *, strict: bool, allow: Collection[str]
    ) -> AssetInfo:
        info = self._engine.assets.create(new, strict=strict, allow=allow)
        try:
            if info.job is None:
                raise NotFoundError
            self._engine.jobs.get(info.job).when_ended(lambda: self._stored(token))
        except NotFoundError:
            self._stored(token)
        return info

    # The last argument names the positions for the server.

    def _plan_tile(self, *arguments: Any) -> Facts:
        return _facts(self._engine.tiles.plan(*arguments[:-1]))

    def _plan_map(self, *arguments: Any) -> Facts:
        return _facts(self._engine.tiles.plan_map(*arguments[:-1]))

    def _plans_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, addresses: list[TileAddress]
    ) -> list[Facts]:
        plans = self._engine.tiles.plans_once(asset, positions, query, addresses)
        return [_facts(plan) for plan in plans]

    def _draw_tile(self, *arguments: Any) -> Drawn:
        return _drawn(partial(self._engine.tiles.plan, *arguments[:-1]))

    def _draw_map(self, *arguments: Any) -> Drawn:
        return _drawn(partial(self._engine.tiles.plan_map, *arguments[:-1]))

    def _draw_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, address: TileAddress
    ) -> Drawn:
        (plan,) = self._engine.tiles.plans_once(asset, positions, query, [address])
        return plan.draw(), _facts(plan), plan.key

    def _snapshot(self, asset: str) -> tuple[Any, ...]:
        with self._engine.snapshots.of(asset) as made:
            return made.parts

    def _restore(self, content: NDArray[np.uint8], nbytes: int) -> tuple[AssetInfo, bool]:
        return self._engine.snapshots.restore(io.BytesIO(content.data), nbytes)


def _drawn(plan: Callable[[], TilePlan]) -> Drawn:
    """A tile, what was planned, and the key that there is when it is drawn."""
    wanted = plan()
    tile = wanted.draw()
    return tile, _facts(wanted), plan().key


def _facts(plan: TilePlan) -> Facts:
    return plan.key, plan.header, plan.side
