"""The OpenCL C 1.2 kernels, as text. A `.cl` file holds kernels, a `.clh` file helpers.

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
    entries = (entry.name for entry in files(__name__).iterdir())
    return sorted(name[:-3] for name in entries if name.endswith(".cl"))


def source(name: str) -> str:
    """The text of one program with every helper put in once, before its first use.

    Raises FileNotFoundError where there is no such program.
    """
    return expand(_read(f"{name}.cl"))


def digest(name: str) -> str:
    """Twelve hexadecimal digits that change with the source of a program."""
    return hashlib.sha256(source(name).encode()).hexdigest()[:12]


def digest_of_all() -> str:
    """Twelve hexadecimal digits that change with any kernel or helper."""
    kinds = (".cl", ".clh")
    found = sorted(e.name for e in files(__name__).iterdir() if e.name.endswith(kinds))
    texts = "".join(f"{name}\n{_read(name)}\n" for name in found)
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


@cache
def _read(file: str) -> str:
    return files(__name__).joinpath(file).read_text(encoding="utf-8")
