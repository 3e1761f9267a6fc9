"""Makes docs/images/scan_moves.jpg: a scanned head whose displacement moves, beside the same map as
it is and beside `convolved`.

    python clients/blender/gallery/scan_moves.py FOLDER --out moves --rhytid .venv/bin/rhytid

By a Python that has bpy, numpy and pillow. FOLDER has Lee Perry-Smith's head (Infinite Realities,
CC BY 3.0) as `LeePerrySmith.glb` and `displacement_4096.jpg`. The head is moved by smooth fields,
its map is traced by `rhytid bake --scan`, and Cycles displaces the surface. Run again, it goes on
where it stopped.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from face import Face
from make import begin, run
from shots import Shot, View

# Centimetres in a unit of the file, and the scan as its README has it; the depth is a guess.
UNIT = 5.5
SCAN = [
    "--scale", "4.41", "--scan-unit", "mm", "--midlevel", "0.50196", "--flip", "v", "--unit", "cm",
]  # fmt: skip
# The method that draws each column; the first is at rest, the others are moved.
COLUMNS = {
    "at rest": "neutral",
    "the scan as it is": "neutral",
    "convolved": "convolved",
    "traced": "redraw",
}
_SIZE = (420, 420)
_CHEEK = View((4.7, 4.7, 9.9), 5.0, 32, (0.7, 0.75, -0.1), _SIZE)
# View, and the frame that it shows moved.
VIEWS = {
    "mouth": (View((2.8, 2.8, 10.4), 5.5, 20, (0.95, 0.35, 0.1), _SIZE), "smile"),
    "cheek": (_CHEEK, "smile"),
    "brows": (View((0.0, 11.0, 11.5), 6.0, 0, (0.8, 0.4, 0.5), _SIZE), "brows"),
    "eye": (View((5.2, 9.0, 8.8), 4.4, 40, (0.8, 0.6, -0.35), _SIZE), "smile"),
    "jaw": (View((2.4, 0.4, 11.0), 6.0, 18, (0.9, 0.4, 0.1), _SIZE), "jaw"),
    "cheek, 1 % wider": (_CHEEK, "wider"),
}


def main() -> None:
    """Move, bake, render, put together."""
    options = parsed()
    begin(options.out)
    head = moved_head(options)
    maps = {method: baked(method, options) for method in dict.fromkeys(COLUMNS.values())}
    render(head, maps, options)


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the head")
    parser.add_argument("--out", type=Path, default=Path("moves"), help="folder of all files")
    parser.add_argument("--rhytid", default="rhytid", help="the command rhytid")
    parser.add_argument("--resolution", type=int, default=2048, help="texels per side of a map")
    parser.add_argument("--samples", type=int, default=24, help="of a pixel")
    parser.add_argument("--views", nargs="+", choices=VIEWS, default=[*VIEWS], help="rows")
    return parser.parse_args()


def moved_head(options: argparse.Namespace) -> Face:
    """The head in centimetres, whose expressions are its frames; also written as head.npz."""
    raw = options.out / "raw.npz"
    run(options.rhytid, "convert", options.folder / "LeePerrySmith.glb", "--out", raw)
    with np.load(raw) as file:
        rest, faces, uv, corners = (file[name] for name in ("positions", "faces", "uv", "face_uv"))
    rest = (UNIT * rest.astype(np.float64)).astype(np.float32)
    frames = np.stack([rest, *(field(rest) for field in MOVES.values())]).astype(np.float32)
    mesh = {"positions": rest, "faces": faces, "uv": uv, "face_uv": corners, "frames": frames}
    np.savez(options.out / "head.npz", **mesh)
    none = np.zeros((0, len(frames)), np.float32)
    names = ["rest", *MOVES]
    return Face(rest, faces, uv, corners, names, frames - rest, none, {})


def near(points: np.ndarray, at: Sequence[float], reach: float) -> np.ndarray:
    """(V, 1) a bell around a place, in units of the file."""
    away = points / UNIT - np.array(at)
    return np.exp(-(away**2).sum(axis=1) / (2 * reach**2))[:, None]


def smile(rest: np.ndarray) -> np.ndarray:
    """Corners of the mouth 13 mm out and up, cheeks lifted."""
    found = rest.astype(np.float64)
    for side in (-1, 1):
        pull, lift = np.array((side * 0.20, 0.13, -0.06)), np.array((0.0, 0.07, 0.05))
        found += UNIT * near(rest, (side * 0.62, 0.42, 1.9), 0.30) * pull
        found += UNIT * near(rest, (side * 0.85, 0.95, 1.85), 0.30) * lift
    return found


def brows(rest: np.ndarray) -> np.ndarray:
    """Each brow 7 mm inward and 4 mm down."""
    found = rest.astype(np.float64)
    for side in (-1, 1):
        pull = np.array((-side * 0.13, -0.07, 0.02))
        found += UNIT * near(rest, (side * 0.38, 1.95, 2.1), 0.26) * pull
    return found


def jaw(rest: np.ndarray) -> np.ndarray:
    """The jaw turned down by 6 degrees about the ears, with a soft border."""
    x, y, z = rest.astype(np.float64).T / UNIT
    below, above_neck = 1 / (1 + np.exp((y - 0.42) / 0.10)), 1 / (1 + np.exp(-(y + 1.0) / 0.25))
    turn = np.radians(6) * below * above_neck / (1 + np.exp(-(z - 0.3) / 0.3))
    up, ahead = y - 1.3, z
    down = 1.3 + np.cos(turn) * up - np.sin(turn) * ahead
    return UNIT * np.stack([x, down, np.cos(turn) * ahead + np.sin(turn) * up], axis=1)


def wider(rest: np.ndarray) -> np.ndarray:
    """The whole head 1 % wider."""
    return rest * np.array((1.01, 1.0, 1.0))


MOVES = {"smile": smile, "brows": brows, "jaw": jaw, "wider": wider}


def baked(method: str, options: argparse.Namespace) -> Path:
    """The folder of the maps of all frames by one method; all have the traced skin of one store."""
    maps = options.out / method
    scan = options.folder / "displacement_4096.jpg"
    given = ["bake", options.out / "head.npz", "--scan", scan, *SCAN]
    given += ["--store", options.out / "store", "--resolution", options.resolution]
    run(options.rhytid, *given, "--method", method, "--out", maps)
    return maps.resolve()


def render(head: Face, maps: dict[str, Path], options: argparse.Namespace) -> None:
    """A row for each view: at rest, and moved with the maps of each method.  maps: their folders by
    the method."""
    import bpy
    import rendering
    import sheets

    import gallery

    found: dict[str, list[Path]] = {name: [] for name in options.views}
    moves = np.eye(len(head.names), dtype=np.float32)
    obj = gallery.opened(head, moves, maps["neutral"], options.out, eyes=False)
    rendering.settle(percent=100)
    for words, method in COLUMNS.items():
        bpy.ops.rhytid.open(directory=str(maps[method]))
        for name in options.views:
            view, moved = VIEWS[name]
            number = 1 + head.names.index("rest" if words == "at rest" else moved)
            shot = Shot(f"{name}_{words}", view, range(number, number + 1), options.samples)
            found[name] += rendering.rendered(obj, options.out / "renders", shot, "with")
    rows = [
        sheets.row(paths, [f"{name}, {words}" for words in COLUMNS])
        for name, paths in found.items()
    ]
    sheets.stack(rows).save(options.out / "scan_moves.jpg", quality=gallery.STILL_QUALITY)


if __name__ == "__main__":
    main()
