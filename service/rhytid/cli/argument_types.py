"""Types of arguments: what a word of the command line means, or why it cannot be taken.

Each takes the word, and raises ArgumentTypeError saying what is wrong with it.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from rhytid.domain.lengths import MILLIMETRES, millimetres

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", re.ASCII)
MAX_PORT = 65535
MOST_FPS = 10_000


def readable(text: str) -> Path:
    """A file that is there."""
    path = Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is a folder: name a file in it")
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"no such file: {text}")
    return path


def existing(text: str) -> Path:
    """A file or folder that is there."""
    if not Path(text).exists():
        raise argparse.ArgumentTypeError(f"no such file or folder: {text}")
    return Path(text)


def port_number(text: str) -> int:
    """A TCP port, or 0."""
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_PORT):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 0 to {MAX_PORT}")
    return int(text)


def positive(text: str) -> int:
    """A whole number from 1."""
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number from 1")
    return int(text)


def rate(text: str) -> float:
    """Frames per second."""
    try:
        fps = float(text)
    except ValueError:
        fps = 0.0
    if not 0.0 < fps <= MOST_FPS:
        raise argparse.ArgumentTypeError(f"{text!r}: a number above 0, at most {MOST_FPS}")
    return fps


def unit_name(text: str) -> str:
    """The name of a length unit, or a number and a name."""
    if millimetres(text) is None:
        known = ", ".join(MILLIMETRES)
        raise argparse.ArgumentTypeError(f"{text!r}: one of {known}, or so many, as 5.5cm")
    return text


def is_file_name(text: str) -> bool:
    """Whether a text may be a part of the names of written files, which dots divide."""
    return _NAME.fullmatch(text) is not None


def base_name(text: str) -> str:
    """The first part of the names of written files."""
    if not is_file_name(text):
        rule = "a letter or digit, then up to 63 letters, digits, '_' or '-'"
        raise argparse.ArgumentTypeError(f"{text!r}: use {rule}")
    return text
