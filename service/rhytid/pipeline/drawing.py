"""The version of the drawing: the same inputs may give other maps where it is another."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from rhytid import __version__
from rhytid.device.sources import kernels_digest

if TYPE_CHECKING:
    # Python 3.10 has it elsewhere than 3.11 and later.
    from importlib.abc import Traversable


@cache
def drawing_version() -> str:
    """The version of the package, and digests of the kernels and of what runs them (this package).

    It is part of the keys of all that is computed, so that after an update nothing that was drawn
    before is taken for new. It is no part of the ids of assets: these name content.
    """
    return f"{__version__}+{kernels_digest()}.{modules_digest(files(__package__))}"


def modules_digest(package: Traversable) -> str:
    """Twelve hexadecimal digits that change with any module in a folder."""
    modules = sorted(package.iterdir(), key=lambda entry: entry.name)
    digest = hashlib.sha256()
    for module in modules:
        if module.name.endswith(".py"):
            digest.update(f"{module.name}\n".encode() + module.read_bytes())
    return digest.hexdigest()[:12]
