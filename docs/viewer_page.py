"""Writes a page with the built-in face into the site: `python docs/viewer_page.py site/face`.

The page is a skin package with the viewer (docs/viewer.md), for any web server. Its large files are
packed by gzip, which the viewer unpacks: servers rarely compress textures by themselves.
"""

from __future__ import annotations

import argparse
import gzip
import sys
import tempfile
from pathlib import Path

from rhytid.cli import main as rhytid
from rhytid_lab.commands.demo_face import animation

RESOLUTION = 1024
# Of the element `html`: which ending the files of the package have.
PLAIN, PACKED = '<html lang="en">', '<html lang="en" data-packed="gz">'


def main() -> None:
    """Export the face, then pack it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="a new folder, or an empty one")
    folder: Path = parser.parse_args().folder
    if folder.exists() and any(folder.iterdir()):
        parser.error(f"{folder} is not empty")
    with tempfile.TemporaryDirectory() as temporary:
        mesh = Path(temporary) / "face.npz"
        animation(None, []).save(mesh)
        given = ["--resolution", str(RESOLUTION), "--levels", "1"]
        status = rhytid(["export", str(folder), "--mesh", str(mesh), *given])
    if status:
        sys.exit(status)
    pack(folder)
    every = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    sys.stdout.write(f"{folder}: {every} bytes\n")


def pack(folder: Path) -> None:
    """Put `NAME.gz` in place of every file that is not the viewer's own."""
    page = folder / "index.html"
    text = page.read_text(encoding="utf-8")
    if PLAIN not in text:
        raise SystemExit(f"{page}: no {PLAIN}")
    page.write_text(text.replace(PLAIN, PACKED), encoding="utf-8")
    for file in sorted(folder.rglob("*")):
        if file.is_file() and file != page and folder / "viewer" not in file.parents:
            # No time in the header: the same face gives the same bytes.
            packed = gzip.compress(file.read_bytes(), 9, mtime=0)
            file.with_name(f"{file.name}.gz").write_bytes(packed)
            file.unlink()


if __name__ == "__main__":
    main()
