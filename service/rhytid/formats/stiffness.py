"""Stiffness maps as grey images, the UDIM of each in its file name: `anything.1002.png`."""

from __future__ import annotations

from collections.abc import Sequence

from rhytid.domain.stiffness import Stiffness
from rhytid.formats.painted import read_painted


def read_stiffness(files: Sequence[tuple[str, bytes]], udims: Sequence[int]) -> Stiffness:
    """The maps of images, (file name or path, bytes) each, for a mesh with these UDIMs.

    Raises InputError naming the image that has no place or cannot be read, LimitError over what is
    too large.
    """
    return Stiffness(read_painted(files, udims, "stiffness"))
