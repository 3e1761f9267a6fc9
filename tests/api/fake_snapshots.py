"""Snapshots of the fake engine: a few files of a real store's format, around no asset."""

from __future__ import annotations

from typing import Any

from api.fake_state import Part
from rhytid.engine.messages import AssetInfo
from rhytid.errors import SnapshotError


class FakeSnapshots(Part):
    """None is taken, and none is given but of an asset that is not there."""

    def of(self, asset: str) -> Any:
        self.state.built(asset)
        raise NotImplementedError

    def restore(self, stream: Any, nbytes: int) -> tuple[AssetInfo, bool]:
        raise SnapshotError(f"{nbytes} bytes are no snapshot")
