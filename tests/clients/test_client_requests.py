"""Each call sends one exact request, the same from both clients, and reads its answer."""

from __future__ import annotations

import inspect
import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from clients.shells import Script, Shell
from rhytid.cli.serve import PORT
from rhytid.domain.methods import METHODS
from rhytid_client import Asset, AsyncClient, Bins, Client, Device, Frame, Job, PlainClient, calls
from rhytid_client.live.opening import live

ASSET = {"id": "a" * 16, "state": "ready", "job": None, "udims": [1001, 1002], "future": {"x": 1}}
JOB = {"id": "j", "state": "running", "progress": 0.5, "asset": "a" * 16, "kind": "build"}
FRAME = {"name": "smile", "log_stretch": {"p50": 0.1}}
BINS = {
    "angles": [0.0, 1.5],
    "samples": [-0.2, 0.0, 0.2],
    "steps": {"wrinkles": [1e-4, 1e-4, 1e-4]},
    "bits": 8,
    "merge": "min",
    "depth_factored": False,
    "layers": {"wrinkles": 2, "pores": 1},
}
POSITIONS = np.arange(12, dtype=np.float64).reshape(4, 3) / 7
RAW = POSITIONS.astype("<f4")
HEIGHT = np.arange(16, dtype=np.float32).reshape(4, 4)
CODES = np.full((4, 4), -7, np.int8)
MIXED = (
    b"--b\r\nX-Rhytid-Tile: 1001/0/0/0\r\nContent-Length: 2\r\n\r\n\x00\x3c\r\n"
    b"--b\r\nX-Rhytid-Tile: 1001/0/0/1\r\n\r\n\x00\x40\r\n--b--\r\n"
)


def npy(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def npz(**arrays: Any) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def same(array: Any, wanted: Any) -> bool:
    return array.dtype == wanted.dtype and np.array_equal(array, wanted)


@dataclass(frozen=True)
class Case:
    """A call, the request it must make, and an answer with what it must be read as."""

    name: str
    args: tuple[Any, ...]
    sends: str
    answer: Any
    reads: Callable[[Any], bool]
    options: Mapping[str, Any] = field(default_factory=dict)
    body: bytes = b""
    headers: Mapping[str, str] = field(default_factory=dict)


TILE = ("a", "smile", 1001, 0, 2, 3)
TILE_PATH = "/v1/assets/a/frames/smile/tiles/1001/0/2/3?"
QUERY = "method=redraw&stretch=tensor&sampling=nearest&format="
OTHER = {"method": "binned", "stretch": "uv", "sampling": "smooth", "format": "png"}
OTHER_QUERY = "method=binned&stretch=uv&sampling=smooth&format=png"
TWO = [(1001, 0, 0, 0), (1001, 0, 0, 1)]
TWO_QUERY = "tile=1001%2F0%2F0%2F0&tile=1001%2F0%2F0%2F1&"
AS_NPY = {"body": npy(RAW), "headers": {"content-type": "application/x-npy"}}
AS_RAW = {"body": RAW.tobytes(), "headers": {"content-type": "application/octet-stream"}}
AS_JSON = {"body": b'{"depth": 0.5}', "headers": {"content-type": "application/json"}}

SERVICE = [
    Case("health", (), "GET /healthz", {"status": "alive"}, lambda r: r is True),
    Case("ready", (), "GET /readyz", {"status": "ready"}, lambda r: r is True),
    Case("metrics", (), "GET /metrics", b"x 1\n", lambda r: r == "x 1\n"),
    Case(
        "devices",
        (),
        "GET /v1/devices",
        [{"name": "d", "memory": 5, "colour": "red"}],
        lambda r: r == [Device("d", memory=5)],
    ),
]
ASSETS = [
    Case("assets", (), "GET /v1/assets", [ASSET], lambda r: r[0].udims == (1001, 1002)),
    Case(
        "asset",
        ("a",),
        "GET /v1/assets/a",
        ASSET,
        lambda r: r == Asset("a" * 16, "ready", udims=(1001, 1002)),
    ),
    Case(
        "change_asset",
        (Asset("a", "ready"), {"depth": 0.5}),
        "PATCH /v1/assets/a",
        ASSET,
        lambda r: r.id == "a" * 16,
        **AS_JSON,
    ),
    Case("delete_asset", ("a",), "DELETE /v1/assets/a", b"", lambda r: r is None),
    Case(
        "delete_asset",
        ("a",),
        "DELETE /v1/assets/a?shared=true",
        b"",
        lambda r: r is None,
        options={"shared": True},
    ),
    Case(
        "graph",
        ("a",),
        "GET /v1/assets/a/graph?format=safetensors",
        b"\x08\0",
        lambda r: r == b"\x08\0",
    ),
    Case("mesh", ("a",), "GET /v1/assets/a/mesh?format=glb", b"glTF", lambda r: r == b"glTF"),
    Case("job", ("j",), "GET /v1/jobs/j", JOB, lambda r: r == Job(**JOB)),
    Case("cancel", (Job("j", "running"),), "DELETE /v1/jobs/j", JOB, lambda r: not r.ended),
    Case("wait", (Asset("a", "ready"),), "GET /v1/assets/a", ASSET, lambda r: r.state == "ready"),
]
FRAMES = [
    Case(
        "put_frame",
        ("a", "smile", POSITIONS),
        "PUT /v1/assets/a/frames/smile",
        FRAME,
        lambda r: r == Frame("smile", {"p50": 0.1}),
        **AS_NPY,
    ),
    Case(
        "put_frame",
        ("a", "smile", POSITIONS.tolist()),
        "PUT /v1/assets/a/frames/smile",
        FRAME,
        lambda r: r.name == "smile",
        {"raw": True},
        **AS_RAW,
    ),
    Case("frames", ("a",), "GET /v1/assets/a/frames", [FRAME], lambda r: len(r) == 1),
    Case("frame", ("a", "s"), "GET /v1/assets/a/frames/s", FRAME, lambda r: r.name == "smile"),
    Case(
        "positions",
        ("a", "s"),
        "GET /v1/assets/a/frames/s",
        npy(RAW),
        lambda r: same(r, RAW),
        headers={"accept": "application/x-npy"},
    ),
    Case("delete_frame", ("a", "s"), "DELETE /v1/assets/a/frames/s", b"", lambda r: r is None),
    Case(
        "stretch",
        ("a", "s"),
        "GET /v1/assets/a/frames/s/stretch",
        npz(axes=np.ones((2, 2, 2), "f4"), ratios=RAW, folds=np.zeros(2, "f4")),
        lambda r: r.axes.shape == (2, 2, 2) and same(r.ratios, RAW) and r.folds.shape == (2,),
    ),
    Case(
        "calibrate",
        ("a", POSITIONS),
        "PUT /v1/assets/a/calibration",
        JOB,
        lambda r: r.id == "j",
        **AS_NPY,
    ),
]
MAPS = [
    Case(
        "tile",
        TILE,
        "GET " + TILE_PATH + QUERY + "npy",
        npy(HEIGHT),
        lambda r: same(r.array, HEIGHT) and r.etag == '"e"',
    ),
    Case(
        "tile",
        TILE,
        "GET " + TILE_PATH + QUERY + "f16",
        HEIGHT.astype("<f2").tobytes(),
        lambda r: same(r.array, HEIGHT.astype("<f2")),
        {"format": "f16"},
    ),
    Case(
        "tile",
        TILE,
        "GET " + TILE_PATH + OTHER_QUERY,
        b"\x89PNG",
        lambda r: r.content == b"\x89PNG" and r.scale == 0.25 and r.values is None,
        OTHER,
    ),
    Case(
        "map",
        ("a", "s", 1001),
        "GET /v1/assets/a/frames/s/maps/1001?level=2&" + QUERY + "exr",
        b"v/1\x01",
        lambda r: r.content == b"v/1\x01" and r.format == "exr",
        {"level": 2, "format": "exr"},
    ),
    Case(
        "tiles",
        ("a", POSITIONS, TWO),
        "POST /v1/assets/a/tiles?" + TWO_QUERY + QUERY + "f16",
        MIXED,
        lambda r: [float(t.array[0, 0]) for t in r] == [1.0, 2.0],
        {"format": "f16"},
        **AS_NPY,
    ),
    Case(
        "bins",
        ("a",),
        "GET /v1/assets/a/bins",
        BINS,
        lambda r: isinstance(r, Bins) and r.steps["wrinkles"] == (1e-4,) * 3,
    ),
    Case(
        "bin_tile",
        ("a", 1001, 0, 2, 3),
        "GET /v1/assets/a/bins/1001/0/2/3?bin=1&sample=2&layer=wrinkles",
        npy(CODES),
        lambda r: same(r, CODES),
        {"bin": 1, "sample": 2},
    ),
]
CASES = [*SERVICE, *ASSETS, *FRAMES, *MAPS]
ANSWERED = {
    "ETag": '"e"',
    "X-Rhytid-Scale": "0.25",
    "Content-Type": "multipart/mixed; boundary=b",
}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_call(shell: Callable[..., Shell], case: Case) -> None:
    body = case.answer if isinstance(case.answer, bytes) else json.dumps(case.answer).encode()
    script = Script(httpx.Response(200, headers=ANSWERED, content=body))
    result = getattr(shell(script), case.name)(*case.args, **case.options)
    assert case.reads(result), result
    (sent,) = script.seen
    assert f"{sent.method} {sent.url}" == case.sends.replace(" ", " http://rhytid.test/api")
    assert script.bodies == [case.body]
    assert {name: sent.headers.get(name) for name in case.headers} == case.headers


def test_every_call_has_a_case_and_a_method_on_every_client() -> None:
    wanted = set(calls.__all__)
    # Those that send or receive whole files have tests of their own.
    assert {case.name for case in CASES} | {
        "create_asset",
        "package",
        "snapshot",
        "restore",
    } == wanted
    for client, more in ((Client, {"close"}), (AsyncClient, {"close"}), (PlainClient, set())):
        public = {name for name in dir(client) if not name.startswith("_")}
        assert public == wanted | more | {"live"}  # not a call, but a connection


def test_live_is_the_same_on_every_client() -> None:
    blocking, awaited = (inspect.signature(client.live) for client in (Client, AsyncClient))
    assert blocking.parameters == awaited.parameters
    assert set(blocking.parameters) - {"self"} == set(inspect.signature(live).parameters) - {
        "url",
        "headers",
    }


@pytest.mark.parametrize("client", [Client, AsyncClient, PlainClient])
def test_the_default_address_is_where_a_server_listens(client: type) -> None:
    url = inspect.signature(client).parameters["url"].default
    assert url == f"http://127.0.0.1:{PORT}"


def test_the_methods_described_are_those_of_the_server() -> None:
    (line,) = [x for x in str(calls.tile.__doc__).splitlines() if "method: " in x]
    described = line.split("method: ")[1].split(".")[0].replace(" or ", ", ")
    assert tuple(described.split(", ")) == METHODS


@pytest.mark.parametrize("name", calls.__all__)
def test_methods_describe_themselves(name: str) -> None:
    blocking, awaited = getattr(Client, name), getattr(AsyncClient, name)
    assert blocking.__doc__ == awaited.__doc__ == getattr(calls, name).__doc__
    assert inspect.iscoroutinefunction(awaited)
    shown = inspect.signature(blocking)
    assert shown == inspect.signature(awaited)
    assert next(iter(shown.parameters)) == "self"
    assert "Flow" not in str(shown)


@pytest.mark.parametrize(("name", "args"), [("tile", TILE), ("map", ("a", "smile", 1001))])
def test_tile_that_is_known_comes_back_itself(
    shell: Callable[..., Shell], name: str, args: tuple[Any, ...]
) -> None:
    first = httpx.Response(200, headers={"ETag": '"v1"'}, content=npy(HEIGHT))
    script = Script(first, httpx.Response(304, headers={"ETag": '"v1"'}))
    call = getattr(shell(script), name)
    tile = call(*args)
    assert call(*args, if_none_match=tile) is tile
    assert [sent.headers.get("if-none-match") for sent in script.seen] == [None, '"v1"']


def test_form_of_a_new_asset(shell: Callable[..., Shell], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("secrets.token_hex", lambda count: "fence")
    script = Script(httpx.Response(202, json=ASSET))
    told: list[tuple[int, int]] = []
    shell(script).create_asset(
        b"v 0 0 0\n",
        name="face.obj",
        settings={"depth": 1},
        graph=b"\x01",
        progress=lambda sent, total: told.append((sent, total)),
    )
    binary = "Content-Type: application/octet-stream\r\n\r\n"
    text = (
        f'--fence\r\nContent-Disposition: form-data; name="mesh"; filename="face.obj"\r\n{binary}'
        "v 0 0 0\n\r\n"
        '--fence\r\nContent-Disposition: form-data; name="settings"\r\n'
        'Content-Type: application/json\r\n\r\n{"depth": 1}\r\n'
        '--fence\r\nContent-Disposition: form-data; name="graph"; filename="graph"\r\n'
        f"{binary}\x01\r\n"
        "--fence--\r\n"
    )
    assert script.bodies == [text.encode()]
    (sent,) = script.seen
    assert sent.headers["content-type"] == "multipart/form-data; boundary=fence"
    assert sent.headers["content-length"] == str(len(text))
    assert "transfer-encoding" not in sent.headers
    assert told[-1] == (len(text), len(text))


@pytest.mark.parametrize("kind", ["bytes", "path", "paths", "by UDIM", "EXR by UDIM"])
def test_every_stiffness_map_is_a_part_that_names_its_udim(
    shell: Callable[..., Shell], tmp_path: Path, kind: str
) -> None:
    paths = [tmp_path / f"skin.{udim}.png" for udim in (1001, 1002)]
    exr = tmp_path / "skin.EXR"
    for path in (*paths, exr):
        path.write_bytes(path.name.encode())
    given: dict[str, tuple[Any, list[str]]] = {
        "bytes": (b"x", ["stiffness"]),
        "path": (str(paths[0]), ["skin.1001.png"]),
        "paths": (paths, ["skin.1001.png", "skin.1002.png"]),
        "by UDIM": ({1002: paths[0], 1001: b"x"}, ["1002.png", "1001.png"]),
        "EXR by UDIM": ({1002: exr, 1001: b"\x76\x2f\x31\x01"}, ["1002.exr", "1001.exr"]),
    }
    script = Script(httpx.Response(202, json=ASSET))
    shell(script).create_asset(b"v", name="a.obj", stiffness=given[kind][0])
    (body,) = script.bodies
    assert re.findall('name="stiffness"; filename="(.*?)"', body.decode()) == given[kind][1]


@pytest.mark.parametrize("frame", ["", ".", ".."])
def test_name_that_leaves_its_place_is_refused(shell: Callable[..., Shell], frame: str) -> None:
    script = Script(httpx.Response(200, json=FRAME))
    with pytest.raises(ValueError, match="is not a name"):
        shell(script).frame("a", frame)
    assert script.seen == []


@pytest.mark.parametrize("frame", ["../../x", "a/b", "a?b=c", "a#b", "%2e%2e", "é"])
def test_name_stays_one_segment(shell: Callable[..., Shell], frame: str) -> None:
    script = Script(httpx.Response(200, json=FRAME))
    shell(script).frame("a", frame)
    (sent,) = script.seen
    assert sent.url.query == b""
    assert sent.url.raw_path.count(b"/") == "/api/v1/assets/a/frames/x".count("/")
    assert sent.url.path == "/api/v1/assets/a/frames/" + frame


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 4, 3)])
def test_positions_of_another_shape_are_refused(
    shell: Callable[..., Shell], shape: tuple[int, ...]
) -> None:
    script = Script(httpx.Response(200, json=FRAME))
    with pytest.raises(ValueError, match=r"not \(V, 3\)"):
        shell(script).put_frame("a", "s", np.zeros(shape))
    assert script.seen == []
