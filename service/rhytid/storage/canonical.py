"""One JSON text per value, so that a changed byte is detected."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from rhytid.errors import StorageError, StoreFormatError


def canonical(value: Any) -> bytes:
    """The only JSON text of a value: sorted keys, no spaces, ASCII, no NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def parse_canonical(data: bytes, path: Path) -> Any:
    """The inverse of `canonical`; raises StorageError naming `path` for any other text."""
    try:
        value = json.loads(data)
        exact = canonical(value) == data
    except (ValueError, RecursionError) as exc:
        raise damaged(path, f"not JSON ({exc})") from exc
    if not exact:
        raise damaged(path, "not the text that was written")
    return value


def hashed(value: Any) -> bytes:
    """Canonical text that holds the value and its SHA-256."""
    return canonical({"sha256": _digest(value), "value": value})


def parse_hashed(data: bytes, path: Path) -> Any:
    """The inverse of `hashed`; raises StorageError naming `path` where any byte was changed."""
    pair = parse_canonical(data, path)
    value = pair.get("value") if isinstance(pair, dict) else None
    if pair != {"sha256": _digest(value), "value": value}:
        raise damaged(path, "its hash does not match")
    return value


def damaged(path: Path, why: str) -> StorageError:
    """The error for a file that is not what was written."""
    return StorageError(f"{path} is damaged: {why}")


def check_format(value: Any, known: int, path: Path) -> None:
    """Raise StoreFormatError where a file names a format above `known`, as a newer version writes
    it. Any other value is left to the caller."""
    named = value.get("format") if isinstance(value, dict) else None
    if type(named) is int and named > known:
        raise StoreFormatError(
            f"{path} is of format {named}, and this version of rhytid reads up to {known}: "
            "a newer version wrote it"
        )


def _digest(value: Any) -> str:
    return hashlib.sha256(canonical(value)).hexdigest()
