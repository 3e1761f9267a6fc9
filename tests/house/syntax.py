"""The Python files of the repository as syntax trees: who imports what."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
# Source roots and the one package in each.
PACKAGES = {
    "rhytid": ROOT / "service",
    "rhytid_lab": ROOT / "service",
    "rhytid_kernels": ROOT / "cl_kernels",
    "rhytid_client": ROOT / "clients" / "python",
    "rhytid_viewer": ROOT / "clients" / "viewer",
}


class Import(NamedTuple):
    """`module` is imported in line `line` of `file`; `level` counts the dots of a relative one."""

    file: Path
    line: int
    module: str
    level: int

    @property
    def top(self) -> str:
        return self.module.partition(".")[0]

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line} imports {self.module}"


def sources(package: str) -> list[Path]:
    """Every Python file of a package."""
    return sorted((PACKAGES[package] / package).rglob("*.py"))


# What holds statements: imports are in no expression.
_BODIES = ("body", "orelse", "finalbody", "handlers", "cases")


def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"), str(file))


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Everything below a node but for expressions."""
    for name in _BODIES:
        for inner in getattr(node, name, ()):
            yield inner
            yield from _statements(inner)


@cache
def imports(file: Path) -> list[Import]:
    """Every import, those in functions and under TYPE_CHECKING too.

    `from package import name` counts as `package.name`, which may be a module.
    """
    return list(_imports(file))


def _imports(file: Path) -> Iterator[Import]:
    for node in _statements(tree(file)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(file, node.lineno, alias.name, 0)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield Import(file, node.lineno, f"{node.module}.{alias.name}", node.level)


def room(file: Path) -> str:
    """The part of the package `rhytid` that a file belongs to: a folder, or a module on top."""
    inside = file.relative_to(PACKAGES["rhytid"] / "rhytid").parts
    return inside[0].removesuffix(".py")


def imported_room(found: Import) -> str | None:
    """The part of `rhytid` that is imported; None for other packages and for `rhytid` itself."""
    parts = found.module.split(".")
    if parts[0] != "rhytid" or len(parts) < 2:
        return None
    place = PACKAGES["rhytid"] / "rhytid" / parts[1]
    return parts[1] if place.is_dir() or place.with_suffix(".py").is_file() else None
