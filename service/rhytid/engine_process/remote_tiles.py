"""Displacement of an engine in another process."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery, TilePlan
from rhytid.engine_process.caller import Caller
from rhytid.engine_process.device_process import DeviceProcess
from rhytid.engine_process.frame_ledger import FrameLedger
from rhytid.engine_process.remote_plan import Facts, RemotePlan
from rhytid.engine_process.requests import Request

_MOST_SIDES = 10_000


class RemoteTiles:
    """The calls of `TileService`."""

    def __init__(self, supervisor: Caller, frames: FrameLedger) -> None:
        self._supervisor, self._frames = supervisor, frames
        # Texels by kind, asset and level: an asset of another size has another id.
        self._sides: dict[tuple[str, str, int], int] = {}

    def plan(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> TilePlan:
        """As `TileService.plan`; what it raises may come when the plan is used."""
        return self._plan("tile", (asset, frame, query, address), address.level)

    def plan_map(self, asset: str, frame: str, query: MapQuery, udim: int, level: int) -> TilePlan:
        """As `TileService.plan_map`; what it raises may come when the plan is used."""
        return self._plan("map", (asset, frame, query, udim, level), level)

    def plans_once(
        self, asset: str, positions: ArrayLike, query: MapQuery, addresses: list[TileAddress]
    ) -> list[TilePlan]:
        """As `TileService.plans_once`."""
        request = Request("plans_once", (asset, positions, query, addresses))
        facts: list[Facts] = self._supervisor.call(request)
        calls = [("once", (asset, positions, query, address)) for address in addresses]
        return [
            RemotePlan(self._supervisor.call, *call, found[2], found)
            for call, found in zip(calls, facts, strict=True)
        ]

    def triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """As `TileService.triangles`."""
        request = Request("tiles.triangles", (asset, udim))
        found: NDArray[np.int32] = self._supervisor.call(request)
        return found

    def bins(self, asset: str) -> BinManifest:
        """The precomputed maps of an asset (section 2.4)."""
        found: BinManifest = self._supervisor.call(Request("tiles.bins", (asset,)))
        return found

    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        """As `TileService.bin_tile`."""
        request = Request("tiles.bin_tile", (asset, address, layer, bin, sample))
        found: NDArray[np.integer] = self._supervisor.call(request)
        return found

    def forget(self, asset: str) -> None:
        """The asset is gone."""
        for known in list(self._sides):
            if known[1] == asset:
                self._sides.pop(known, None)

    def _plan(self, kind: str, arguments: tuple[Any, ...], level: int) -> TilePlan:
        asset, frame = arguments[:2]

        def bring(process: DeviceProcess) -> None:
            self._frames.bring(process, asset, (frame,))

        # With what names the positions: where they are refused, others of the same name are not.
        arguments = (*arguments, self._frames.version(asset, frame))
        call = partial(self._supervisor.call, prepare=bring)
        known = (kind, asset, level)
        plan = RemotePlan(call, kind, arguments, self._sides.get(known))
        if known not in self._sides:
            if len(self._sides) >= _MOST_SIDES:
                self._sides.clear()
            self._sides[known] = plan.side
        return plan
