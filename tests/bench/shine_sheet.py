"""The pictures of `shine_cycles.py` on one sheet, a row for each distance:

    python tests/bench/shine_sheet.py OUT_DIR FILE.jpg --patch NAME [NAME ...] [--kinds K ...]

All of a patch in one brightness: the largest but a thousandth of what is displaced is white.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from rhytid.pictures.sheet import Panel, sheet

PIXELS, GAMMA = 200, 2.2
DISTANCES = (30, 100, 300)
TITLES = {
    "displaced": "displacement",
    "lobes": "1k moments, two lobes",
    "moments": "1k moments",
    "without": "1k, one roughness",
    "extension": "extension, two lobes",
    "single": "extension, one lobe",
}
CAPTION = (
    "2.8 cm of {}, smiling, one sun, specular alone; from 0.3, 1 and 3 m, each in the pixels that "
    "a lens of 85 mm gives it."
)


def pixels(file: Path) -> np.ndarray:
    with OpenEXR.File(str(file), separate_channels=True) as found:
        named = found.channels()
        return next(named[c].pixels.astype(float) for c in named if c.endswith("G"))


def row(folder: Path, patch: str, away: int, kinds: list[str]) -> list[Panel]:
    white = np.quantile(pixels(folder / f"{patch}-{away}-displaced.exr"), 0.999)
    panels = []
    for kind in kinds:
        seen = pixels(folder / f"{patch}-{away}-{kind}.exr") / white
        codes = (255 * seen.clip(0.0, 1.0) ** (1 / GAMMA)).astype(np.uint8)
        image = Image.fromarray(codes).resize((PIXELS, PIXELS), Image.Resampling.BOX)
        title = f"{away / 100:g} m: {TITLES[kind]}"
        panels.append(Panel(title, np.asarray(image.convert("RGB"))))
    return panels


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("file", type=Path)
    parser.add_argument("--patch", nargs="+", required=True)
    parser.add_argument("--kinds", nargs="+", choices=TITLES, default=list(TITLES))
    given = parser.parse_args()
    rows = [
        row(given.folder, patch, away, given.kinds) for patch in given.patch for away in DISTANCES
    ]
    sheet(rows, CAPTION.format(" and ".join(given.patch))).save(given.file, quality=80)


if __name__ == "__main__":
    main()
