"""A mesh with its wrinkles on a device, which draws whole maps for figures and studies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.methods import METHODS
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.bins import ShareRange

Map = NDArray[np.float32]


@dataclass(frozen=True)
class Column:
    """One way to displace the skin of a frame, as a column of a figure.

    letter: its place in Figure 1 of the paper.  bins: settings that differ from the preset.
    """

    letter: str
    title: str
    method: str
    bins: Mapping[str, Any] = field(default_factory=dict)


_COLUMNS = (
    Column("b", "neutral map, unchanged", "neutral"),
    Column("c", "convolved (Nagano et al.)", "convolved"),
    Column("d", "redraw", "redraw"),
    Column("e", "binned, N = 4", "binned"),
    Column("", "binned, N = 1", "binned", {"count": 1}),
)
# Only methods that this version has.
COLUMNS = tuple(column for column in _COLUMNS if column.method in METHODS)

# What draws those methods that come tile by tile.
_BY_TILE = ("binned", "convolved")


class Skin:
    """Draws one UDIM of a mesh with its wrinkles, under settings that can be changed between maps.

    settings: `depth` is set.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        graph: WrinkleGraph,
        settings: AssetSettings,
        udim: int = 1001,
    ) -> None:
        self.device, self.udim = device, udim
        self._graph, self._base = graph, settings
        self._asset = DeviceAsset(device, mesh, settings)
        with device.task():
            self._asset.mesh.locate(graph)
            self._asset.mesh.install(self._asset.mesh.prepare(graph, settings), settings)

    @property
    def settings(self) -> AssetSettings:
        """The settings of the next map."""
        return self._asset.mesh.settings

    @property
    def shares(self) -> ShareRange:
        """The range of the shares of its wrinkles."""
        return self._asset.mesh.shares

    def use(self, **changes: Any) -> None:
        """Take the first settings again, with `changes` (as JSON) put in."""
        settings, before = self._base.changed(changes), self.settings
        if settings == before:
            return
        with self.device.task():
            if self._asset.mesh.prepares(settings):
                self._asset.mesh.install(self._asset.mesh.prepare(self._graph, settings), settings)
            else:
                self._asset.mesh.use(settings)

    def stretch(self, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return ratios (F, 2), unclamped, and axes (F, 2, 2) of a frame."""
        with self.device.task():
            return self._asset.frames.ratios(frame)

    def map(self, frame: Frame, method: str) -> Map:
        """Return the displacement of a frame (R, R), mesh units, row 0 at the top."""
        query, grid = MapQuery(method), self.settings.grid
        if method not in _BY_TILE:
            with self.device.task():
                return self._asset.drawing.to_host(
                    frame, query, self.udim, 0, 0, 0, grid.resolution
                )
        tiles = [self._tile(frame, query, a) for a in grid.addresses(self.udim, 0)]
        count = grid.count(0)
        return np.block([tiles[i : i + count] for i in range(0, len(tiles), count)])

    def bin_map(self, address: TileAddress, index: int) -> NDArray[np.integer]:
        """Return the codes (n, n) of one precomputed map.  index: counts samples within layers."""
        with self.device.task():
            return self._asset.bins.codes(address, index)

    def _tile(self, frame: Frame, query: MapQuery, address: TileAddress) -> Map:
        with self.device.task():
            return self._asset.finest.tiles(frame, query, [address])[0]

    def release(self) -> None:
        """Give the device memory back."""
        self._asset.release()
