"""The version of what packages are written by: the same asset may give other files where it is
another."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import rhytid_viewer
from rhytid import __version__

if TYPE_CHECKING:
    # Python 3.10 has it elsewhere than 3.11 and later.
    from importlib.abc import Traversable

# What writes files of packages: textures, meshes, shaders, texts.
_WRITTEN_BY = ("rhytid.skin_package", "rhytid.formats", "rhytid.meshes")
_IGNORED = "__pycache__"


@cache
def package_version() -> str:
    """The version of rhytid, and a digest of the modules, shaders and pages that packages are made
    by and made of."""
    digest = hashlib.sha256()
    for package in _WRITTEN_BY:
        _add_folder(digest, files(package), package)
    for name, data in sorted(rhytid_viewer.laid_out().items()):
        _add(digest, name, data)
    return f"{__version__}+{digest.hexdigest()[:12]}"


def _add_folder(digest: hashlib._Hash, folder: Traversable, name: str) -> None:
    """Every file of a folder, and of those in it, but for what Python compiles."""
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.name == _IGNORED:
            continue
        path = f"{name}/{entry.name}"
        if entry.is_dir():
            _add_folder(digest, entry, path)
        else:
            _add(digest, path, entry.read_bytes())


def _add(digest: hashlib._Hash, name: str, data: bytes) -> None:
    digest.update(f"{name}\n{len(data)}\n".encode() + data)
