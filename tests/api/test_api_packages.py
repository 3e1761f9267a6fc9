"""Skin packages over HTTP: zips, files, ranges, and what is said while one is made."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile

import httpx
import pytest

from api.asking import built, is_problem
from api.fake_engine import FakeEngine
from api.fake_packages import FILES
from api.live import serving
from api.patch import upload
from rhytid.api.package_files import OpenPackage, opened, part
from rhytid.engine.messages import Package
from rhytid.errors import BusyError
from rhytid_client import Client

TEXTURE = "textures/maps.1001.ktx2"


@pytest.fixture
def path(asset: str) -> str:
    return f"/v1/assets/{asset}/package"


def test_the_zip_has_every_file_as_it_is(client: httpx.Client, asset: str, path: str) -> None:
    answer = client.get(path)
    with ZipFile(io.BytesIO(answer.content)) as came:
        assert came.testzip() is None
        assert {one.filename: came.read(one) for one in came.infolist()} == FILES
        assert {one.compress_type for one in came.infolist()} == {ZIP_STORED}
    assert answer.headers["content-type"] == "application/zip"
    assert answer.headers["content-length"] == str(len(answer.content))
    assert f'filename="{asset}.skin.zip"' in answer.headers["content-disposition"]
    assert client.get(path).content == answer.content
    tag = {"If-None-Match": answer.headers["etag"]}
    assert client.get(path, headers=tag).status_code == 304


def test_files_have_their_types_and_tags(client: httpx.Client, path: str) -> None:
    kinds = {"manifest.json": "application/json", TEXTURE: "image/ktx2"}
    tags = set()
    for name, kind in kinds.items():
        answer = client.get(f"{path}/{name}")
        assert (answer.status_code, answer.content) == (200, FILES[name])
        assert answer.headers["content-type"] == kind
        assert answer.headers["content-length"] == str(len(FILES[name]))
        tags.add(answer.headers["etag"])
        tag = {"If-None-Match": answer.headers["etag"]}
        assert client.get(f"{path}/{name}", headers=tag).status_code == 304
    assert len(tags) == 2


@pytest.mark.parametrize(
    ("asked", "start", "end"),
    [("bytes=0-9", 0, 10), ("bytes=511990-", 511990, 512000), ("bytes=-7", 511993, 512000)],
)
def test_a_range_is_given(
    client: httpx.Client, path: str, asked: str, start: int, end: int
) -> None:
    answer = client.get(f"{path}/{TEXTURE}", headers={"Range": asked})
    assert (answer.status_code, answer.content) == (206, FILES[TEXTURE][start:end])
    assert answer.headers["content-range"] == f"bytes {start}-{end - 1}/512000"


def test_ranges_that_are_none(client: httpx.Client, path: str) -> None:
    for asked in ("bytes=3-2", "bytes=0-1,4-5", "lines=1-2", "bytes=-"):
        whole = client.get(f"{path}/{TEXTURE}", headers={"Range": asked})
        assert (whole.status_code, len(whole.content)) == (200, 512000)
    beyond = client.get(f"{path}/{TEXTURE}", headers={"Range": "bytes=512000-"})
    assert "has 512000 bytes: bytes=512000- names none" in is_problem(beyond, 416)
    assert beyond.headers["content-range"] == "bytes */512000"
    other = {"Range": "bytes=0-9", "If-Range": '"another"'}
    assert client.get(f"{path}/{TEXTURE}", headers=other).status_code == 200
    assert part("bytes=2-5", 4) == (2, 4)
    assert part("bytes=-9", 4) == (0, 4)


def test_what_is_not_there(client: httpx.Client, path: str) -> None:
    for name in ("nothing", "textures", "../manifest.json", "%2e%2e/manifest.json", "/etc/passwd"):
        answer = client.get(
            httpx.URL(str(client.base_url)).copy_with(raw_path=f"{path}/{name}".encode())
        )
        assert answer.status_code == 404, name
    is_problem(client.get("/v1/assets/0123456789abcdef/package"), 404, "not-found")
    for query in ("levels=0", "levels=17", "level=1"):
        is_problem(client.get(f"{path}?{query}"), 422)


def test_while_it_is_made_the_job_is_told(tmp_path: Path) -> None:
    engine: Any = FakeEngine(polls=3)
    with serving(engine) as client:
        asset = built(client, upload())
        path = f"/v1/assets/{asset}/package"
        answer = client.get(f"{path}/manifest.json")
        job = answer.json()
        assert (answer.status_code, job["kind"], job["asset"]) == (202, "package", asset)
        assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
        assert answer.headers["retry-after"] == "1"
        with Client(str(client.base_url)) as rhytid:
            assert rhytid.package(asset, tmp_path / "skin") == tmp_path / "skin"
            rhytid.package(asset, tmp_path / "skin.zip")
    for name, data in FILES.items():
        assert (tmp_path / "skin" / name).read_bytes() == data
    assert len(ZipFile(tmp_path / "skin.zip").infolist()) == len(FILES)
    assert {one.name for one in tmp_path.iterdir()} == {"skin", "skin.zip"}


def test_a_package_that_is_removed_meanwhile_is_asked_for_again(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12")
    found = [Package("one", tmp_path / "gone", {"a": 2}), Package("two", tmp_path, {"a": 2})]
    came = opened(lambda: found.pop(0))
    assert isinstance(came, OpenPackage)
    assert came.key == "two"
    (tmp_path / "a").unlink()
    assert b"".join(came.pieces("a", 0, 2)) == b"12"
    came.close()
    with pytest.raises(BusyError):
        opened(lambda: Package("one", tmp_path / "gone", {"a": 2}))
