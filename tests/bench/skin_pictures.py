"""Leaders, single features and folds of a face, as pictures of docs/skin.md and docs/lines.md:

    python tests/bench/skin_pictures.py FACE.npz COMPOSITES.json OUT_DIR [--only leaders]

FACE.npz holds expressions of ARKit's names as `shapes`, and COMPOSITES.json weights of these by the
name of an expression: the ICT face and what comes with it. OUT_DIR gets leaders.jpg, events.jpg and
folds.jpg. Skin is grown with the default settings but for what a picture is about.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from patchiness import RESOLUTION, UNIT, Face
from PIL import Image
from scipy.ndimage import gaussian_filter

from rhytid.baking.input_files import mesh_file, shape_files
from rhytid.cli.preview import drawn_under, resident
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.blendshapes import Blendshapes
from rhytid.engine.engine import open_device
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.pictures.surface_patch import Frame as View
from rhytid.pictures.surface_patch import SurfacePatch, surface_patch
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import Synthesis, synthesize

GAP = 4
# Millimetres: the deviation of the Gaussian that takes what is longer than some 3 mm.
SHORT = 0.6


@dataclass(frozen=True)
class Place:
    """A square of skin: in which expression, None at rest; near which place, cm; how wide, cm."""

    expression: str | None
    at: tuple[float, float, float]
    side: float
    pixels: int = 330


LEADERS = (
    Place("brow_furrow", (0.0, 4.6, 10.5), 3.6),
    Place("brows_up", (-2.2, 7.2, 10.2), 3.6),
    Place("big_smile", (5.6, 2.4, 6.8), 3.6),
    Place("big_smile", (3.4, -4.3, 9.0), 3.6),
)
EVENTS = (
    Place(None, (2.0, -12.0, 6.0), 2.5),
    Place(None, (4.6, -1.0, 8.6), 2.5),
    Place(None, (0.0, -6.6, 9.5), 2.5),
    Place(None, (0.6, 0.4, 12.2), 1.4),
)
FOLDS = (Place("brows_up", (-2.6, 6.3, 9.9), 2.0, 480),)
# Where figures are taken at rest, without folds and with them.
SLOPES = (
    *FOLDS,
    Place("brows_up", (2.6, 6.3, 9.9), 2.0, 480),
    Place("big_smile", (5.6, 2.4, 6.8), 2.0, 480),
    Place("big_smile", (3.4, -4.3, 9.0), 2.0, 480),
)
Grown = tuple[Synthesis, AssetSettings]


class Pictures:
    """A face, its expressions, and pictures of its skin."""

    def __init__(self, face: Face, file: Path, composites: Path) -> None:
        self._face, self._mesh = face, face.mesh
        shapes = shape_files(None, mesh_file(file))
        assert shapes is not None
        self._weights = json.loads(composites.read_text(encoding="utf-8"))
        self._shapes = Blendshapes(self._mesh.positions, shapes, shapes.names)

    def grown(self, **graph: float) -> Grown:
        """Skin with settings of its graph."""
        settings = AssetSettings.parse({"unit": UNIT, "graph": graph}).for_synthesis()
        made = synthesize(
            self._mesh, settings.graph, self._face.device, folds=self._face.folds, unit=UNIT
        )
        return made, settings.with_lengths(made.lengths).changed({"resolution": RESOLUTION})

    def drawn(self, skin: Grown, place: Place) -> tuple[SurfacePatch, NDArray[np.float32]]:
        """What is seen of a place, and (R, R) displacement under it, mesh units."""
        made, settings = skin
        face, posed = self._face, self.posed(self.weights(place.expression))
        frame = NEUTRAL_FRAME if place.expression is None else Frame.of(posed)
        patch = self.patch(posed, place)
        with resident(face.device, self._mesh, made.graph, settings) as asset:
            return patch, drawn_under(asset, face.udim, [patch], lambda *_: None, frame)

    def figures(self, skin: Grown, place: Place) -> str:
        """Of the relief of a place slopes, degrees: their root mean square and what 95 % are below;
        and the deepest hundredth, micrometres, of what SHORT lets through."""
        patch, drawn = self.drawn(skin, place)
        seen, step = patch.seen.covered, 10 * place.side / place.pixels
        slopes = np.degrees(np.arctan(np.linalg.norm(patch.gradient(drawn), axis=-1)[seen]))
        heights = 1e4 * patch.heights(drawn)
        fine = (heights - gaussian_filter(heights, SHORT / step))[seen]
        most, deepest = np.percentile(slopes, 95), np.percentile(fine, 1)
        return f"{np.sqrt((slopes**2).mean()):.1f}, {most:.1f} degrees, {deepest:.0f} µm"

    def weights(self, name: str | None) -> NDArray[np.float64]:
        """(E,) of an expression; zeros at rest."""
        weights: Mapping[str, float] = {} if name is None else self._weights[name]
        return np.array([weights.get(n, 0.0) for n in self._shapes.names])

    def posed(self, weights: NDArray[np.float64]) -> NDArray[np.float32]:
        """(V, 3) positions, cm, of weights (E,)."""
        return self._shapes.positions(weights.astype(np.float32))

    def row(self, skin: Grown, places: tuple[Place, ...], light: float) -> list[Image.Image]:
        """Pictures of places under a light so many degrees above the skin."""
        found = (self.drawn(skin, place) for place in places)
        return [Image.fromarray(patch.picture(heights, light)) for patch, heights in found]

    def patch(self, posed: NDArray[np.float32], place: Place) -> SurfacePatch:
        """Around the triangle that is nearest to a place at rest, faced as the centimetre around
        it."""
        rest = self._mesh.positions[self._mesh.faces].astype(np.float64).mean(axis=1)
        corners = posed[self._mesh.faces].astype(np.float64)
        nearest = int(np.argmin(((rest - place.at) ** 2).sum(axis=1)))
        around = ((rest - rest[nearest]) ** 2).sum(axis=1) < 1.0
        one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        view = View.at(corners[nearest].mean(axis=0), np.cross(one, two)[around].sum(axis=0))
        return surface_patch(corners, self._mesh.triangle_uv(), view, place.side, place.pixels)


def page(rows: list[list[Image.Image]]) -> Image.Image:
    """Pictures of one size, in rows."""
    width, height = (size + GAP for size in rows[0][0].size)
    found = Image.new("RGB", (width * len(rows[0]) - GAP, height * len(rows) - GAP), "white")
    for y, row in enumerate(rows):
        for x, picture in enumerate(row):
            found.paste(picture, (x * width, y * height))
    return found


def leaders(pictures: Pictures) -> Image.Image:
    """`graph.rank` 0, 1 and 2 from above."""
    skins = (pictures.grown(age=40.0, rank=rank) for rank in (0.0, 1.0, 2.0))
    return page([pictures.row(skin, LEADERS, 25.0) for skin in skins])


def events(pictures: Pictures) -> Image.Image:
    """`graph.events` 0, 1 and 4 from above."""
    skins = (pictures.grown(events=count) for count in (0.0, 1.0, 4.0))
    return page([pictures.row(skin, EVENTS, 18.0) for skin in skins])


def folds(pictures: Pictures) -> Image.Image:
    """`response.folds` 0 and 1 from the left, light at 45° and at 15° from above. Prints what is
    at rest, without folds and with them."""
    made, settings = pictures.grown()
    skins = [(made, settings.changed({"response": {"folds": share}})) for share in (0.0, 1.0)]
    for place in SLOPES:
        rest = pictures.figures(skins[1], replace(place, expression=None))
        without, with_folds = (pictures.figures(skin, place) for skin in skins)
        sys.stdout.write(f"{place.expression} {place.at}: at rest {rest}\n")
        sys.stdout.write(f"    folds 0: {without}\n    folds 1: {with_folds}\n")
    return page([[pictures.row(skin, FOLDS, light)[0] for skin in skins] for light in (45.0, 15.0)])


MADE = {"leaders": leaders, "events": events, "folds": folds}


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("composites", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", choices=MADE)
    parser.add_argument("--device")
    arguments = parser.parse_args()
    face = Face(open_device(ServiceSettings(), arguments.device), arguments.face)
    pictures = Pictures(face, arguments.face, arguments.composites)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in MADE if arguments.only is None else (arguments.only,):
        MADE[name](pictures).save(arguments.out / f"{name}.jpg", quality=88)


if __name__ == "__main__":
    main()
