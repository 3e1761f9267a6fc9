"""Assets on disk: sealed folders, written aside and renamed, that survive a crash."""

from rhytid.storage.asset_ids import asset_id
from rhytid.storage.records import StoredAsset, StoredRequest
from rhytid.storage.store import AssetStore

__all__ = ["AssetStore", "StoredAsset", "StoredRequest", "asset_id"]
