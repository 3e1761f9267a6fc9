"""Content keys: two answers with the same key have the same bytes."""

from __future__ import annotations

import hashlib
import json
from functools import lru_cache
from typing import Any

from rhytid import __version__
from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery


@lru_cache(maxsize=256)
def settings_key(asset: str, settings: AssetSettings, device: str) -> str:
    """Names an asset with its present settings on a device; floats differ between devices."""
    return _digest([asset, settings.as_json(), device, __version__])


def map_key(revision: str, frame: Frame, query: MapQuery, place: str) -> str:
    """Names a tile or a map. `neutral` is the same in every frame."""
    digest = NEUTRAL_FRAME.digest if query.method == "neutral" else frame.digest
    return _digest([revision, digest, query.method, query.stretch, query.sampling, place])


def _digest(parts: list[Any]) -> str:
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]
