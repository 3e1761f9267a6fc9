"""Warnings over HTTP: in answers, in a header, and as a problem where strict is asked for."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest

from api.asking import NPY, array_of, built, is_problem, npy
from api.live import serving
from api.patch import SIDE, obj, positions, smile, upload
from engine.engines import running
from meshes import deform
from reference.stretch import stretch
from rhytid.domain.warnings import CODES

# What the engine without a device doubts: it is larger than 50.
LARGE = {"code": "mesh-size", "detail": "täglich größer"}
WRONG = positions() * np.float32(100)


def test_an_asset_has_its_warnings(client: httpx.Client) -> None:
    made = client.post("/v1/assets", files=upload(obj(scale=100.0))).json()
    assert made["warnings"] == [{**LARGE, "where": "mesh"}]
    assert client.get(f"/v1/assets/{made['id']}").json()["warnings"] == made["warnings"]
    assert client.post("/v1/assets", files=upload()).json()["warnings"] == []


def test_frames_and_calibrations_have_theirs(client: httpx.Client, frame: str) -> None:
    put = client.put(frame, content=npy(WRONG), headers=NPY).json()
    assert put["warnings"] == [{**LARGE, "where": "frame smile"}]
    assert client.get(frame).json() == put
    path = f"{frame.partition('/frames')[0]}/calibration"
    assert client.put(path, content=npy(WRONG), headers=NPY).json()["warnings"]
    assert client.put(path, content=npy(smile()), headers=NPY).json()["warnings"] == []


def test_tiles_that_are_drawn_once_have_a_header(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/tiles?tile=1001/0/0/0"
    found = client.post(path, content=npy(WRONG), headers=NPY)
    assert found.status_code == 200
    header = found.headers["x-rhytid-warnings"]
    assert header.isascii()
    assert json.loads(header) == [{**LARGE, "where": "the positions"}]
    right = client.post(path, content=npy(smile()), headers=NPY)
    assert "x-rhytid-warnings" not in right.headers


@pytest.mark.parametrize("place", ["frames/strict", "calibration", "tiles?tile=1001/0/0/0"])
def test_strict_is_a_problem(client: httpx.Client, asset: str, place: str) -> None:
    path = f"/v1/assets/{asset}/{place}"
    path += ("&" if "?" in path else "?") + "strict=true"
    method = "POST" if "tiles" in place else "PUT"
    refused = client.request(method, path, content=npy(WRONG), headers=NPY)
    body = refused.json()
    assert (refused.status_code, body["type"]) == (422, "urn:rhytid:problem:warnings")
    assert refused.headers["content-type"] == "application/problem+json"
    assert [w["code"] for w in body["warnings"]] == ["mesh-size"]
    assert "mesh-size: the positions: täglich größer" in body["detail"]
    names = [f["name"] for f in client.get(f"/v1/assets/{asset}/frames").json()]
    assert "strict" not in names
    assert client.request(method, path, content=npy(smile()), headers=NPY).is_success
    client.delete(f"/v1/assets/{asset}/frames/strict")


def test_a_strict_asset_is_not_made(client: httpx.Client) -> None:
    refused = client.post("/v1/assets?strict=true", files=upload(obj(scale=90.0)))
    assert refused.status_code == 422
    assert refused.json()["warnings"] == [{**LARGE, "where": "mesh"}]
    assert client.post("/v1/assets?strict=true", files=upload()).is_success


@pytest.mark.parametrize("place", ["frames/allowed", "calibration", "tiles?tile=1001/0/0/0"])
def test_an_allowed_code_is_no_problem(client: httpx.Client, asset: str, place: str) -> None:
    path = f"/v1/assets/{asset}/{place}" + ("&" if "?" in place else "?")
    method = "POST" if "tiles" in place else "PUT"
    path += "strict=true&allow=uv-overlap"
    assert client.request(method, path, content=npy(WRONG), headers=NPY).status_code == 422
    found = client.request(method, f"{path}&allow=mesh-size", content=npy(WRONG), headers=NPY)
    assert found.is_success
    header = found.headers.get("x-rhytid-warnings")
    told = json.loads(header) if header else found.json()["warnings"]
    assert [w["code"] for w in told] == ["mesh-size"]
    client.delete(f"/v1/assets/{asset}/frames/allowed")


def test_an_asset_with_an_allowed_code_is_made(client: httpx.Client) -> None:
    large = upload(obj(scale=91.0))
    assert client.post("/v1/assets?strict=true", files=large).status_code == 422
    made = client.post("/v1/assets?strict=true&allow=mesh-size", files=large)
    assert made.is_success
    assert [w["code"] for w in made.json()["warnings"]] == ["mesh-size"]


@pytest.mark.parametrize("strict", ["strict=true&", ""])
@pytest.mark.parametrize("place", ["", "/frames/f", "/calibration", "/tiles?tile=1001/0/0/0"])
def test_an_unknown_code_is_answered_with_the_known(
    client: httpx.Client, asset: str, place: str, strict: str
) -> None:
    path = f"/v1/assets/{asset}{place}" if place else "/v1/assets"
    path += f"{'&' if '?' in path else '?'}{strict}allow=mesh-size&allow=mesh-sise"
    body: dict[str, Any] = {"content": npy(smile()), "headers": NPY}
    method = "PUT" if place in ("/frames/f", "/calibration") else "POST"
    refused = client.request(method, path, **(body if place else {"files": upload()}))
    detail = is_problem(refused, 422, "query")
    assert "'mesh-sise'" in detail
    assert all(code in detail for code in CODES)


@pytest.mark.parametrize("query", ["strict=perhaps", "strict=true&strict=true", "strickt=true"])
def test_strict_is_understood_or_refused(client: httpx.Client, query: str) -> None:
    refused = client.post(f"/v1/assets?{query}", files=upload())
    assert refused.status_code == 422
    assert refused.json()["detail"].count("stric") >= 1


def test_where_strict_means_nothing_it_is_refused(client: httpx.Client, asset: str) -> None:
    assert "strict" in is_problem(client.get("/v1/assets?strict=true"), 422, "query")
    path = f"/v1/assets/{asset}/frames?strict=true"
    assert "none is known" in is_problem(client.get(path), 422, "query")


def test_openapi_has_the_codes_and_the_switch(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    schemas = document["components"]["schemas"]
    assert schemas["InputWarning"]["properties"]["code"]["enum"] == list(CODES)
    for path, method in (
        ("/v1/assets", "post"),
        ("/v1/assets/{asset}/frames/{frame}", "put"),
        ("/v1/assets/{asset}/calibration", "put"),
        ("/v1/assets/{asset}/tiles", "post"),
    ):
        known = {p["name"]: p for p in document["paths"][path][method]["parameters"]}
        assert {"strict", "allow"} <= set(known)
        assert known["allow"]["schema"]["items"]["enum"] == list(CODES)
    references = set(re.findall(r'"#/components/schemas/(\w+)"', json.dumps(document)))
    assert references <= set(schemas)


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    with running(tmp_path_factory.mktemp("far")) as engine, serving(engine) as client:
        yield client


@pytest.mark.slow
def test_doubles_a_million_units_away_are_as_good_as_at_the_origin(real: httpx.Client) -> None:
    where = np.array([1e6, -2e6, 5e5])
    neutral = positions().astype(np.float64) + 1e-9 + where
    moved = deform(positions(), 3).astype(np.float64) + 1e-9 + where
    text = obj().decode().splitlines()
    text[: SIDE * SIDE] = [f"v {x:.12f} {y:.12f} {z:.12f}" for x, y, z in neutral]
    asset = built(real, upload("\n".join([*text, ""]).encode(), unit="ft"))
    frame = f"/v1/assets/{asset}/frames/far"

    sent = real.put(f"{frame}?strict=true", content=npy(moved), headers=NPY)
    assert sent.json()["warnings"] == []
    with np.load(__import__("io").BytesIO(real.get(f"{frame}/stretch").content)) as found:
        ratios = found["ratios"]
    faces = np.array([[c, c + 1, c + SIDE + 1, c, c + SIDE + 1, c + SIDE] for c in _corners()])
    faces = faces.reshape(-1, 3)
    uv = 0.1 + 0.8 * positions()[:, :2]
    wanted, _ = stretch(positions(), faces, uv, faces, moved - where)
    np.testing.assert_allclose(ratios, wanted, atol=1e-5)
    np.testing.assert_allclose(array_of(real.get(frame, headers={"Accept": NPY["Content-Type"]})),
                               moved, atol=1e-6, rtol=0)  # fmt: skip

    rounded = real.put(frame, content=npy(moved.astype(np.float32)), headers=NPY).json()
    assert "far-from-origin" in [w["code"] for w in rounded["warnings"]]

    lines = real.get(f"/v1/assets/{asset}/graph?format=obj").text.splitlines()
    points = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    assert np.abs(points - where - [0.5, 0.5, 0]).max() < 0.6


def _corners() -> list[int]:
    return [SIDE * j + i for j in range(SIDE - 1) for i in range(SIDE - 1)]
