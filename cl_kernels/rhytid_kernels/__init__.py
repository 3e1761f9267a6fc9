"""The OpenCL C 1.2 kernels, as text, in folders by stage. A `.cl` file holds kernels, a `.clh` file
helpers; no two have the same name.

Includes are put in here, so a program is one string and a compiler needs no search path.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib.resources import files

# Clang's compilers warn that vectors of sixteen are passed in another way where a processor has no
# register for one. That matters between objects that are compiled apart; a program is one text.
_PREAMBLE = """\
#ifdef __clang__
#pragma clang diagnostic ignored "-Wpsabi"
#endif
"""
_INCLUDE = re.compile(r'^#include "([a-z0-9_]+\.clh)"$', re.MULTILINE)


def names() -> list[str]:
    """The programs that exist: the stems of the `.cl` files."""
    return sorted(name[:-3] for name in _files() if name.endswith(".cl"))


def source(name: str) -> str:
    """The text of one program with every helper put in once, before its first use.

    Raises FileNotFoundError where there is no such program.
    """
    return expand(_read(f"{name}.cl"))


def builtins() -> str:
    """Declarations of what the programs use of OpenCL C itself, for compilers without any."""
    return _read("builtins.clh")


def digest(name: str) -> str:
    """Twelve hexadecimal digits that change with the source of a program."""
    return hashlib.sha256(source(name).encode()).hexdigest()[:12]


def digest_of_all() -> str:
    """Twelve hexadecimal digits that change with any kernel or helper."""
    texts = "".join(f"{name}\n{_read(name)}\n" for name in sorted(_files()))
    return hashlib.sha256(texts.encode()).hexdigest()[:12]


def expand(text: str) -> str:
    """`text` with its `#include "helper.clh"` lines replaced by the helpers, each only once."""
    seen: set[str] = set()

    def put_in(match: re.Match[str]) -> str:
        helper = match[1]
        if helper in seen:
            return ""
        seen.add(helper)
        return _INCLUDE.sub(put_in, _read(helper))

    return _PREAMBLE + _INCLUDE.sub(put_in, text)


def stage(name: str) -> str:
    """The folder of a program: what it is a step of, such as `drawing`; "" where there is none."""
    return _stages().get(f"{name}.cl", "")


@cache
def _stages() -> dict[str, str]:
    folders = [entry for entry in files(__name__).iterdir() if entry.is_dir()]
    return {entry.name: folder.name for folder in folders for entry in folder.iterdir()}


@cache
def _files() -> dict[str, str]:
    """The text of every kernel and helper by the name of its file."""
    folders = [entry for entry in files(__name__).iterdir() if entry.is_dir()]
    entries = (entry for folder in folders for entry in folder.iterdir())
    found = [entry for entry in entries if entry.name.endswith((".cl", ".clh"))]
    return {entry.name: entry.read_text(encoding="utf-8") for entry in found}


def _read(file: str) -> str:
    if file not in _files():
        raise FileNotFoundError(f"no kernel {file}")
    return _files()[file]
