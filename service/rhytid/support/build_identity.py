"""Which build of rhytid runs: its version, the revision it was built of, digests of its code.

The version alone says little between two releases. Machines that are to draw the same maps compare
`drawing_version`.
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from rhytid import __version__
from rhytid.errors import InputError

if TYPE_CHECKING:
    # Python 3.10 has it elsewhere than 3.11 and later.
    from importlib.abc import Traversable

# What grows and traces skin, what runs the kernels, and what makes files of their maps.
_DRAWN_BY = (
    *("rhytid.domain", "rhytid.synthesis", "rhytid.tracing"),
    *("rhytid.pipeline", "rhytid.exports.textures"),
)
# Written into a wheel by `hatch_build.py`.
_REVISION = "revision.txt"
_IGNORED = "__pycache__"


@cache
def drawing_version() -> str:
    """The version of the package, with digests of the kernels, of the code that runs them and of
    that which makes graphs. Builds that differ in it may draw other maps of the same inputs.

    It is part of the keys of all that is computed, so that an update never serves maps that an
    earlier build drew. It is no part of the ids of assets, which name content.
    """
    # Only here, for `rhytid --help` needs no kernels.
    import rhytid_kernels

    return f"{__version__}+{rhytid_kernels.digest_of_all()}.{modules_digest(*_DRAWN_BY)}"


def check_drawing(wanted: str) -> None:
    """Raise InputError where `wanted` is not the `drawing_version` of this rhytid."""
    if wanted != drawing_version():
        raise InputError(
            f"this rhytid draws as {drawing_version()}, the job asks for {wanted}: install the "
            "same rhytid on all machines"
        )


@cache
def revision() -> str:
    """The revision of the repository that the package was built of, with `-dirty` where files were
    changed; `unknown` for a package that runs from its sources, or was built without a
    repository."""
    file = files("rhytid") / _REVISION
    return file.read_text(encoding="utf-8").strip() if file.is_file() else "unknown"


def file_attributes() -> dict[str, str]:
    """Attributes of image files that name the program that wrote them."""
    return {
        "rhytid_version": __version__,
        "rhytid_drawing": drawing_version(),
        "rhytid_revision": revision(),
    }


def modules_digest(*packages: str, extra: dict[str, bytes] | None = None) -> str:
    """Twelve hexadecimal digits that change with any file of some packages.

    packages: dotted names.  extra: further files, bytes by name.
    """
    digest = hashlib.sha256()
    for package in packages:
        _add_folder(digest, files(package), package)
    for name, data in sorted((extra or {}).items()):
        _add(digest, name, data)
    return digest.hexdigest()[:12]


def _add_folder(digest: hashlib._Hash, folder: Traversable, name: str) -> None:
    """Add every file below a folder, but for what Python compiles."""
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        path = f"{name}/{entry.name}"
        if entry.name == _IGNORED:
            continue
        if entry.is_dir():
            _add_folder(digest, entry, path)
        else:
            _add(digest, path, entry.read_bytes())


def _add(digest: hashlib._Hash, name: str, data: bytes) -> None:
    digest.update(f"{name}\n{len(data)}\n".encode() + data)
