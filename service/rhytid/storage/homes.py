"""The folders of a store, one per asset: their names, their contents, and which are removed."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from pathlib import Path

from rhytid.errors import NotFoundError, StorageError
from rhytid.support import atomic_files
from rhytid.support.atomic_files import is_folder, storage_errors
from rhytid.support.ownership import is_plain, is_real_folder

ID = re.compile(r"[0-9a-f]{16}", re.ASCII)
# Beside them what is no part of the content that an id names: the shapes that move its mesh.
REQUEST, ASSET, SHAPES = "request", "asset", "shapes"
SHARED, OVERLAY, MANIFEST = "shared.json", "overlay.json", "manifest.json"
# All that a home may hold.
_KNOWN = {REQUEST, ASSET, SHAPES, SHARED, OVERLAY}
_log = logging.getLogger(__name__)


def checked_id(id: str) -> str:
    """The id itself, which may name a folder then; raises NotFoundError where it is malformed."""
    if not ID.fullmatch(id):
        raise NotFoundError(f"no asset {id!r}: ids are 16 hexadecimal digits")
    return id


def homes(assets: Path) -> Iterator[Path]:
    """The homes of all assets, by id; other entries of `assets` are left out."""
    with storage_errors(f"{assets} cannot be read"):
        entries = sorted(assets.iterdir())
    return (entry for entry in entries if ID.fullmatch(entry.name))


def is_built(home: Path) -> bool:
    """Whether a home holds a built asset; raises StorageError where its folder cannot be read."""
    return is_folder(home / ASSET)


def is_requested(home: Path) -> bool:
    """Whether a home holds a request; raises StorageError where its folder cannot be read."""
    return is_folder(home / REQUEST)


def holds_something(home: Path) -> bool:
    """Whether a home holds a built asset or a request; raises as `is_built` does."""
    return is_built(home) or is_requested(home)


def is_readable(home: Path) -> bool:
    """Whether the folder of a home can be read."""
    try:
        holds_something(home)
    except StorageError:
        return False
    return True


def holds_homes(assets: Path) -> bool:
    """Whether the folder `assets` holds an asset of a store, or the request for one."""
    if not is_real_folder(assets):
        return False
    kinds = (home / kind / MANIFEST for home in homes(assets) for kind in (ASSET, REQUEST))
    return any(manifest.is_file() for manifest in kinds)


def sweep(assets: Path, partial: Path) -> None:
    """Remove what interrupted changes left behind.

    A folder that cannot be removed or read is left as it is, so that the others can be served. So
    is everything that rhytid did not make.
    """
    atomic_files.sweep_partial(partial, at_once=True)
    for home in homes(assets):
        if is_plain(home):
            _tidy(home, partial)


def _tidy(home: Path, partial: Path) -> None:
    try:
        if not holds_something(home):
            if not home.is_dir() or {entry.name for entry in home.iterdir()} <= _KNOWN:
                atomic_files.discard(home, partial)
            else:
                _log.warning("left alone in %s: something that rhytid did not make", home)
        elif is_built(home) and is_requested(home):
            atomic_files.discard(home / REQUEST, partial)
    except (OSError, StorageError) as exc:
        _log.warning("%s is left as it is: %s", home, exc)
