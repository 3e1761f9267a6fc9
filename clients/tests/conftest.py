"""The scripts for hosts, with fakes of these in the place of their modules."""

from __future__ import annotations

import sys
from pathlib import Path

CLIENTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(CLIENTS), *(str(CLIENTS / host) for host in ("maya", "houdini", "unreal"))]
