"""What a package is made from: the calls of an engine that it needs."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.tiles import TileAddress


class Facts(Protocol):
    """Of an asset."""

    @property
    def settings(self) -> dict[str, Any]:
        """All of them, resolved."""

    @property
    def udims(self) -> tuple[int, ...]:
        """With mesh."""


class Assets(Protocol):
    """Facts of ready assets."""

    def info(self, asset: str) -> Facts:
        """Of one asset."""

    def stiff(self, asset: str) -> bool:
        """Whether a stiffness map came with it."""


class Tiles(Protocol):
    """The precomputed maps of ready assets."""

    def bins(self, asset: str) -> BinManifest:
        """What maps there are."""

    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[np.integer]:
        """(n, n) codes of a tile of one map."""

    def triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(R, R) the triangle of each texel."""

    def cushion_triangles(self, asset: str, udim: int) -> NDArray[np.int32]:
        """(n, n) the triangle of each sample of the cushions."""


class Source(Protocol):
    """An engine."""

    @property
    def assets(self) -> Assets:
        """Its assets."""

    @property
    def tiles(self) -> Tiles:
        """Their maps."""
