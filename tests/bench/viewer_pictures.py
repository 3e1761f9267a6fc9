"""Makes viewer.jpg, viewer_skin.jpg and viewer_shine.jpg of docs/images, by Debian's Chromium:

    rhytid export --mesh FACE.npz --settings NAME.json --store STORE PACKAGE
    PYTHONPATH=tests python tests/bench/viewer_pictures.py STORE COMPOSITES.json OUT_DIR

FACE.npz holds expressions of ARKit's names as `shapes`, and COMPOSITES.json weights of these by the
name of an expression: the ICT face and what comes with it. NAME.json is {"name": "ICT face"}. The
store is served, and holds that asset alone. Needs the extra `browser`.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from skin_pictures import page

from viewer.conftest import CHROMIUM
from viewer.looking import FLAGS, Look
from viewer.serving import Served

if TYPE_CHECKING:
    from playwright.sync_api import Browser

QUALITY, FIELD, LIGHT = 88, 0.45, (0.9, 0.4, 0.3)
WINDOW = {"width": 1280, "height": 800}
# The first package of an asset is made when it is asked for.
SECONDS = 300.0
# For the picture of the page to be drawn by the processor.
MILLISECONDS = 5000
# Of the page: the picture of a pose from a camera, as a data URL.
DRAW = """({ weights, camera, options, size: [width, height] }) => {
  const { canvas, shapes, view } = rhytid.face;
  view.setWeights(Float32Array.from(shapes, (name) => weights[name] ?? 0));
  view.setOptions(options);
  Object.assign(canvas, { width, height });
  Object.assign(view.camera, camera);
  view.draw();
  return canvas.toDataURL("image/png");
}"""
# Of the shader: what makes a highlight broader by what a pixel has lost, and the same without.
LOST = "covariance *= min(1.0, 0.6 / max(covariance[0].x + covariance[1].y, 1e-9));"
NONE = "covariance *= 0.0;"
# Pixels of the picture from afar, how many a pixel is the mean of, by side, and how it is shown.
FAR, FINER, LARGER = (140, 125), 12, 3
Weights = dict[str, float]


@dataclass(frozen=True)
class Place:
    """What a camera looks at, cm, how wide, from how far to the left of the face, degrees, and how
    far away, cm: as far as the usual field is wide if None."""

    expression: str
    at: tuple[float, float, float]
    width: float
    turn: float
    away: float | None = None
    size: tuple[int, int] = (600, 400)
    strength: float = 1.0

    def asked(self, centre: list[float]) -> dict[str, Any]:
        """Camera and look.  centre: of the mesh."""
        half = self.width * self.size[1] / self.size[0] / 2
        away = self.away or half / math.tan(FIELD / 2)
        target = [a - c for a, c in zip(self.at, centre, strict=True)]
        camera = {"target": target, "distance": away, "yaw": math.radians(self.turn)}
        camera |= {"pitch": 0.0, "fov": 2 * math.atan(half / away)}
        options = {"light": LIGHT, "strength": self.strength, "split": None}
        return {"camera": camera, "options": options}


PLACES = (
    Place("big_smile", (5.0, 2.6, 7.5), 8.0, 30),
    Place("brow_furrow", (0.0, 5.6, 10.8), 7.0, 0),
    Place("big_smile", (3.2, -3.6, 9.8), 8.0, 22),
    Place("jaw_open", (2.0, -6.0, 8.0), 16.0, 20),
)
AFAR = Place("smile", (0.5, -2.0, 2.5), 36.0, 28, away=300.0, size=FAR, strength=2.0)


class Page:
    """The viewer of the served asset, and pictures of its canvas."""

    def __init__(self, browser: Browser, url: str, composites: dict[str, Weights]) -> None:
        self._tab = browser.new_page(viewport=WINDOW)
        self._url, self._composites = url, composites

    def ready(self) -> Page:
        """Once the face is shown."""
        look = Look(self._tab, self._url)
        look.until("Boolean(globalThis.rhytid?.face?.drawnAt)", SECONDS)
        return self

    def without_lost(self) -> Page:
        """With a shader that makes no highlight broader."""

        def answer(route: Any) -> None:
            text = route.fetch().text()
            assert LOST in text
            route.fulfill(body=text.replace(LOST, NONE), content_type="text/javascript")

        self._tab.route("**/view/surface.js", answer)
        return self

    def drawn(self, place: Place, finer: int = 1) -> Image.Image:
        """A place, by so many times more pixels a side."""
        asked = place.asked(self._tab.evaluate("rhytid.face.skin.manifest.mesh.centre"))
        asked["weights"] = self._composites[place.expression]
        asked["size"] = [finer * side for side in place.size]
        _, _, data = self._tab.evaluate(DRAW, asked).partition(",")
        return Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")

    def whole(self, expression: str) -> Image.Image:
        """The page itself at an eye, the left half at rest."""
        weights = self._composites[expression].items()
        given = ",".join(f"{name}:{value}" for name, value in weights)
        self._tab.evaluate("(hash) => { location.hash = hash }", f"split=0.5&weights={given}")
        self._tab.keyboard.press("Escape")
        self._tab.get_by_role("button", name="Eye", exact=True).click()
        self._tab.mouse.move(530, 470)
        self._tab.wait_for_timeout(MILLISECONDS)
        return Image.open(io.BytesIO(self._tab.screenshot())).convert("RGB")


def means(picture: Image.Image, side: int) -> Image.Image:
    """Of light, over squares of so many pixels a side."""
    light = (np.asarray(picture, np.float64) / 255) ** 2.2
    height, width = (size // side for size in light.shape[:2])
    light = light.reshape(height, side, width, side, 3).mean(axis=(1, 3))
    return Image.fromarray(np.rint(255 * light ** (1 / 2.2)).astype(np.uint8))


def larger(picture: Image.Image) -> Image.Image:
    """Each pixel as a square."""
    width, height = (LARGER * side for side in picture.size)
    return picture.resize((width, height), Image.Resampling.NEAREST)


def main() -> None:
    """Serve the store, look, and write the pictures."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("composites", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    composites = json.loads(given.composites.read_text(encoding="utf-8"))
    given.out.mkdir(parents=True, exist_ok=True)
    with Served(given.store) as service, sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        shown = Page(browser, service.url, composites).ready()
        shown.whole("big_smile").save(given.out / "viewer.jpg", quality=QUALITY)
        found = [shown.drawn(place) for place in PLACES]
        page([found[:2], found[2:]]).save(given.out / "viewer_skin.jpg", quality=QUALITY)
        bare = Page(browser, service.url, composites).without_lost().ready()
        finer = means(shown.drawn(AFAR, FINER), FINER)
        row = [finer, shown.drawn(AFAR), bare.drawn(AFAR)]
        page([[larger(one) for one in row]]).save(given.out / "viewer_shine.jpg", quality=QUALITY)
        browser.close()


if __name__ == "__main__":
    main()
