"""The page of a package: no service behind it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from viewer.looking import FLAGS, Look, differ

if TYPE_CHECKING:
    from playwright.sync_api import Playwright

pytestmark = pytest.mark.browser
Opened = Callable[..., Look]
STATES = {
    "neutral": "#",
    "smile": "#weights=smile:1",
    "brow_furrow": "#weights=brow_furrow:1&light=0.5,0.7,0.5",
    "stretch": "#weights=jaw_open:1&colours=stretch&axes=1",
    "split": "#weights=smile:1,brow_furrow:1&split=0.5&relief=2",
}


def test_it_loads_quietly_and_from_here_alone(look: Opened, package: str) -> None:
    page = look(package).ready()
    picture = page.picture()

    assert page.said == []
    assert {urlsplit(url).netloc for url in page.asked} == {urlsplit(package).netloc}
    assert picture.std() > 0.05  # a face on a plain ground
    assert page.page.locator("input[value=exact]").is_disabled()


@pytest.mark.parametrize("name", STATES)
def test_a_state_is_drawn(look: Opened, package: str, name: str) -> None:
    page = look(package + STATES[name], 1280, 800).ready()
    page.keep(name)
    rest = look(package, 1280, 800).ready()

    assert (differ(page.picture(), rest.picture()) > 0.02) == (name != "neutral")
    assert page.said == []


def test_a_slider_moves_the_face_and_its_skin(look: Opened, package: str) -> None:
    page = look(package).ready()
    before = page.picture()
    slider = page.page.get_by_label("smile", exact=True)
    slider.fill("1")

    assert differ(page.picture(), before) > 0.02
    assert page.state()["weights"] == {"smile": 1}
    page.page.click("#shape-reset")
    assert differ(page.picture(), before) == 0


def test_the_method_changes_pixels_and_not_the_outline(look: Opened, package: str) -> None:
    page = look(f"{package}#weights=smile:1,brow_furrow:1&relief=3").ready()
    fast = page.picture()
    page.page.keyboard.press("1")

    assert page.state()["method"] == "neutral"
    assert 0.005 < differ(page.picture(), fast) < 0.5


def test_the_address_restores_the_view(look: Opened, package: str) -> None:
    page = look(package).ready()
    page.page.get_by_label("jaw_open", exact=True).fill("0.7")
    page.page.locator("#strength").fill("1.5")
    page.page.check("#split")
    page.page.hover("#canvas", position={"x": 100, "y": 100})
    page.page.mouse.down()
    page.page.mouse.move(180, 190)
    page.page.mouse.up()
    page.page.mouse.wheel(0, -300)
    for key in ("c", "l", "ArrowLeft"):
        page.page.keyboard.press(key)
    shown = page.picture()
    again = look(page.page.url).ready()

    assert again.url != package
    before, after = page.state(), again.state()
    for name in ("camera", "light"):
        assert numbers(after.pop(name)) == pytest.approx(numbers(before.pop(name)), rel=1e-4)
    assert after == before
    assert (before["split"], before["colours"], before["strength"]) == (0.5, "stretch", 1.5)
    assert differ(again.picture(), shown) < 0.002


def numbers(value: object) -> list[float]:
    """Every number in a value of JSON, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        return [number for one in value for number in numbers(one)]
    return [float(value)]  # type: ignore[arg-type]


def test_keys_do_what_the_list_says(look: Opened, package: str) -> None:
    page = look(package).ready()
    keys, at_first = page.page.keyboard, page.state()

    def changed(*pressed: str) -> set[str]:
        before = page.state()
        for key in pressed:
            keys.press(key)
        after = page.state()
        return {name for name in before if before[name] != after[name]}

    page.page.focus("#canvas")
    assert changed("ArrowRight") == {"camera"}
    assert changed("Shift+ArrowUp") == {"camera"}
    assert changed("+") == {"camera"}
    assert changed("c") == {"colours"}
    assert changed("x") == {"axes"}
    assert changed("s") == {"split"}
    keys.down("l")
    assert changed("ArrowLeft") == {"light"}
    keys.up("l")
    assert changed("r") == {"camera", "light"}
    assert page.state()["camera"] == at_first["camera"]
    page.page.get_by_label("smile", exact=True).focus()
    assert changed("ArrowRight", "ArrowRight") == {"weights"}
    assert page.state()["weights"] == {"smile": 0.02}
    assert changed("0") == {"weights"}
    keys.press("f")
    page.page.keyboard.type("brow")
    assert page.page.locator(".shape:visible").count() == 2
    page.page.focus("#canvas")
    keys.press("h")
    assert page.page.locator("#help-dialog").is_visible()


def test_the_divider_is_dragged_and_moved_by_keys(look: Opened, package: str) -> None:
    page = look(f"{package}#split=0.5&weights=smile:1").ready()
    box = page.page.locator("#picture-area").bounding_box()
    assert box is not None
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 50)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 50)
    page.page.mouse.up()
    assert page.state()["split"] == pytest.approx(0.25, abs=0.01)
    page.page.keyboard.press("ArrowRight")
    assert page.state()["split"] == pytest.approx(0.27, abs=0.01)


def test_the_sweep_and_a_file_of_weights_play(look: Opened, package: str, tmp_path: Path) -> None:
    page = look(package).ready()
    page.page.focus("#canvas")
    page.page.keyboard.press(" ")
    page.until("Object.keys(rhytid.store.state.weights).length > 0")
    page.page.keyboard.press(" ")
    assert page.page.inner_text("#play") == "Play"

    file = tmp_path / "take.json"
    take = {"names": ["Smile", "jawOpen", "unknown"], "fps": 24, "weights": [[0.5, 0, 1]] * 48}
    file.write_text(json.dumps(take))
    page.page.set_input_files("#clip-file", file)
    page.until("rhytid.store.state.weights.smile === 0.5")
    assert "take.json, 48 frames" in page.page.inner_text("#panel")

    file.write_text('{"names": ["smile"], "weights": [[1, 2]]}')
    page.page.set_input_files("#clip-file", file)
    page.until("!document.getElementById('banner').hidden")
    assert "frame 0 has 2 weights for 1 names" in page.page.inner_text("#banner")


def test_the_probe_tells_what_is_under_the_pointer(look: Opened, package: str) -> None:
    page = look(f"{package}#weights=smile:1").ready()
    page.page.hover("#canvas")
    page.until("document.getElementById('probe-displacement').textContent.endsWith('µm')")
    assert "×" in page.page.inner_text("#probe-stretch")
    assert page.page.inner_text("#probe-texel").startswith("1001: ")
    page.page.hover("#canvas", position={"x": 4, "y": 4})
    page.until("document.getElementById('probe-displacement').textContent === '–'")


def test_the_picture_is_a_file(look: Opened, package: str) -> None:
    page = look(package).ready()
    with page.page.expect_download() as download:
        page.page.click("#picture")
    assert download.value.suggested_filename.endswith("-fast.png")
    assert Path(download.value.path()).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_nothing_overlaps_or_is_cut_off(
    look: Opened, package: str, width: int, height: int
) -> None:
    page = look(f"{package}#colours=stretch&split=0.5&weights=smile:1", width, height).ready()
    page.page.hover("#canvas")
    page.keep(f"layout_{width}")
    boxes = [page.page.locator(part).bounding_box() for part in PARTS]
    found = [box for box in boxes if box is not None]

    assert len(found) == len(PARTS)
    for box in found:
        assert 0 <= box["x"] <= width + 0.5 - box["width"]
        assert 0 <= box["y"] <= height + 0.5 - box["height"]
    pairs = [(a, b) for i, a in enumerate(found) for b in found[i + 1 :]]
    assert not any(overlap(a, b) for a, b in pairs)
    wide = "[...document.querySelectorAll('header *, #panel *, footer *')].filter((e) => "
    wide += "e.offsetParent && e.getBoundingClientRect().right > innerWidth + 1).length"
    assert page.page.evaluate(wide) == 0


PARTS = ("header", "#canvas", "#legend", "#panel", "footer")


def overlap(a: object, b: object) -> bool:
    """Whether two boxes share more than a line."""
    x, y = (
        min(a[k] + a[s], b[k] + b[s]) - max(a[k], b[k])  # type: ignore[index]
        for k, s in (("x", "width"), ("y", "height"))
    )
    return x > 0.5 and y > 0.5


def test_a_browser_without_webgl2_says_so(playwright: Playwright, package: str) -> None:
    flags = [flag for flag in FLAGS if "swiftshader" not in flag]
    flags += ["--disable-gpu", "--disable-3d-apis"]
    browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=flags)
    try:
        page = Look(browser.new_page(), package)
        page.until("document.getElementById('message-detail').textContent.includes('WebGL2')")
        assert "cannot show the skin" in page.page.inner_text("#message")
        page.keep("without_webgl2")
    finally:
        browser.close()


def test_a_page_out_of_a_folder_says_how_to_serve_it(look: Opened, store: Path) -> None:
    page = look((store.parent / "package" / "index.html").as_uri())
    page.until("!document.getElementById('message').hidden")
    assert "python3 -m http.server" in page.page.inner_text("#message")
