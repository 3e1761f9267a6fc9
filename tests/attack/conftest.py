"""The library of faults."""

from __future__ import annotations

from processes.served import faults

__all__ = ["faults"]
