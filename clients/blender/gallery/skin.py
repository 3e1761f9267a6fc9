"""Makes skin.jpg, paper_and_best.jpg, blender.jpg and ten_minutes.jpg of docs/images: close views
of a face with the default settings, beside a scanned cheek, beside the preset `paper`, and for
pages on Blender.

    python clients/blender/gallery/skin.py FACE SCAN --out skin --rhytid .venv/bin/rhytid

By a Python that has bpy, numpy and pillow. FACE is the folder of `make.py`, SCAN that of
`scan_moves.py`. Run again, it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from face import Face
from make import begin, run
from scan_moves import baked as baked_scan
from scan_moves import moved_head
from shots import Shot, View

SIZE, TURN, LIGHT = (600, 400), 19, (1.0, 0.35, 0.1)
EXPRESSIONS = ("smile", "brow_furrow")


def _view(at: tuple[float, float, float], width: float, size: tuple[int, int] = SIZE) -> View:
    """From the face's left, under grazing light from there."""
    return View(at, width, TURN, LIGHT, size)


# The frame of each view: at rest, or an expression.
VIEWS = {
    "eye": (_view((5.3, 2.6, 7.2), 6.0), "smile"),
    "frown": (_view((0.5, 6.4, 10.7), 6.5), "brow_furrow"),
    "cheek": (_view((4.6, -1.0, 8.6), 6.5), "rest"),
    "mouth": (_view((1.8, -3.2, 10.6), 7.0), "smile"),
    "nose": (_view((1.0, 0.3, 12.2), 5.0), "rest"),
}
SCANNED = _view((4.6, 5.0, 10.0), 6.5)
_CHEEK = _view((4.0, -2.4, 8.9), 5.0, (720, 580))
# Each of a picture by itself, with its frames.
PAGES = {
    "blender": (_CHEEK, ("rest", "smile")),
    "ten_minutes": (_view((2.8, -2.6, 9.8), 8.0, (720, 480)), ("smile",)),
}
# Settings of the asset.
LOOKS = {"paper": {"preset": "paper", "graph": {"lines": "level"}}, "best": {}}
COMPARED = ("eye", "mouth", "frown", "cheek")


def main() -> None:
    """Bake, open, render, put together."""
    options = parsed()
    begin(options.out)
    face = Face.read(options.face)
    moves = np.stack([np.zeros(len(face.names)), *map(face.expression, EXPRESSIONS)])
    face.write(options.out / "face.npz", moves)
    maps = {look: baked(look, options) for look in LOOKS}
    render(face, moves, maps, options)


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path, help="folder of the ICT face")
    parser.add_argument("folder", type=Path, help="folder of the scanned head")
    parser.add_argument("--out", type=Path, default=Path("skin"), help="folder of all files")
    parser.add_argument("--rhytid", default="rhytid", help="the command rhytid")
    parser.add_argument("--resolution", type=int, default=4096, help="texels per side of a map")
    parser.add_argument("--samples", type=int, default=32, help="of a pixel")
    return parser.parse_args()


def baked(look: str, options: argparse.Namespace) -> Path:
    """The folder of the maps of all frames of the face in a look."""
    maps, settings = options.out / look, options.out / f"{look}.json"
    settings.write_text(json.dumps(LOOKS[look]), encoding="utf-8")
    given = ["bake", options.out / "face.npz", "--settings", settings]
    given += ["--store", options.out / "store"]
    run(options.rhytid, *given, "--resolution", options.resolution, "--half", "--out", maps)
    return maps.resolve()


def render(
    face: Face, moves: np.ndarray, maps: dict[str, Path], options: argparse.Namespace
) -> None:
    """All pictures.  maps: folders by look."""
    import bpy
    import rendering
    import sheets

    import gallery

    obj = gallery.opened(face, moves, maps["best"], options.out)
    rendering.settle(percent=100)

    def seen(name: str, at: View, expression: str) -> Path:
        number = 1 + ("rest", *EXPRESSIONS).index(expression)
        shot = Shot(name, at, range(number, number + 1), options.samples)
        return rendering.rendered(obj, options.out / "renders", shot, "with")[0]

    def view(name: str, look: str) -> Path:
        return seen(f"{name}_{look}", *VIEWS[name])

    best = {name: view(name, "best") for name in VIEWS}
    for name, (at, expressions) in PAGES.items():
        paths = [seen(name, at, expression) for expression in expressions]
        picture = sheets.row(paths, [""] * len(paths))
        picture.save(options.out / f"{name}.jpg", quality=gallery.STILL_QUALITY)
    bpy.ops.rhytid.open(directory=str(maps["paper"]))
    rows = [sheets.row([view(name, "paper"), best[name]], ["", ""]) for name in COMPARED]
    sheets.stack(rows).save(options.out / "paper_and_best.jpg", quality=gallery.STILL_QUALITY)

    head, at_rest = moved_head(options), baked_scan("neutral", options)
    obj = gallery.opened(head, np.zeros((1, len(head.names))), at_rest, options.out, eyes=False)
    rendering.settle(percent=100)
    shot = Shot("scan", SCANNED, range(1, 2), options.samples)
    pictures = [*best.values(), *rendering.rendered(obj, options.out / "renders", shot, "with")]
    rows = [sheets.row(pictures[i : i + 2], ["", ""]) for i in range(0, len(pictures), 2)]
    sheets.stack(rows).save(options.out / "skin.jpg", quality=gallery.STILL_QUALITY)


if __name__ == "__main__":
    main()
