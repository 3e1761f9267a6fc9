"""Measurements of devices, stored in a JSON file by key."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any


def recall(file: Path) -> dict[str, Any]:
    """What is remembered; nothing where the file is missing or damaged."""
    with suppress(OSError, ValueError):
        found = json.loads(file.read_text(encoding="utf-8"))
        return found if isinstance(found, dict) else {}
    return {}


def remember(file: Path, key: str, value: Any) -> None:
    """Add to what is remembered; where it cannot be written nothing is."""
    known = {**recall(file), key: value}
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(known, indent=1), encoding="utf-8")
