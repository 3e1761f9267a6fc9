"""The client stands alone: the standard library, httpx and numpy."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import rhytid_client

HOME = Path(rhytid_client.__file__).parent
# websockets, an extra, is imported by name where a live connection is opened.
ALLOWED = {*sys.stdlib_module_names, "httpx", "numpy", "rhytid_client"}


def imported(path: Path) -> set[str]:
    """Top-level names of all modules that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module if node.level == 0 and node.module else ".")
    return {name.split(".")[0] for name in found}


def test_imports_nothing_else() -> None:
    files = sorted(HOME.rglob("*.py"))
    assert len(files) > 10
    for path in files:
        assert imported(path) <= ALLOWED, path.name


def test_is_typed() -> None:
    assert (HOME / "py.typed").exists()
