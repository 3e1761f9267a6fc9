"""A tab of Chromium that shows the viewer."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from playwright.sync_api import Page

SECONDS = 30.0
# Of the window: small, because the pictures are drawn by the processor.
WIDTH, HEIGHT = 900, 480
# Drawn by SwiftShader, on the processor. What Chromium asks of its maker's hosts is turned off.
FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]  # fmt: skip
# Where pictures are kept to be looked at.
PICTURES = Path(os.environ.get("RHYTID_SCREENSHOTS", "build/screenshots"))


class Look:
    """What a page shows, and what it says of itself."""

    def __init__(self, page: Page, url: str) -> None:
        self.page, self.url = page, url
        self.said: list[str] = []
        self.asked: list[str] = []
        page.on("console", lambda message: self.said.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.said.append(f"pageerror: {error}"))
        page.on("request", lambda request: self.asked.append(request.url))
        page.goto(url)

    def ready(self) -> Look:
        """Once a face is drawn."""
        self.until("Boolean(globalThis.rhytid?.face?.drawnAt)")
        return self

    def go(self, view: str = "", width: int = WIDTH, height: int = HEIGHT) -> Look:
        """To another view of the same page, by the part of the address after #; what was said
        before is forgotten."""
        self.page.keyboard.press("Escape")
        # No button over the picture is pointed at or has a ring around it.
        self.page.mouse.move(2, 2)
        self.page.evaluate("document.activeElement.blur()")
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.evaluate("(hash) => { location.hash = hash }", view or "none")
        self.still()
        self.said.clear()
        return self

    def until(self, expression: str, seconds: float = SECONDS) -> Any:
        """The value of JavaScript, once it is true. Not by `wait_for_function`, whose `eval` the
        policy of the page forbids."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            found = self.page.evaluate(expression)
            if found:
                return found
            self.page.wait_for_timeout(50)
        said = self.page.inner_text("body")[:400]
        raise AssertionError(f"never true: {expression}\n{said}\n{self.said}")

    def still(self) -> None:
        """Once two pictures have been drawn since now, and the address was written."""
        self.page.wait_for_timeout(350)
        self.page.evaluate(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def picture(self) -> NDArray[np.float64]:
        """(rows, columns, 3) of the canvas, from 0 to 1."""
        self.still()
        image = Image.open(io.BytesIO(self.page.locator("#canvas").screenshot()))
        return np.asarray(image.convert("RGB"), float) / 255

    def keep(self, name: str) -> None:
        """The whole page as a file that people look at."""
        self.still()
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=PICTURES / f"{name}.png")

    def state(self) -> dict[str, Any]:
        """What the page shows, its camera too."""
        found: dict[str, Any] = self.page.evaluate(
            "({ ...rhytid.store.state, camera: rhytid.face.place() })"
        )
        return found


def differ(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """The share of pixels that differ by more than one part in 50."""
    return float((np.abs(one - other).max(axis=2) > 0.02).mean())
