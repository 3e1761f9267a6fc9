"""What goes wrong around the viewer: graphics that are lost or refuse, answers that are late."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING

import httpx
import pytest

from viewer.looking import Look, differ
from viewer.serving import Served

if TYPE_CHECKING:
    from playwright.sync_api import Route

pytestmark = pytest.mark.browser
Opened = Callable[..., Look]
EXACT = "document.getElementById('status').textContent.includes('exact: all')"
# MAX_ARRAY_TEXTURE_LAYERS
FEW_LAYERS = "getParameter = function (name) { return name === 0x88ff ? 2 : this.real(name); }"
BANNER = "document.getElementById('banner')"


def test_a_lost_context_is_told_and_what_was_shown_comes_back(
    open_page: Opened, package: str
) -> None:
    look = open_page(f"{package}#weights=smile:1").ready()
    shown = look.picture()
    look.page.evaluate(
        "globalThis.lose = rhytid.canvas.getContext('webgl2').getExtension('WEBGL_lose_context');"
        "globalThis.before = rhytid.face; lose.loseContext()"
    )
    look.until(f"{BANNER}.textContent.includes('lost the graphics')")
    look.page.wait_for_timeout(100)  # a context is restored after its event of the loss
    look.page.evaluate("lose.restoreContext()")
    look.until("rhytid.face !== before && rhytid.face.drawnAt > 0")

    assert look.page.evaluate(f"{BANNER}.hidden")
    assert differ(look.picture(), shown) == 0
    assert [line for line in look.said if line.startswith(("error", "pageerror"))] == []


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (FEW_LAYERS, "2 layers"),
        ("getError = () => 0x0505", "no memory"),
    ],
)
def test_a_face_that_the_graphics_cannot_take_leaves_the_one_before(
    open_page: Opened, served: Served, broken: str, told: str
) -> None:
    page = open_page(served.url).ready()
    page.page.evaluate(
        "{ const p = WebGL2RenderingContext.prototype, { getParameter, getError } = p;"
        f"p.real = getParameter; globalThis.kept = {{ getParameter, getError }}; p.{broken} }} 0"
    )
    page.page.evaluate("rhytid.served.choose(rhytid.store.state.asset, null)")
    assert told in page.page.inner_text("#banner")
    assert page.page.locator("canvas#canvas").count() == 1
    page.page.evaluate("Object.assign(WebGL2RenderingContext.prototype, kept)")
    at_rest = page.picture()
    page.page.get_by_label("smile", exact=True).fill("1")
    assert differ(page.picture(), at_rest) > 0.02

    page.page.evaluate("rhytid.served.choose(rhytid.store.state.asset, null)")
    assert page.page.evaluate(f"{BANNER}.hidden")


def test_an_asset_that_is_late_does_not_replace_a_later_choice(
    open_page: Opened, served: Served
) -> None:
    page = open_page(served.url).ready()
    real = page.state()["asset"]
    held: list[Route] = []
    listed = httpx.get(f"{served.url}v1/assets").json()
    late = [{**one, "id": "late"} for one in listed if one["id"] == real]
    page.page.route("**/v1/assets", lambda route: route.fulfill(json=listed + late))
    page.page.route("**/v1/assets/late/**", lambda route: held.append(route))

    def deliver(route: Route) -> None:
        route.continue_(url=route.request.url.replace("/late/", f"/{real}/"))

    page.page.evaluate("rhytid.served.refresh()")
    page.page.select_option("#asset", "late")
    page.page.wait_for_timeout(100)
    assert held
    page.page.evaluate("globalThis.before = rhytid.face")
    page.page.select_option("#asset", real)
    page.until("rhytid.face !== before && rhytid.face.drawnAt > 0")
    page.page.evaluate("globalThis.before = rhytid.face")
    page.page.unroute("**/v1/assets/late/**")
    page.page.route("**/v1/assets/late/**", deliver)
    for route in held:
        deliver(route)
    page.page.wait_for_timeout(2000)

    assert page.page.evaluate("rhytid.face === before")
    assert page.state()["asset"] == real
    assert page.page.locator("#asset").input_value() == real
    assert page.page.evaluate("rhytid.served.exact.frame").startswith(f"v1/assets/{real}/")
    assert page.page.evaluate(f"{BANNER}.hidden")


def test_an_address_reaches_assets_alone(open_page: Opened, served: Served) -> None:
    page = open_page(served.url).ready()
    page.page.evaluate("location.hash = 'asset=../devices?x='")
    page.until(f"{BANNER}.textContent.includes('no asset ../devices')")

    assert not [url for url in page.asked if "devices" in url.split("#")[0]]


def test_exact_skin_is_back_with_a_page_from_the_history(open_page: Opened, served: Served) -> None:
    page = open_page(f"{served.url}#weights=smile:1&method=exact").ready()
    page.until(EXACT)
    old = page.page.evaluate("rhytid.served.exact.frame")
    page.page.evaluate("dispatchEvent(new PageTransitionEvent('pagehide', { persisted: true }))")
    page.until("!rhytid.served.exact.on")
    page.page.evaluate("dispatchEvent(new PageTransitionEvent('pageshow', { persisted: true }))")
    page.page.get_by_label("smile", exact=True).fill("0.5")
    page.until(f"{EXACT} && rhytid.served.exact.tiles.size > 0")
    new = page.page.evaluate("rhytid.served.exact.frame")

    assert httpx.get(served.url + old).status_code == 404
    assert httpx.get(served.url + new).status_code == 200


def test_leaving_exact_skin_gives_its_memory_back(open_page: Opened, served: Served) -> None:
    page = open_page(f"{served.url}#weights=smile:1").ready()
    size = "rhytid.face.view.statistics().textureBytes"
    page.still()
    before = page.page.evaluate(size)
    page.page.keyboard.press("3")
    page.until(EXACT)
    exact = page.picture()
    assert page.page.evaluate(size) > before
    page.page.keyboard.press("2")
    assert page.page.evaluate(size) == before
    page.page.keyboard.press("3")
    page.until(EXACT)
    assert differ(page.picture(), exact) == 0


def test_a_probe_uploads_nothing(look: Look) -> None:
    look.go("weights=smile:1")
    sent = look.page.evaluate(
        "(() => { const gl = rhytid.canvas.getContext('webgl2'), real = gl.texSubImage2D;"
        "let count = 0; gl.texSubImage2D = (...given) => { count += 1; real.apply(gl, given); };"
        "const { clientWidth, clientHeight } = rhytid.canvas;"
        "const found = rhytid.face.view.probe(clientWidth / 2, clientHeight / 2);"
        "delete gl.texSubImage2D; return [count, found.displacement] })()"
    )
    assert sent[0] == 0
    assert sent[1] != 0


def test_a_busy_server_is_asked_again(open_page: Opened, package: str) -> None:
    look = open_page("about:blank")
    refused: list[str] = []

    def answer(route: Route) -> None:
        if len(refused) < 2 and route.request.url not in refused:
            refused.append(route.request.url)
            route.fulfill(status=503)
        else:
            route.continue_()

    look.page.route("**/textures/*", answer)
    look.page.goto(package)
    look.ready()
    assert len(refused) == 2


def test_an_answer_that_is_no_file_is_told(open_page: Opened, package: str) -> None:
    look = open_page("about:blank")
    body = json.dumps({"state": "queued"})
    look.page.route("**/manifest.json", lambda route: route.fulfill(status=202, body=body))
    look.page.goto(package)
    look.until("document.getElementById('message-detail').textContent.includes('202')")


def test_files_of_one_package_are_read_and_begun_again_where_the_asset_changes(
    open_page: Opened, served: Served
) -> None:
    look = open_page("about:blank")
    changed: list[str] = []

    def answer(route: Route) -> None:
        if changed:
            route.continue_()
        else:
            changed.append(route.request.url)
            route.fulfill(status=409, json={"detail": "the asset has changed: begin again"})

    look.page.route("**/package/textures/*", answer)
    look.page.goto(served.url)
    look.ready()
    files = [url for url in look.asked if "/package/" in url]
    assert len(changed) == 1
    assert sum("/package/manifest.json" in url for url in files) == 2
    assert all("key=" in url for url in files if "/package/manifest.json" not in url)
    assert look.page.evaluate(f"{BANNER}.hidden")
