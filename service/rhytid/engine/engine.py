"""The engine: assets on a device, a frame in, tiles out. Plain messages only (see messages.py)."""

from __future__ import annotations

from rhytid.engine.asset_calls import AssetCalls
from rhytid.engine.frame_calls import FrameCalls
from rhytid.engine.tile_calls import TileCalls


class Engine(AssetCalls, FrameCalls, TileCalls):
    """Holds assets on one device and answers for their frames. Blocking; safe from any thread.

    Every call raises NotFoundError for an unknown id, NotReadyError while the asset builds,
    ConflictError where it failed to build, and BusyError where too many calls wait already.
    """
