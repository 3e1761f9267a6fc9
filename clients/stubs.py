"""Stubs of host applications from PyPI, for type checking and for fakes in tests.

The stub of Unreal is a module of half a million lines, some of which no Python can read: the
classes that are used here are cut from it.

    python clients/stubs.py unreal FOLDER    # FOLDER/unreal.pyi
"""

from __future__ import annotations

import re
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path

HERE = Path(__file__).resolve().parent
# Where packages from PyPI put them.
UNREAL, HOUDINI, MAYA = "unreal/unreal.py", "hou-stubs/__init__.pyi", "maya-stubs/cmds.pyi"
_CLASS = re.compile(r"^class (\w+)(?:\((.*)\))?:", re.MULTILINE)
_SIGNATURE = re.compile(r"^ +def .*$", re.MULTILINE)
_USED = re.compile(r"\bunreal\.(\w+)")


def text(stub: str) -> str:
    """An installed stub."""
    file = Path(sysconfig.get_path("purelib")) / stub
    if not file.is_file():
        raise SystemExit(f"{file} is missing: pip install types-maya types-houdini unreal-stub")
    return file.read_text(encoding="utf-8-sig")


def cut(stub: str, names: Iterable[str]) -> str:
    """The head of a stub, and the classes of these names, each after its bases."""
    blocks, head = _blocks(stub)
    taken: dict[str, str] = {}

    def take(name: str) -> None:
        if name in blocks and name not in taken:
            bases = _CLASS.match(blocks[name])
            for base in re.findall(r"\w+", (bases and bases[2]) or ""):
                take(base)
            taken[name] = blocks[name]

    for name in names:
        take(name)
    return head + "".join(taken.values())


def named(stub: str, names: Iterable[str]) -> set[str]:
    """Every name in the signatures of these classes, and theirs."""
    blocks, _ = _blocks(stub)
    known = set(names)
    signatures = [s for name in known if name in blocks for s in _SIGNATURE.findall(blocks[name])]
    return known | set(re.findall(r"\w+", " ".join(signatures)))


def _blocks(stub: str) -> tuple[dict[str, str], str]:
    """Classes by their names, and what stands before the first."""
    found = list(_CLASS.finditer(stub))
    ends = [*(match.start() for match in found[1:]), len(stub)]
    blocks = {m[1]: stub[m.start() : end] for m, end in zip(found, ends, strict=True)}
    return blocks, stub[: found[0].start()]


def unreal(folder: Path) -> None:
    """Write FOLDER/unreal.pyi: what the script for Unreal uses."""
    script = (HERE / "unreal" / "rhytid_unreal.py").read_text(encoding="utf-8")
    stub = text(UNREAL)
    used = named(stub, _USED.findall(script))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "unreal.pyi").write_text(cut(stub, sorted(used)), encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:2] != ["unreal"] or len(sys.argv) != 3:
        raise SystemExit(__doc__)
    unreal(Path(sys.argv[2]))
