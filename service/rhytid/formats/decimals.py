"""Numbers in text files: plain ASCII decimals, parsed in double, and nothing else.

`float` and `int` read far more than a mesh file may hold: "1_0", "nan", "infinity", the digits of
every script. Text is checked against a grammar before it goes to numpy's fast parsers.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

# Each is free of ambiguity, so that a match takes time linear in the text.
NUMBER = rb"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
WHOLE = rb"[+-]?[0-9]+"

_SPELLING = b"0123456789+-.eE \t\r\n"
_is_number = re.compile(NUMBER).fullmatch


def is_number(token: bytes) -> bool:
    """Whether a token is a plain decimal."""
    return _is_number(token) is not None


def floats(text: bytes) -> NDArray[np.float64]:
    """The numbers of a text whose tokens all match NUMBER; too large ones are infinite."""
    return np.fromstring(text, np.float64, sep=" ") if text else np.empty(0)


def wholes(text: bytes) -> NDArray[np.int64]:
    """The numbers of a text whose tokens all match WHOLE; saturates beyond 64 bits."""
    return np.fromstring(text, np.int64, sep=" ") if text else np.empty(0, np.int64)


def strict_floats(text: bytes) -> NDArray[np.float64]:
    """The numbers of a text separated by white space; ValueError where one is not plain."""
    # Within these characters `float` reads plain decimals only.
    if text.translate(None, _SPELLING):
        raise ValueError("not plain decimals")
    return np.fromiter(map(float, text.split()), np.float64)


def show(token: bytes) -> str:
    """A token for a message: quoted, printable, short."""
    text = token.decode("ascii", "backslashreplace")
    return repr(text if len(text) <= 40 else text[:40] + "…").replace("\\\\", "\\")
