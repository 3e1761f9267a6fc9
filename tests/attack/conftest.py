"""The library of faults."""

from __future__ import annotations

from engine_process.served import faults

__all__ = ["faults"]
