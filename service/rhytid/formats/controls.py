"""Control maps of synthesis as grey images, by name, the UDIM of each in its file name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rhytid.domain.controls import Controls
from rhytid.domain.painted import Map
from rhytid.formats.painted import read_painted


def read_controls(
    files: Mapping[str, Sequence[tuple[str, bytes]]], udims: Sequence[int]
) -> Controls | None:
    """The maps of images, (file name or path, bytes) each by the name of the control; None without
    any.

    Raises InputError naming the image that has no place or cannot be read, LimitError over what is
    too large.
    """
    maps: dict[str, dict[int, Map]] = {}
    before: list[Map] = []
    for name, images in files.items():
        maps[name] = read_painted(images, udims, name, before)
        before += maps[name].values()
    return Controls(maps) if maps else None
