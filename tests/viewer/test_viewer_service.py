"""The page of a running service: packages, exact tiles, restarts."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from api.fake_engine import FakeEngine
from api.live import serving
from rhytid.api.keys import new_key, write_keys
from rhytid_lab.samples.face import procedural_face
from viewer.looking import Look, differ
from viewer.serving import Served

pytestmark = pytest.mark.browser
Opened = Callable[..., Look]
EXACT = "document.getElementById('status').textContent.includes('exact: all')"


@pytest.fixture
def http(served: Served) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=served.url, timeout=60) as client:
        yield client


def the_map(http: httpx.Client, page: Look, method: str, level: int = 0) -> NDArray[np.float32]:
    """Of the service, for the pose that the page shows."""
    positions = np.array(page.page.evaluate("[...rhytid.face.view.positions()]"), np.float32)
    body = io.BytesIO()
    np.save(body, positions.reshape(-1, 3))
    frame = f"/v1/assets/{page.state()['asset']}/frames/compared"
    headers = {"Content-Type": "application/x-npy"}
    http.put(frame, content=body.getvalue(), headers=headers).raise_for_status()
    query = {"method": method, "level": level, "format": "npy"}
    answer = http.get(frame.replace("/compared", "/compared/maps/1001"), params=query)
    found: NDArray[np.float32] = np.load(io.BytesIO(answer.raise_for_status().content))
    return found


def test_it_loads_quietly_and_from_here_alone(open_page: Opened, served: Served) -> None:
    page = open_page(served.url).ready()

    assert page.said == []
    assert {urlsplit(url).netloc for url in page.asked} == {urlsplit(served.url).netloc}
    assert page.page.locator("#asset").is_visible()


def test_fast_skin_is_that_of_the_service(
    open_page: Opened, served: Served, http: httpx.Client
) -> None:
    page = open_page(f"{served.url}#weights=smile:0.8,brow_furrow:0.5").ready()
    box = page.page.locator("#canvas").bounding_box()
    assert box is not None
    places = [[x * box["width"] / 40, y * box["height"] / 40] for x in range(40) for y in range(40)]
    probes = page.page.evaluate(
        "(all) => all.map(([x, y]) => rhytid.face.view.probe(x, y)).filter(Boolean)", places
    )
    code = page.page.evaluate("rhytid.face.skin.manifest.layers[0].steps[0]")
    wanted = the_map(http, page, "binned")

    assert len(probes) > 200
    off = [abs(p["displacement"] - wanted[p["texel"][1], p["texel"][0]]) for p in probes]
    assert np.ptp(wanted) > 50 * code
    assert max(off) <= code


def test_exact_skin_is_that_of_the_service(
    open_page: Opened, served: Served, http: httpx.Client
) -> None:
    page = open_page(f"{served.url}#weights=smile:0.8&relief=3").ready()
    fast = page.picture()
    page.page.keyboard.press("3")
    page.until(EXACT)
    tiles: list[dict[str, Any]] = page.page.evaluate(
        "[...rhytid.served.exact.tiles.values()].map(({ tile, size, heights }) => "
        "({ ...tile, size, heights: [...heights] }))"
    )
    wanted = the_map(http, page, "redraw", tiles[0]["level"])

    assert tiles
    for tile in tiles:
        size = tile["size"]
        rows, columns = (slice(tile[k] * size, (tile[k] + 1) * size) for k in ("row", "column"))
        found = np.array(tile["heights"], np.float32).reshape(size, size)
        assert np.array_equal(found, wanted[rows, columns])
    exact = page.picture()
    page.page.evaluate(
        "for (const { tile, size } of rhytid.served.exact.tiles.values())"
        " rhytid.face.view.setExactTile(tile, size, new Float32Array(size * size));"
        "rhytid.face.redraw()"
    )
    flat = page.picture()
    assert differ(flat, exact) > 0.05  # tiles are what is drawn
    assert differ(exact, fast) < 0.01
    assert page.said == []


def test_tiles_of_an_outdated_pose_are_not_shown(
    open_page: Opened, served: Served, http: httpx.Client
) -> None:
    page = open_page(f"{served.url}#method=exact").ready()
    page.until(EXACT)
    old = page.page.evaluate("rhytid.served.exact.frame")
    slider = page.page.get_by_label("smile", exact=True)
    for value in ("0.3", "0.6", "0.9"):
        slider.fill(value)
    assert page.page.evaluate("rhytid.served.exact.tiles.size") == 0
    page.until(EXACT + " && rhytid.served.exact.tiles.size > 0")

    frame = page.page.evaluate("rhytid.served.exact.frame")
    assert http.get(frame).status_code == 200
    assert frame != old
    assert http.get(old).status_code == 404
    page.page.goto("about:blank")
    deadline = time.monotonic() + 10
    while http.get(frame).status_code == 200 and time.monotonic() < deadline:
        time.sleep(0.05)
    assert http.get(frame).status_code == 404


def test_a_frame_that_the_service_forgot_is_sent_again(
    open_page: Opened, served: Served, http: httpx.Client
) -> None:
    page = open_page(f"{served.url}#weights=smile:1").ready()
    page.page.focus("#canvas")
    for _ in range(20):
        page.page.keyboard.press("+")
    page.page.keyboard.press("3")
    page.until(EXACT)
    frame = page.page.evaluate("rhytid.served.exact.frame")
    close = page.page.evaluate("rhytid.served.exact.tiles.size")
    http.delete(frame).raise_for_status()
    page.page.keyboard.press("r")
    page.until(f"rhytid.served.exact.tiles.size > {close}")
    page.until(EXACT)

    assert http.get(frame).status_code == 200


def test_a_restart_of_the_service_is_survived(open_page: Opened, served: Served) -> None:
    page = open_page(f"{served.url}#weights=smile:1&method=exact&split=0.3").ready()
    page.until(EXACT)
    before = page.state()
    banner = "document.getElementById('banner')"

    served.stop()
    page.until(f"{banner}.textContent.includes('does not answer')")
    page.keep("without_service")
    page.page.get_by_label("jaw_open", exact=True).fill("0.5")
    assert page.picture().std() > 0.05
    served.start()

    page.until(f"{banner}.textContent.includes('is back')")
    page.until(EXACT)
    after = page.state()
    assert after.pop("weights") == {**before.pop("weights"), "jaw_open": 0.5}
    assert after == before


def test_a_mesh_is_sent_and_shown(open_page: Opened, served: Served, tmp_path: Path) -> None:
    sample = procedural_face(16)
    mesh = {name: getattr(sample.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    shapes = np.stack([sample.pose({name: 1.0}) for name in ("smile", "frown")])
    np.savez(tmp_path / "small.npz", **mesh, shapes=shapes, names=np.array(["smile", "frown"]))
    page = open_page(served.url).ready()
    before = page.state()["asset"]

    page.page.set_input_files("#upload-file", tmp_path / "small.npz")
    page.page.select_option("#files-resolution", "1024")
    page.page.click("#files-use")
    page.until("!document.getElementById('job').hidden")
    page.until(f"rhytid.store.state.asset !== '{before}' && rhytid.face.shapes.length === 2", 120)

    assert page.page.evaluate("rhytid.face.skin.manifest.stretch.triangles") == 512
    assert not page.page.locator("#job").is_visible()
    listed = page.page.locator("#asset option").all_inner_texts()
    assert [text for text in listed if text.startswith("small · 1024², 512 triangles")]


def test_a_file_that_is_refused_is_named_and_the_dialog_stays(
    open_page: Opened, served: Served, tmp_path: Path
) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    sample = procedural_face(16)
    mesh = {name: getattr(sample.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    np.savez(tmp_path / "good.npz", **mesh)
    np.savez(tmp_path / "other.npz", shapes=np.zeros((1, 7, 3), np.float32))
    np.savez(tmp_path / "both.npz", **mesh, weights=np.zeros((4, 99), np.float32))
    page = open_page(served.url).ready()
    wrong = "document.getElementById('files-wrong').textContent"
    for files, told in (
        (["flat.obj"], ["flat.obj", "texture coordinate"]),
        (["good.npz", "other.npz"], ["other.npz", "(1, 7, 3)"]),
        (["both.npz"], ["both.npz", "99 weights"]),
    ):
        page.page.set_input_files("#upload-file", [tmp_path / name for name in files])
        page.until("document.getElementById('files-dialog').open")
        if files == ["both.npz"]:
            page.page.get_by_label("both.npz").select_option("weights")
        page.page.click("#files-use")
        page.until(f"{wrong} !== ''")
        text = page.page.evaluate(wrong)
        assert [part for part in told if part not in text] == []
        assert page.page.locator("#files-list").inner_text().count(".") == len(files)
        assert page.page.locator("#files-use").is_enabled()
        page.keep(f"refused_{files[0]}")
    page.page.click("#files-cancel")
    assert not page.page.locator("#files-dialog").is_visible()
    assert page.page.evaluate("document.getElementById('banner').hidden")


def test_assets_of_one_name_are_told_apart(
    open_page: Opened, served: Served, http: httpx.Client
) -> None:
    page = open_page(served.url).ready()
    one = http.get("/v1/assets").json()[0]
    many = [
        {**one, "id": id, "settings": {**one["settings"], "name": name}}
        for id, name in (("1" * 16, "Ada"), ("2" * 16, "Ada"), ("3" * 16, "Eve"), ("4" * 16, None))
    ]
    page.page.route("**/v1/assets", lambda route: route.fulfill(json=many))
    page.page.evaluate("rhytid.served.refresh()")
    listed = page.page.locator("#asset option").all_inner_texts()
    names = [text.partition(" · ")[0] for text in listed]
    assert names == ["Ada 11111111", "Ada 22222222", "Eve", "44444444"]


def test_a_key_is_asked_for_and_kept_for_the_tab(open_page: Opened, tmp_path: Path) -> None:
    shown, key = new_key("artist", {"read", "compute"})
    write_keys(tmp_path / "keys.json", [key])
    with serving(FakeEngine(), keys=tmp_path / "keys.json") as client:
        page = open_page(f"{client.base_url}/")
        page.until("document.getElementById('key-dialog').open")
        page.page.fill("#key", "ключ")
        page.page.click("#key-use")
        page.until("document.getElementById('key-wrong').textContent.includes('ASCII')")
        page.page.fill("#key", "rhytid_wrong")
        page.page.click("#key-use")
        page.until("document.getElementById('key-wrong').textContent.includes('does not know')")
        page.page.fill("#key", shown)
        page.page.click("#key-use")
        page.until("document.getElementById('message-text').textContent === 'No asset yet.'")
        page.page.reload()
        page.until("document.getElementById('message-text').textContent === 'No asset yet.'")
        assert not page.page.locator("#key-dialog").is_visible()
        assert shown not in page.page.url
