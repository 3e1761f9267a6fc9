"""Attributes in the header of an OpenEXR file: those of ours say unit, least and largest value.

After "OpenEXR File Layout", https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct
from pathlib import Path

from rhytid_client.hosts.trouble import Trouble

# Headers of maps are far shorter.
_LONGEST = 1 << 16
_MAGIC = b"\x76\x2f\x31\x01"


def text_attribute(path: Path, name: str) -> str | None:
    """A string attribute by name; None where there is none, or the header is none.

    Raises Trouble where the file cannot be read."""
    value = _attribute(path, name, "string")
    return None if value is None else value.decode("utf-8", "replace")


def float_attribute(path: Path, name: str) -> float | None:
    """A float attribute by name; None where there is none, or the header is none.

    Raises Trouble where the file cannot be read."""
    value = _attribute(path, name, "float")
    return struct.unpack("<f", value)[0] if value is not None and len(value) == 4 else None


def int_attribute(path: Path, name: str) -> int | None:
    """An int attribute by name; None where there is none, or the header is none.

    Raises Trouble where the file cannot be read."""
    value = _attribute(path, name, "int")
    return struct.unpack("<i", value)[0] if value is not None and len(value) == 4 else None


def _attribute(path: Path, name: str, kind: str) -> bytes | None:
    try:
        with path.open("rb") as file:
            data = file.read(_LONGEST)
    except OSError as exc:
        raise Trouble(f"{path} cannot be read: {exc}") from exc
    if not data.startswith(_MAGIC):
        return None
    try:
        return _found(data, name.encode(), kind.encode())
    except (ValueError, IndexError):
        return None


def _found(data: bytes, name: bytes, kind: bytes) -> bytes | None:
    """Attributes are: name, 0, type, 0, size as int32, value; a lone 0 ends them."""
    at = 8
    while data[at] != 0:
        name_end = data.index(0, at)
        kind_end = data.index(0, name_end + 1)
        size = int.from_bytes(data[kind_end + 1 : kind_end + 5], "little")
        value = data[kind_end + 5 : kind_end + 5 + size]
        if data[at:name_end] == name and data[name_end + 1 : kind_end] == kind:
            return value
        at = kind_end + 5 + size
    return None
