"""Skin packages over HTTP: zips, files, ranges, and what is said while one is made."""

from __future__ import annotations

import errno
import io
import os
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile

import httpx
import pytest

from api.asking import built, is_problem
from api.fake_engine import FakeEngine
from api.fake_packages import FILES, archive
from api.live import serving
from api.patch import obj, upload
from processes.served import await_value
from rhytid.api.access import Caller
from rhytid.api.admission import JobShares
from rhytid.api.routes.packages import KEY, OpenPackage, byte_range, opened
from rhytid.api.routes.pages import SAFE
from rhytid.engine.messages import JobInfo, Package
from rhytid.errors import BusyError, QuotaError
from rhytid.storage.packages import read_archive
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
    is_problem(beyond, 416)
    assert beyond.headers["content-range"] == "bytes */512000"
    other = {"Range": "bytes=0-9", "If-Range": '"another"'}
    assert client.get(f"{path}/{TEXTURE}", headers=other).status_code == 200
    assert byte_range("bytes=2-5", 4) == (2, 4)
    assert byte_range("bytes=-9", 4) == (0, 4)


def test_what_is_not_there(client: httpx.Client, path: str) -> None:
    await_value(lambda: client.get(path).status_code == 200)  # before, nobody knows what is there
    for name in ("nothing", "textures", "../manifest.json", "%2e%2e/manifest.json", "/etc/passwd"):
        answer = client.get(
            httpx.URL(str(client.base_url)).copy_with(raw_path=f"{path}/{name}".encode())
        )
        assert answer.status_code == 404, name
    is_problem(client.get("/v1/assets/0123456789abcdef/package"), 404, "not-found")
    for query in ("levels=0", "levels=17", "level=1"):
        is_problem(client.get(f"{path}?{query}"), 422, "query")


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
        again = client.get(f"/v1/assets/{asset}/package", params={"levels": 2})
        assert (again.status_code, again.headers.get("content-disposition")) == (202, None)
    for name, data in FILES.items():
        assert (tmp_path / "skin" / name).read_bytes() == data
    assert len(ZipFile(tmp_path / "skin.zip").infolist()) == len(FILES)
    assert {one.name for one in tmp_path.iterdir()} == {"skin", "skin.zip"}


def test_a_package_that_is_removed_meanwhile_is_asked_for_again(tmp_path: Path) -> None:
    file, gone = tmp_path / "two.zip", tmp_path / "gone.zip"
    archive({"a": b"12"}, file)
    with file.open("rb") as read:
        parts = read_archive(read, file)
    found = [Package("one", gone, 2, {}), Package("two", file, file.stat().st_size, parts)]
    came = opened(lambda: found.pop(0))
    assert isinstance(came, OpenPackage)
    assert came.key == "two"
    file.unlink()
    assert b"".join(came.pieces(came.place("a"))) == b"12"
    came.close()
    with pytest.raises(BusyError):
        opened(lambda: Package("one", gone, 2, {}))


def test_an_answer_that_nobody_reads_holds_one_file(client: httpx.Client, path: str) -> None:
    """Beside its connection, whether it is a zip or a file."""
    client.get(path)
    for asked in (path, f"{path}/{TEXTURE}"):
        with ExitStack() as unread:
            before = len(list(Path("/proc/self/fd").iterdir()))
            for _ in range(8):
                unread.enter_context(client.stream("GET", asked))
            # Both ends of the connections are in this process.
            assert len(list(Path("/proc/self/fd").iterdir())) - before <= 8 * 3, asked


def test_no_file_left_to_open_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), str(tmp_path))

    engine: Any = FakeEngine()
    with serving(engine) as client:
        path = f"/v1/assets/{built(client, upload())}/package"
        client.get(path)
        package = engine.packages.of(path.split("/")[3])
        monkeypatch.setattr(engine.packages, "of", lambda *_, **__: package)
        monkeypatch.setattr(Path, "open", full)
        answer = client.get(f"{path}/manifest.json")
        monkeypatch.undo()
    is_problem(answer, 503, "open-files")
    assert answer.headers["retry-after"] == "5"
    assert str(tmp_path) not in answer.text


def test_files_of_two_packages_are_not_mixed() -> None:
    engine: Any = FakeEngine()
    with serving(engine) as client:
        path = f"/v1/assets/{built(client, upload())}/package"
        first = client.get(f"{path}/manifest.json")
        asked = {"key": first.headers[KEY]}
        assert client.get(f"{path}/{TEXTURE}", params=asked).status_code == 200
        assert client.get(path, params=asked).headers[KEY] == asked["key"]
        engine.packages.version = 2
        is_problem(client.get(f"{path}/{TEXTURE}", params=asked), 409, "changed")
        is_problem(client.get(path, params=asked), 409, "changed")
        again = client.get(f"{path}/manifest.json")
        assert again.headers[KEY] != asked["key"]
        assert again.headers["etag"] != first.headers["etag"]
        is_problem(client.get(path, params={"key": ""}), 422, "query")


def test_nothing_in_a_package_runs_beside_the_keys_of_the_page(
    client: httpx.Client, path: str
) -> None:
    texture = f"{path}/{TEXTURE}"
    tag = {"If-None-Match": client.get(texture).headers["etag"]}
    answers = [client.get(path), client.get(f"{path}/index.html"), client.get(texture, headers=tag)]
    answers += [
        client.get(texture, headers={"Range": asked}) for asked in ("bytes=0-1", "bytes=-0")
    ]
    assert [answer.status_code for answer in answers] == [200, 200, 304, 206, 416]
    for answer in answers:
        assert {name: answer.headers.get(name) for name in SAFE} == SAFE


def test_a_package_that_is_made_takes_a_place_among_the_jobs_of_its_caller() -> None:
    engine: Any = FakeEngine(polls=3)
    with serving(engine, key_jobs=1) as client:
        one, two = (built(client, upload(obj(seed))) for seed in (1, 2))
        made = client.get(f"/v1/assets/{one}/package")
        assert made.status_code == 202
        is_problem(client.get(f"/v1/assets/{two}/package"), 429, "quota")
        # Who asks how far it is needs no other place.
        assert client.get(f"/v1/assets/{one}/package/manifest.json").status_code == 202
        while client.get(made.headers["location"]).json()["state"] != "done":
            pass
        assert client.get(f"/v1/assets/{two}/package").status_code == 202
        assert client.get(f"/v1/assets/{one}/package").status_code == 200


def test_requests_of_the_same_job_are_one_place() -> None:
    """Files of a package that is not there yet are asked for at once."""
    running = JobInfo("job", "asset", "package", "running", 0.0, "", "")
    shares, caller = JobShares(lambda _: running), Caller("one", rate=1, jobs=2)
    with shares.one(caller) as first, shares.one(caller) as second:
        first.take("job")
        second.take("job")
    with shares.one(caller) as other:
        other.take("another")
    with pytest.raises(QuotaError), shares.one(caller):
        pass
