"""The two engines that a server can have."""

from __future__ import annotations

from typing import TypeAlias

from rhytid.engine.engine import Engine
from rhytid.engine_process.remote_engine import RemoteEngine

AnyEngine: TypeAlias = Engine | RemoteEngine
