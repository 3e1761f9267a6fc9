"""Makes docs/images/viewer_skin.jpg: close views of the viewer's own, drawn by Debian's Chromium.

    rhytid export --mesh FACE.npz PACKAGE
    PYTHONPATH=tests python tests/bench/viewer_pictures.py PACKAGE COMPOSITES.json OUT.jpg

FACE.npz holds expressions of ARKit's names as `shapes`, and COMPOSITES.json weights of these by the
name of an expression: the ICT face and what comes with it. Needs the extra `browser`.
"""

from __future__ import annotations

import argparse
import base64
import http.server
import io
import json
import math
import threading
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image
from skin_pictures import page

from viewer.conftest import CHROMIUM
from viewer.looking import FLAGS, HEIGHT, WIDTH, Look

if TYPE_CHECKING:
    from playwright.sync_api import Page

SIZE, QUALITY, FIELD, LIGHT = (600, 400), 88, 0.45, (0.9, 0.4, 0.3)
# Of the page: the picture of a pose from a camera, as a data URL.
DRAW = """({ weights, camera, light, size: [width, height] }) => {
  const { canvas, shapes, skin, view } = rhytid.face;
  view.setWeights(Float32Array.from(shapes, (name) => weights[name] ?? 0));
  view.setOptions({ light });
  Object.assign(canvas, { width, height });
  Object.assign(view.camera, camera);
  view.draw();
  return canvas.toDataURL("image/png");
}"""


@dataclass(frozen=True)
class Place:
    """What a camera looks at, cm, how wide, from how far to the left of the face, degrees."""

    expression: str
    at: tuple[float, float, float]
    width: float
    turn: float

    def asked(self, centre: list[float]) -> dict[str, Any]:
        """Camera and light.  centre: of the mesh."""
        away = self.width * SIZE[1] / SIZE[0] / (2 * math.tan(FIELD / 2))
        target = [a - c for a, c in zip(self.at, centre, strict=True)]
        camera = {"target": target, "distance": away, "yaw": math.radians(self.turn)}
        return {"camera": {**camera, "pitch": 0.0, "fov": FIELD}, "light": LIGHT, "size": SIZE}


PLACES = (
    Place("big_smile", (5.0, 2.6, 7.5), 8.0, 30),
    Place("brow_furrow", (0.0, 5.6, 10.8), 7.0, 0),
    Place("big_smile", (3.2, -3.6, 9.8), 8.0, 22),
    Place("jaw_open", (2.0, -6.0, 8.0), 16.0, 20),
)


def pictures(tab: Page, composites: dict[str, dict[str, float]]) -> list[Image.Image]:
    """Of all places, drawn by the page of a package."""
    centre = tab.evaluate("rhytid.face.skin.manifest.mesh.centre")
    found = []
    for place in PLACES:
        asked = {"weights": composites[place.expression], **place.asked(centre)}
        _, _, data = tab.evaluate(DRAW, asked).partition(",")
        found.append(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))
    return found


def main() -> None:
    """Serve the package, look, and write the picture."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("package", type=Path)
    parser.add_argument("composites", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=str(given.package))
    with (
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server,
        sync_playwright() as p,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = p.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        Look(tab, f"http://127.0.0.1:{server.server_address[1]}/").ready()
        composites = json.loads(given.composites.read_text(encoding="utf-8"))
        found = pictures(tab, composites)
        page([found[:2], found[2:]]).save(given.out, quality=QUALITY)
        browser.close()
        server.shutdown()


if __name__ == "__main__":
    main()
