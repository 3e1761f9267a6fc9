"""How large one array of an uploaded file, or an image, may be.

Where a header or a table says the size, it is checked before the array is allocated. The text of
an OBJ says nothing: its lines, which the limit of an upload bounds, are split and counted first.
"""

from __future__ import annotations

from rhytid.errors import InputError, LimitError

# Numbers (not bytes) in one array of a mesh: 16 million vertices or triangles.
MAX_NUMBERS = 50_000_000
# All frames of one animation together: 400 frames of a mesh of 160,000 vertices.
MAX_FRAME_NUMBERS = 200_000_000
# Texels per side of a painted map, and of scanned displacement.
MOST_SIDE = 8192
MOST_SCAN_SIDE = 16384


def check_size(what: str, numbers: int, limit: int = MAX_NUMBERS) -> None:
    """Raise LimitError where `what` would hold more than `limit` numbers."""
    if numbers > limit:
        raise LimitError(f"{what} holds {numbers} numbers: at most {limit}")


def check_sides(name: str, width: int, height: int, most: int = MOST_SIDE) -> None:
    """Raise InputError where the image `name` has no texel, LimitError above `most` per side."""
    if min(width, height) <= 0:
        raise InputError(f"{name} has {width} x {height} texels")
    if max(width, height) > most:
        raise LimitError(f"{name} has {width} x {height} texels: at most {most} a side")
