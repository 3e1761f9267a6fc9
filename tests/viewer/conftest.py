"""A face in a store, `rhytid serve` over it, its package, and Debian's Chromium to look at them."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from engine.engines import built, running
from exports.skin_package.conftest import write_package
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.engine.messages import NewAsset
from rhytid_lab.samples.face import procedural_face
from viewer.looking import FLAGS, HEIGHT, WIDTH, Look
from viewer.serving import Served

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Playwright

CHROMIUM = "/usr/bin/chromium"
# A package does not widen events with stretch: without any it has what the service draws.
GRAPH = {"wrinkles": 20_000, "events": 0.0}
SETTINGS = {"resolution": 512, "tile_size": 128, "graph": GRAPH}


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the built-in face, 4,608 triangles and eight shapes; beside it `package`."""
    folder = tmp_path_factory.mktemp("viewer")
    sample = procedural_face(48)
    poses = np.stack([sample.pose({name: 1.0}) for name in sample.expressions])
    shapes = Expressions.checked(poses, len(sample.mesh.positions), list(sample.expressions))
    new = NewAsset(sample.mesh, AssetSettings.parse(SETTINGS), shapes=shapes)
    with running(folder / "store") as engine:
        write_package(engine, built(engine, new), folder / "package", shapes)
    return folder / "store"


@pytest.fixture(scope="session")
def package(store: Path) -> Iterator[str]:
    """The URL of its package, from a web server that knows nothing of it."""
    handler = partial(_Quiet, directory=str(store.parent))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/package/"
        server.shutdown()
        thread.join()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="session")
def served(store: Path) -> Iterator[Served]:
    """`rhytid serve` over the store, which can be ended and started again."""
    with Served(store) as service:
        yield service


@pytest.fixture(scope="session")
def playwright() -> Iterator[Playwright]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as found:
        yield found


@pytest.fixture(scope="session")
def browser(playwright: Playwright) -> Iterator[Browser]:
    found = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
    yield found
    found.close()


@pytest.fixture(scope="session")
def open_lasting(browser: Browser) -> Iterator[Callable[..., Look]]:
    """As `open_page`, for several tests."""
    with _opening(browser) as opened:
        yield opened


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Look]]:
    """Opens an address in a tab of its own, until the test ends: `open_page(url)`."""
    with _opening(browser) as opened:
        yield opened


@contextmanager
def _opening(browser: Browser) -> Iterator[Callable[..., Look]]:
    with ExitStack() as contexts:

        def opened(url: str) -> Look:
            context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT})
            contexts.callback(context.close)
            return Look(context.new_page(), url)

        yield opened


@pytest.fixture(scope="session")
def shared(open_lasting: Callable[..., Look], package: str) -> Look:
    return open_lasting(package).ready()


@pytest.fixture
def look(shared: Look) -> Look:
    """The page of the package as at first."""
    return shared.go()
