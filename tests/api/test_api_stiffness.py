"""A painted map sent over HTTP: what is black stays as it is while the face smiles."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from api.live import serving
from api.patch import SETTINGS, obj, smile, upload
from engine.engines import running
from exr_images import exr, raw_header, window
from rhytid.api.documentation import ASSET_FORM
from rhytid.domain.methods import METHODS, SAMPLINGS
from rhytid.domain.painted_maps import MOST_TEXELS
from rhytid.formats.limits import MOST_SIDE
from rhytid_client import Client

R, EDGE = 256, 20  # texels; what a wrinkle reaches beyond its middle
SMALL = {**SETTINGS, "unit": "ft", "graph": {"wrinkles": 2000}}


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running(tmp_path_factory.mktemp("api")) as engine, serving(engine) as client:
        yield str(client.base_url)


def png(texels: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(texels).save(stream, "PNG")
    return stream.getvalue()


def left_is_rigid(dtype: Any) -> bytes:
    """Black left of the middle, white right of it."""
    painted = np.zeros((32, 64), dtype)
    painted[:, 32:] = np.iinfo(dtype).max
    return png(painted)


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("method", [method for method in METHODS if method != "neutral"])
def test_what_is_black_stays_neutral(url: str, method: str, sampling: str) -> None:
    with closing(Client(url)) as client:
        asset = client.wait(
            client.create_asset(
                obj(), name="a.obj", settings=SMALL, stiffness=left_is_rigid(np.uint16)
            )
        )
        client.put_frame(asset, "smile", smile(0.25))
        query = {"method": method, "sampling": sampling}
        depth = client.asset(asset).settings["depth"]
        still, found = (
            client.map(asset, frame, 1001, **query).array for frame in ("neutral", "smile")
        )
        rigid = np.abs(found - still)[:, : R // 2 - EDGE]
        assert np.abs(still[:, : R // 2 - EDGE]).max() > 0.3 * depth
        assert rigid.max() <= 1e-5 * depth
        assert np.abs(found - still)[:, R // 2 + EDGE :].max() > 0.05 * depth


@pytest.mark.parametrize("method", METHODS)
def test_white_everywhere_is_no_map_bit_for_bit(url: str, method: str) -> None:
    white = {1001: png(np.full((5, 5), 255, np.uint8))}
    answers = []
    with closing(Client(url)) as client:
        for stiffness in (white, None):
            asset = client.create_asset(obj(), name="a.obj", settings=SMALL, stiffness=stiffness)
            client.wait(asset)
            client.put_frame(asset, "smile", smile(0.25))
            answers.append((asset.id, client.map(asset, "smile", 1001, method=method).array))
    (one, found), (other, wanted) = answers
    assert one != other
    np.testing.assert_array_equal(found, wanted)


def test_png_and_exr_and_paths_are_one_asset(url: str, tmp_path: Path) -> None:
    path, other = tmp_path / "skin.1001.png", tmp_path / "skin.1001.exr"
    path.write_bytes(left_is_rigid(np.uint8))
    shares = np.repeat(np.float16([[0.0, 1.0]]), 32, 0).repeat(32, 1)
    other.write_bytes(exr(shares, "R"))
    images = [left_is_rigid(np.uint16), {1001: left_is_rigid(np.uint8)}, path, [path]]
    sent = [*images, exr(shares.astype(np.float32)), {1001: exr(shares)}, other]
    with closing(Client(url)) as client:
        ids = {
            client.create_asset(obj(), name="a.obj", settings=SMALL, stiffness=image).id
            for image in sent
        }
    assert len(ids) == 1


def test_the_part_repeats_by_udim(url: str) -> None:
    wide = obj().replace(b"vt 0.9", b"vt 1.9")
    files = [
        ("mesh", ("a.obj", wide)),
        ("settings", upload()["settings"]),
        ("stiffness", ("a.1001.png", png(np.full((2, 2), 255, np.uint8)))),
        ("stiffness", ("a.1002.png", png(np.full((2, 2), 0, np.uint8)))),
    ]
    made = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
    assert made.status_code == 202, made.text
    assert made.json()["udims"] == [1001, 1002]
    lone = httpx.post(
        f"{url}/v1/assets", files=[*files[:2], ("stiffness", ("a.png", b""))], timeout=60
    )
    assert lone.status_code == 422
    assert "a.png names no UDIM; the mesh has 1001, 1002" in lone.json()["detail"]


def test_too_large_an_image_is_413(url: str) -> None:
    head = png(np.zeros((1, 1), np.uint8)).replace(b"IHDR\0\0\0\1\0\0\0\1", b"IHDR\0\1\0\0\0\1\0\0")
    files = {**upload(), "stiffness": ("a.png", head)}
    refused = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
    assert refused.status_code == 413
    assert "65536 x 65536 texels: at most 8192 a side" in refused.json()["detail"]


def test_an_exr_that_is_none_is_told_with_its_place(url: str) -> None:
    bad = np.full((4, 6), np.nan, np.float32)
    huge = window(65535, 65535)
    head = raw_header(dataWindow=huge, displayWindow=huge)
    told = {
        exr(bad): (422, "a.exr: the texel of column 0, row 0 is nan: must be from 0 to 1"),
        head: (413, "a.exr has 65536 x 65536 texels: at most 8192 a side"),
        exr(bad)[:-1]: (422, "a.exr: a damaged EXR image"),
    }
    for data, (status, detail) in told.items():
        files = {**upload(), "stiffness": ("a.exr", data)}
        refused = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
        assert refused.status_code == status
        assert detail in refused.json()["detail"]
    assert httpx.get(f"{url}/healthz").status_code == 200


def test_too_many_images_are_413(url: str) -> None:
    images = [("stiffness", (f"a.{udim}.png", b"x")) for udim in range(1001, 1001 + 513)]
    sent = [("mesh", ("a.obj", obj())), *images]
    refused = httpx.post(f"{url}/v1/assets", files=sent, timeout=60)
    assert refused.status_code == 413
    assert "part stiffness was sent 513 times: at most 512" in refused.json()["detail"]


def test_the_limits_are_told_where_maps_are() -> None:
    page = Path(__file__).parents[2] / "docs" / "artists.md"
    for text in (str(ASSET_FORM), str(Client.create_asset.__doc__), page.read_text("utf-8")):
        assert f"{MOST_SIDE} texels per side" in text
        assert f"{MOST_TEXELS:,}" in text
