"""The page of a package: no service behind it."""

from __future__ import annotations

import json
import runpy
import shutil
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from house.syntax import ROOT
from viewer.conftest import CHROMIUM
from viewer.looking import FLAGS, Look, differ

if TYPE_CHECKING:
    from playwright.sync_api import Playwright

pytestmark = pytest.mark.browser
Opened = Callable[..., Look]
STATES = {
    "neutral": "",
    "smile": "weights=smile:1",
    "brow_furrow": "weights=brow_furrow:1&light=0.5,0.7,0.5",
    "stretch": "weights=jaw_open:1&colours=stretch&axes=1",
    "split": "weights=smile:1,brow_furrow:1&split=0.5&relief=2",
}

# Behind a face, as it is drawn.
GROUND = np.array([61, 63, 68]) / 255


def test_it_loads_quietly_and_from_here_alone(open_page: Opened, package: str) -> None:
    look = open_page(package).ready()
    picture = look.picture()

    assert look.said == []
    assert {urlsplit(url).netloc for url in look.asked} == {urlsplit(package).netloc}
    assert picture.std() > 0.05  # a face on a plain ground
    assert look.page.locator("input[value=exact]").is_disabled()


def ground(look: Look) -> float:
    """The share of the picture without a face."""
    picture = look.picture()[:300]  # above the buttons
    return float((np.abs(picture - GROUND).max(axis=2) < 0.02).mean())


def test_the_first_view_is_close_and_buttons_have_the_others(look: Look) -> None:
    look.page.click("#views >> text=Face")
    whole = ground(look)
    look.page.keyboard.press("r")
    first = look.picture()[:300]
    assert 0.2 < whole < 0.9
    assert ground(look) < 0.1
    views: dict[str, Any] = {}
    for name in ("Face", "Forehead", "Eye", "Cheek", "Mouth"):
        look.page.click(f"#views >> text={name}")
        views[name] = look.picture()
        assert name == "Face" or ground(look) < 0.2
        look.keep(f"view_{name.lower()}")
    assert min(differ(a, b) for a, b in combinations(views.values(), 2)) > 0.1
    assert differ(views["Cheek"][:300], first) == 0
    places = [look.state()["camera"]]
    for _ in range(5):
        look.page.keyboard.press("v")
        places.append(look.state()["camera"])
    assert places[0] == places[5]
    assert len({json.dumps(place) for place in places}) == 5


PLACES = (
    "const { viewsOf } = await import('./viewer/app/views.js');"
    "const { mesh } = rhytid.face.skin;"
    "return Object.fromEntries(viewsOf({ ...mesh, shapes: shapes(mesh) }, 0.45)"
    ".map(({ name, place }) => [name, place]))"
)


@pytest.mark.parametrize(
    "shapes",
    [
        "[]",
        "mesh.shapes.map((shape, index) => ({ ...shape, name: `shape${index}` }))",
        "mesh.shapes.map(({ offsets }) => ({ name: 'eyeBlink', offsets: offsets.map(() => 0) }))",
    ],
)
def test_a_face_that_no_shape_tells_of_is_looked_at_all_the_same(look: Look, shapes: str) -> None:
    found = look.page.evaluate(f"(async () => {{ const shapes = (mesh) => {shapes}; {PLACES} }})()")
    assert list(found) == ["Face", "Forehead", "Eye", "Cheek", "Mouth"]
    heights = [found[name]["target"][1] for name in ("Forehead", "Eye", "Cheek", "Mouth")]
    assert heights == sorted(heights, reverse=True)
    assert all(np.isfinite(place["distance"]) for place in found.values())
    assert found["Face"]["distance"] > 2 * found["Cheek"]["distance"]


def test_states_are_drawn(look: Look) -> None:
    pictures = {}
    for name, view in STATES.items():
        look.go(view, 1280, 800).keep(name)
        pictures[name] = look.picture()[:600]

    assert min(differ(a, b) for a, b in combinations(pictures.values(), 2)) > 0.02
    assert look.said == []


def test_a_slider_moves_the_face_and_its_skin(look: Look) -> None:
    before = look.picture()
    look.page.get_by_label("smile", exact=True).fill("1")

    assert differ(look.picture(), before) > 0.02
    assert look.state()["weights"] == {"smile": 1}
    look.page.click("#shape-reset")
    assert differ(look.picture(), before) == 0


def test_the_method_changes_pixels_and_not_the_outline(look: Look) -> None:
    look.go("weights=smile:1,brow_furrow:1&relief=3")
    fast = look.picture()
    look.page.keyboard.press("1")

    assert look.state()["method"] == "neutral"
    assert 0.005 < differ(look.picture(), fast) < 0.5


def test_the_address_restores_the_view(look: Look, open_page: Opened, package: str) -> None:
    page = look.page
    page.get_by_label("jaw_open", exact=True).fill("0.7")
    page.locator("#strength").fill("1.5")
    page.check("#split")
    page.hover("#canvas", position={"x": 100, "y": 100})
    page.mouse.down()
    page.mouse.move(180, 190)
    page.mouse.up()
    page.mouse.wheel(0, -300)
    page.keyboard.press("c")
    page.keyboard.down("l")
    page.keyboard.press("ArrowUp")
    page.keyboard.up("l")
    page.evaluate("document.activeElement.blur()")  # it has a ring around it
    shown = look.picture()
    again = open_page(page.url).ready()

    assert again.url != package
    before, after = look.state(), again.state()
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


def test_keys_do_what_the_list_says(look: Look) -> None:
    keys, at_first = look.page.keyboard, look.state()

    def changed(*pressed: str) -> set[str]:
        before = look.state()
        for key in pressed:
            keys.press(key)
        after = look.state()
        return {name for name in before if before[name] != after[name]}

    look.page.focus("#canvas")
    assert changed("ArrowRight") == {"camera"}
    assert changed("Shift+ArrowUp") == {"camera"}
    assert changed("+") == {"camera"}
    assert changed("c") == {"colours"}
    assert changed("x") == {"axes"}
    assert changed("s") == {"split"}
    keys.down("l")
    assert changed("ArrowLeft") == {"light"}
    keys.up("l")
    look.page.focus("#light")
    before = look.state()["light"]
    assert changed("ArrowRight", "ArrowUp") == {"light"}
    assert np.linalg.norm(np.subtract(look.state()["light"], before)) > 0.05
    assert changed("r") == {"camera", "light"}
    assert look.state()["camera"] == at_first["camera"]
    look.page.get_by_label("smile", exact=True).focus()
    assert changed("ArrowRight", "ArrowRight") == {"weights"}
    assert look.state()["weights"] == {"smile": 0.02}
    assert changed("0") == {"weights"}
    keys.press("f")
    keys.type("brow")
    assert look.page.locator(".shape:visible").count() == 2
    look.page.fill("#shape-filter", "")
    look.page.focus("#canvas")
    keys.press("h")
    assert look.page.locator("#help-dialog").is_visible()


def test_the_divider_is_dragged_and_moved_by_keys(look: Look) -> None:
    look.go("split=0.5&weights=smile:1")
    box = look.page.locator("#picture-area").bounding_box()
    assert box is not None
    look.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 50)
    look.page.mouse.down()
    look.page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 50)
    look.page.mouse.up()
    assert look.state()["split"] == pytest.approx(0.25, abs=0.01)
    look.page.keyboard.press("ArrowRight")
    assert look.state()["split"] == pytest.approx(0.27, abs=0.01)


def test_the_sweep_and_a_file_of_weights_play(look: Look, tmp_path: Path) -> None:
    look.page.focus("#canvas")
    look.page.keyboard.press(" ")
    look.until("Object.keys(rhytid.store.state.weights).length > 0")
    look.page.keyboard.press(" ")
    assert look.page.inner_text("#play") == "Play"

    file = tmp_path / "take.json"
    take = {"names": ["Smile", "jawOpen", "unknown"], "fps": 24, "weights": [[0.5, 0, 1]] * 48}
    file.write_text(json.dumps(take))
    look.page.set_input_files("#clip-file", file)
    look.until("rhytid.store.state.weights.smile === 0.5")
    assert "take.json, 48 frames" in look.page.inner_text("#panel")

    file.write_text('{"names": ["smile"], "weights": [[1, 2]]}')
    look.page.set_input_files("#clip-file", file)
    look.until("!document.getElementById('banner').hidden")
    assert "frame 0 has 2 weights for 1 names" in look.page.inner_text("#banner")
    look.page.reload()
    look.ready()


@pytest.mark.parametrize("packed", [False, True])
def test_weights_are_read_as_numpy_writes_them(look: Look, tmp_path: Path, packed: bool) -> None:
    file, weights = tmp_path / "take.npz", np.zeros((30, 2), np.float64)
    weights[:, 1] = 0.25
    (np.savez_compressed if packed else np.savez)(
        file, weights=weights, names=np.array(["smile", "jaw_open"]), fps=np.float32(30)
    )
    look.page.set_input_files("#clip-file", file)

    look.until("rhytid.store.state.weights.jaw_open === 0.25")


def test_the_probe_tells_what_is_under_the_pointer(look: Look) -> None:
    look.go("weights=smile:1")
    look.page.click("#views >> text=Face")
    look.page.hover("#canvas")
    look.until("document.getElementById('probe-displacement').textContent.endsWith('µm')")
    assert "×" in look.page.inner_text("#probe-stretch")
    assert look.page.inner_text("#probe-texel").startswith("1001: ")
    look.page.hover("#canvas", position={"x": 4, "y": 4})
    look.until("document.getElementById('probe-displacement').textContent === '–'")


def test_the_picture_is_a_file(look: Look) -> None:
    with look.page.expect_download() as download:
        look.page.click("#picture")
    assert download.value.suggested_filename.endswith("-fast.png")
    assert Path(download.value.path()).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_nothing_overlaps_or_is_cut_off(look: Look, width: int, height: int) -> None:
    look.go("colours=stretch&split=0.5&weights=smile:1", width, height)
    look.page.hover("#canvas", position={"x": 130, "y": 180})
    look.keep(f"layout_{width}")
    boxes = [look.page.locator(part).bounding_box() for part in PARTS]
    found = [box for box in boxes if box is not None]

    assert len(found) == len(PARTS)
    for box in found:
        assert 0 <= box["x"] <= width + 0.5 - box["width"]
        assert 0 <= box["y"] <= height + 0.5 - box["height"]
    assert not any(overlap(a, b) for a, b in combinations(found, 2))
    assert look.page.evaluate(BEYOND) == []


PARTS = ("header", "#canvas", "#legend", "#panel", "footer")
# What sticks out of the window to the right.
BEYOND = """[...document.querySelectorAll("header *, #panel *, footer *")]
    .filter((e) => e.offsetParent && e.getBoundingClientRect().right > innerWidth + 1)
    .map((e) => e.outerHTML)"""


def overlap(a: Any, b: Any) -> bool:
    """Whether two boxes share more than a line."""
    x, y = (
        min(a[at] + a[side], b[at] + b[side]) - max(a[at], b[at])
        for at, side in (("x", "width"), ("y", "height"))
    )
    return bool(x > 0.5 and y > 0.5)


def test_a_browser_without_webgl2_says_so(playwright: Playwright, package: str) -> None:
    flags = [flag for flag in FLAGS if "swiftshader" not in flag]
    flags += ["--disable-gpu", "--disable-3d-apis"]
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
    try:
        look = Look(browser.new_page(), package)
        look.until("document.getElementById('message-detail').textContent.includes('WebGL2')")
        assert "cannot show the skin" in look.page.inner_text("#message")
        look.keep("without_webgl2")
    finally:
        browser.close()


def test_a_packed_page_shows_the_same(
    look: Look, open_page: Opened, package: str, store: Path
) -> None:
    packed = shutil.copytree(store.parent / "package", store.parent / "packed")
    runpy.run_path(str(ROOT / "docs" / "viewer_page.py"))["pack"](packed)
    other = open_page(package.replace("/package/", "/packed/")).ready()

    assert {f.suffix for f in (packed / "textures").iterdir()} == {".gz"}
    assert differ(other.picture(), look.picture()) == 0
    assert other.said == []


def test_a_page_out_of_a_folder_says_how_to_serve_it(open_page: Opened, store: Path) -> None:
    look = open_page((store.parent / "package" / "index.html").as_uri())
    look.until("!document.getElementById('message').hidden")
    assert "python3 -m http.server" in look.page.inner_text("#message")


# The manifest of a package whose cushions are in sets, with the triangles of their samples, made of
# textures that this package has; and what is read of it.
BEFORE = """async () => {
  const { loadPackage } = await import('./viewer/view/package.js');
  const bytes = async (path) => (await fetch(path)).arrayBuffer();
  const found = await (await fetch('manifest.json')).json();
  const { textures, codes } = found.wrinkles, { factor, apron } = found.cushion;
  found.version = 1;
  found.cushion = { textures, codes, triangles: found.triangles, factor, apron };
  for (const shaders of Object.values(found.shaders)) delete shaders.passes.lines;
  const text = new TextEncoder().encode(JSON.stringify(found)).buffer;
  const skin = await loadPackage(async (path) => path === 'manifest.json' ? text : bytes(path));
  return Object.keys(skin.textures.get(1001).cushions).sort();
}"""


def test_cushions_of_packages_of_before_are_read(look: Look) -> None:
    assert look.page.evaluate(BEFORE) == [
        "rhytid_cushion_codes", "rhytid_cushion_triangles", "rhytid_cushions",
    ]  # fmt: skip
