"""The viewer for browsers: a page, its style and ES modules, to be handed out as they are.

The page asks for the rest under `viewer/`: a server has `index.html` wherever it likes, and the
other files in a folder of that name beside it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

PAGE = "index.html"
FOLDER = "viewer"
# Media types of the files that a browser asks for; other files are for who writes the viewer.
MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


def names() -> list[str]:
    """Every file but the page, as `app/state.js`."""
    return sorted(name for name in _found() if name != PAGE)


def media_type(name: str) -> str:
    """Of a file, by its ending."""
    return MEDIA_TYPES["." + name.rpartition(".")[2]]


def read(name: str) -> bytes:
    """A file of `names`, or the page; raises FileNotFoundError for any other name."""
    file = _found().get(name)
    if file is None:
        raise FileNotFoundError(f"the viewer has no file {name}")
    return file.read_bytes()


def laid_out() -> dict[str, bytes]:
    """Every file by the path where the page looks for it."""
    return {PAGE: read(PAGE), **{f"{FOLDER}/{name}": read(name) for name in names()}}


@cache
def _found() -> dict[str, Path]:
    folder = Path(__file__).parent
    every = (file for file in folder.rglob("*") if file.suffix in MEDIA_TYPES)
    return {file.relative_to(folder).as_posix(): file for file in every}
