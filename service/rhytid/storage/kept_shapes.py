"""The named shapes of an asset as files: positions as safetensors, names as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from safetensors import SafetensorError

from rhytid.domain.expressions import Expressions
from rhytid.errors import InputError
from rhytid.storage.canonical import canonical, damaged, parse_canonical
from rhytid.storage.contents import read_expressions, write_expressions

SHAPES, NAMES = "shapes.safetensors", "names.json"


def shape_files(shapes: Expressions) -> dict[str, bytes]:
    """The files, by name."""
    return {SHAPES: write_expressions(shapes), NAMES: canonical(list(shapes.names))}


def read_shapes(files: Mapping[str, bytes], folder: Path) -> Expressions:
    """The inverse of `shape_files`; raises StorageError naming what is wrong in `folder`."""
    try:
        return read_expressions(files[SHAPES], parse_canonical(files[NAMES], folder / NAMES))
    except (InputError, KeyError, TypeError, ValueError, SafetensorError) as exc:
        raise damaged(folder / SHAPES, f"{type(exc).__name__}: {exc}") from exc
