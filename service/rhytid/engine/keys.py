"""Content keys: two answers with the same key have the same bytes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from typing import Any

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import Lengths
from rhytid.domain.methods import DISPLACEMENT
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery

# Settings that a method does not read: its tiles stay the same when they change. `preset` only
# names values of `bins`. Every other setting changes the keys.
_UNREAD: dict[str, tuple[str, ...]] = {
    "neutral": ("preset", "bins", "convolve", "response", "angles"),
    "redraw": ("preset", "bins", "convolve"),
    "binned": ("preset", "convolve"),
    "convolved": ("preset", "bins", "angles"),
}


def map_key(
    asset: str, settings: AssetSettings, drawn_by: str, frame: Frame, query: MapQuery, place: str
) -> str:
    """Names a tile or a map of an asset with its present settings. The key of displacement by
    `neutral` is the same in every frame; slopes are on the surface of the frame.

    drawn_by: the device and the version of the drawing.  place: the address in the asset.
    """
    revision = _settings_key(asset, settings, drawn_by, query.method)
    chosen = [query.method, query.stretch, query.sampling, place]
    if query.layer != DISPLACEMENT:
        return _digest([revision, frame.digest, *chosen, query.layer])
    digest = NEUTRAL_FRAME.digest if query.method == "neutral" else frame.digest
    return _digest([revision, digest, *chosen])


@lru_cache(maxsize=256)
def _settings_key(asset: str, settings: AssetSettings, drawn_by: str, method: str) -> str:
    """Names an asset with those of its present settings that a method reads."""
    read = {k: v for k, v in settings.drawn().items() if k not in _UNREAD[method]}
    return _digest([asset, read, drawn_by])


def content_key(asset: str, files: Mapping[str, str], unit: str, lengths: Lengths) -> str:
    """Names the content of an asset in the store, and the lengths that it is drawn with.  files:
    digests by name."""
    return _digest([asset, dict(files), unit, asdict(lengths)])


def package_key(
    asset: str,
    settings: AssetSettings,
    shapes: Mapping[str, str],
    levels: int,
    written_by: str,
) -> str:
    """Names a skin package.  shapes: digests by name.  written_by: the device, the version of the
    drawing, and the version of the writer."""
    return _digest([asset, settings.drawn(), dict(shapes), levels, written_by])


def _digest(parts: list[Any]) -> str:
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]
