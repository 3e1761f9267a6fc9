"""Text in the header of an OpenEXR file: that of ours says in which unit a map is."""

from __future__ import annotations

from pathlib import Path

# Headers of maps are far shorter.
_LONGEST = 1 << 16
_MAGIC = b"\x76\x2f\x31\x01"


def text_attribute(path: Path, name: str) -> str | None:
    """A string attribute by name; None where there is none, or the header cannot be read."""
    with path.open("rb") as file:
        data = file.read(_LONGEST)
    if not data.startswith(_MAGIC):
        return None
    try:
        return _found(data, name.encode())
    except (ValueError, IndexError):
        return None


def _found(data: bytes, name: bytes) -> str | None:
    """Attributes are: name, 0, type, 0, size as int32, value; a lone 0 ends them."""
    at = 8
    while data[at] != 0:
        name_end = data.index(0, at)
        kind_end = data.index(0, name_end + 1)
        size = int.from_bytes(data[kind_end + 1 : kind_end + 5], "little")
        value = data[kind_end + 5 : kind_end + 5 + size]
        if data[at:name_end] == name and data[name_end + 1 : kind_end] == b"string":
            return value.decode("utf-8", "replace")
        at = kind_end + 5 + size
    return None
