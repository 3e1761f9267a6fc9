"""The files of the viewer, as a browser asks for them."""

from __future__ import annotations

import re

import httpx
import pytest

import rhytid_viewer
from api.asking import is_problem

PAGE = {"Accept": "text/html"}


def test_the_page_loads_what_there_is(client: httpx.Client) -> None:
    page = client.get("/", headers=PAGE)
    loaded = re.findall(r'(?:src|href)="([^"]+)"', page.text)

    assert set(loaded) >= {"viewer/main.js", "viewer/style.css"}
    assert [place for place in loaded if client.get(f"/{place}").status_code != 200] == []


@pytest.mark.parametrize("name", rhytid_viewer.names())
def test_a_file_has_its_type_and_loads_nothing_from_elsewhere(
    client: httpx.Client, name: str
) -> None:
    answer = client.get(f"/viewer/{name}")

    assert answer.content == rhytid_viewer.read(name)
    assert answer.headers["content-type"] == rhytid_viewer.media_type(name)
    assert answer.headers["content-security-policy"].startswith("default-src 'self';")
    assert answer.headers["x-content-type-options"] == "nosniff"
    texts = re.sub(r"http://www.w3.org/2000/svg|http://127.0.0.1:8000/", "", answer.text)
    assert re.findall(r"https?://[^\s\"']+", texts) == []


def test_modules_import_files_that_there_are() -> None:
    wrong = [
        (name, target)
        for name in rhytid_viewer.names()
        if name.endswith(".js")
        for target in re.findall(r"from ['\"](\.[^'\"]+)['\"]", rhytid_viewer.read(name).decode())
        if not _there(name, target)
    ]
    assert wrong == []


def _there(name: str, target: str) -> bool:
    folder = name.split("/")[:-1]
    for part in target.split("/"):
        if part == "..":
            folder.pop()
        elif part != ".":
            folder.append(part)
    return "/".join(folder) in rhytid_viewer.names()


def test_a_browser_that_has_the_bytes_gets_none(client: httpx.Client) -> None:
    for path, headers in (("/viewer/main.js", {}), ("/", PAGE)):
        first = client.get(path, headers=headers)
        again = client.get(path, headers={**headers, "If-None-Match": first.headers["etag"]})

        assert (again.status_code, again.content) == (304, b"")
        assert first.headers["cache-control"] == "no-cache"


@pytest.mark.parametrize("path", ["nothing.js", "../pyproject.toml", "__init__.py", "index.html"])
def test_nothing_else_is_handed_out(client: httpx.Client, path: str) -> None:
    is_problem(client.get(f"/viewer/{path.replace('..', '%2e%2e')}"), 404)
