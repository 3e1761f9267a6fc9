"""Which key opens which route: every route of the app, with every kind of key."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest
from fastapi import WebSocket
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from api.asking import NPY, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile, upload
from rhytid.api.access import OPEN, ROUTES, Access, RateLimiter
from rhytid.api.app import create_app
from rhytid.api.keys import SCOPES, ApiKey, new_key, utc_now, write_keys
from rhytid.errors import ApiKeyError, QuotaError
from rhytid.support.settings import ServiceSettings


def walked(routes: Iterable[Any]) -> Iterator[Any]:
    """Every route, those of included routers and of mounted apps too."""
    for route in routes:
        inside = getattr(route, "original_router", route)
        if hasattr(inside, "routes"):
            yield from walked(inside.routes)
        else:
            yield route


def routes() -> list[Any]:
    engine: Any = FakeEngine()
    found = list(walked(create_app(engine, ServiceSettings()).routes))
    assert len(found) > 25
    return found


def calls(route: Any) -> set[str]:
    """Methods and path of a route; HEAD is as GET, and a WebSocket has no method."""
    path = route.path.replace(":path}", "}")
    return {f"{method} {path}" for method in (methods(route) or {"WS"}) - {"HEAD"}}


def methods(route: Any) -> set[str]:
    """None of a WebSocket."""
    return getattr(route, "methods", None) or set()


# Of the framework, which runs no guard before it. It says what is in the source.
DOCUMENT = "GET /openapi.json"


def test_every_route_has_a_scope_and_every_scope_a_route() -> None:
    found = {call for route in routes() for call in calls(route)}
    assert found - {DOCUMENT} == set(ROUTES)
    assert set(ROUTES.values()) == {OPEN, *SCOPES}
    heads = {route.path for route in routes() if "HEAD" in methods(route)}
    assert {f"GET {path}" for path in heads} <= {*ROUTES, DOCUMENT}


def test_what_is_open_is_said_here_once_more() -> None:
    assert ROUTES["WS /v1/assets/{asset}/live"] == ROUTES["POST /v1/assets/{asset}/tiles"]
    named = {call for call, scope in ROUTES.items() if scope == OPEN}
    assert named == {
        f"GET {path}"
        for path in ("/", "/healthz", "/readyz", "/docs", "/docs/{file}", "/viewer/{file}")
    }


class Keyed(NamedTuple):
    """A server that asks for keys, and a key for each scope."""

    client: httpx.Client
    keys: dict[str, str]
    file: Path


def bearer(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Keyed]:
    file = tmp_path_factory.mktemp("keys") / "keys.json"
    made = {scope: new_key(scope, {scope}) for scope in SCOPES}
    made["none"] = new_key("none", ())
    made["over"] = new_key("over", SCOPES, utc_now() - timedelta(seconds=1))
    write_keys(file, [key for _, key in made.values()])
    with serving(FakeEngine(), keys=file) as client:
        yield Keyed(client, {name: shown for name, (shown, _) in made.items()}, file)


def place(call: str) -> tuple[str, str]:
    """Method and path of a call, with something in place of its parameters."""
    method, path = call.split()
    for name in ("asset", "frame", "job", "file", "path"):
        path = path.replace(f"{{{name}}}", f"some-{name}")
    return method, path.replace("{udim}", "1001").replace("{level}/{row}/{column}", "0/0/0")


GUARDED = sorted(c for c, scope in ROUTES.items() if scope != OPEN and not c.startswith("WS "))
SOCKETS = sorted(call for call in ROUTES if call.startswith("WS "))
HEADS = sorted(f"HEAD {r.path}" for r in routes() if methods(r) == {"HEAD"})


def scope_of(call: str) -> str:
    return ROUTES[call.replace("HEAD ", "GET ")]


@pytest.mark.parametrize("call", GUARDED + HEADS)
def test_a_route_opens_to_its_scope_alone(keyed: Keyed, call: str) -> None:
    method, path = place(call)
    for name, key in keyed.keys.items():
        answer = keyed.client.request(method, path, headers=bearer(key))
        refused = {"over": 401}.get(name, 200 if name == scope_of(call) else 403)
        if refused == 200:
            assert answer.status_code not in (401, 403), name
        else:
            assert answer.status_code == refused, name
    assert keyed.client.request(method, path).status_code == 401


LIVE = "rhytid.live.1"


def handshake(keyed: Keyed, path: str, **options: Any) -> int:
    """The status of the answer to a WebSocket that is asked for."""
    url = f"{keyed.client.base_url}/{path}".replace("http", "ws", 1)
    with pytest.raises(InvalidStatus) as raised:
        connect(url, proxy=None, **options)
    return int(raised.value.response.status_code)


@pytest.mark.parametrize("call", SOCKETS)
@pytest.mark.parametrize("how", ["header", "subprotocol"])
def test_a_websocket_opens_to_its_scope_alone(keyed: Keyed, call: str, how: str) -> None:
    path = place(call)[1].removeprefix("/")
    for name, key in keyed.keys.items():
        if how == "header":
            options = {"additional_headers": bearer(key), "subprotocols": [LIVE]}
        else:
            options = {"subprotocols": [LIVE, f"rhytid.key.{key}"]}
        # There is no such asset, which is told to those alone who may know.
        expected = {"over": 401}.get(name, 404 if name == ROUTES[call] else 403)
        assert handshake(keyed, path, **options) == expected, name
    assert handshake(keyed, path, subprotocols=[LIVE]) == 401


def test_a_websocket_shows_one_key_and_never_in_the_query(keyed: Keyed) -> None:
    path, key = "v1/assets/some-asset/live", keyed.keys["compute"]
    both = [LIVE, f"rhytid.key.{key}"]
    assert handshake(keyed, path, additional_headers=bearer(key), subprotocols=both) == 401
    assert handshake(keyed, path, subprotocols=[*both, both[1]]) == 401
    assert handshake(keyed, f"{path}?key={key}", subprotocols=[LIVE]) == 401
    assert handshake(keyed, path, subprotocols=[LIVE, "rhytid.key.wrong"]) == 401


def test_a_handshake_leaves_no_key_in_the_log(
    keyed: Keyed, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    path, key = "v1/assets/some-asset/live", keyed.keys["compute"]
    assert handshake(keyed, path, subprotocols=[LIVE, f"rhytid.key.{key}"]) == 404
    assert handshake(keyed, path, additional_headers=bearer(key), subprotocols=[LIVE]) == 404
    ours = [r.getMessage() for r in caplog.records if r.name.startswith(("rhytid", "uvicorn"))]
    assert any(path in message for message in ours)
    assert not any(key[16:] in message for message in ours)


@pytest.mark.parametrize("call", sorted(call for call, scope in ROUTES.items() if scope == OPEN))
def test_an_open_route_asks_for_no_key(keyed: Keyed, call: str) -> None:
    method, path = place(call)
    answer = keyed.client.request(method, path)
    assert answer.status_code == (404 if "file" in path else 200)
    assert keyed.client.get("/openapi.json").status_code == 200


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"Authorization": ""},
        {"Authorization": "Bearer"},
        {"Authorization": "Basic cmVhZDpyZWFk"},
        {"Authorization": "Bearer rhytid_00000000_" + "A" * 43},
        {"Authorization": "Bearer " + "x" * 5000},
        {"X-API-Key": "KEY"},
        {"Authorization": "KEY"},
        {"Authorization": "Basic KEY"},
        {"Authorization": "Bearer KEY KEY"},
        {"Authorization": "Bearer KEYx"},
        {"Cookie": "key=KEY"},
    ],
)
def test_what_is_no_key_opens_nothing(keyed: Keyed, given: dict[str, str]) -> None:
    headers = {name: value.replace("KEY", keyed.keys["read"]) for name, value in given.items()}
    answer = keyed.client.get("/v1/assets", headers=headers)
    assert "API key" in is_problem(answer, 401, "key")
    assert answer.headers["www-authenticate"] == 'Bearer realm="rhytid"'
    assert keyed.keys["read"] not in answer.text
    query = {"key": keyed.keys["read"]}
    assert keyed.client.get("/v1/assets", params=query).status_code == 401


def test_two_keys_at_once_open_nothing(keyed: Keyed) -> None:
    two = [("Authorization", f"Bearer {keyed.keys[name]}") for name in ("read", "admin")]
    assert keyed.client.get("/v1/assets", headers=two).status_code == 401


def test_the_name_of_the_scheme_has_no_case(keyed: Keyed) -> None:
    for scheme in ("bearer", "BEARER", "Bearer "):
        given = {"Authorization": f"{scheme} {keyed.keys['read']}"}
        assert keyed.client.get("/v1/assets", headers=given).status_code == 200


def test_a_key_without_the_scope_is_told_which_it_needs(keyed: Keyed) -> None:
    answer = keyed.client.delete("/v1/assets/a", headers=bearer(keyed.keys["compute"]))
    assert is_problem(answer, 403, "scope") == (
        "this needs a key with the scope admin: the key compute has compute"
    )


def test_a_key_is_asked_for_before_anything_else_is_looked_at(keyed: Keyed) -> None:
    for path in ("/v1/assets?colour=red", "/v1/assets/none", "/v1/assets/a/frames/b/tiles/x/y/z/0"):
        assert keyed.client.get(path).status_code == 401
    lines = ["POST /v1/assets HTTP/1.1", "Host: localhost", "Content-Length: 1000000", "", ""]
    url = keyed.client.base_url
    with socket.create_connection((url.host, url.port or 0), timeout=30) as raw:
        raw.sendall("\r\n".join(lines).encode())  # and none of the body
        assert raw.recv(4096).startswith(b"HTTP/1.1 401 ")


def test_a_session_with_keys_for_each_part(keyed: Keyed) -> None:
    read, compute, admin = (bearer(keyed.keys[scope]) for scope in SCOPES)
    client = keyed.client
    made = client.post("/v1/assets", files=upload(), headers=compute).raise_for_status()
    path = f"/v1/assets/{made.json()['id']}"
    sent = client.put(f"{path}/frames/b", content=npy(smile()), headers={**NPY, **compute})
    assert sent.status_code == 200
    tile = client.get(f"{path}/frames/b/tiles/1001/0/0/0", headers=read).raise_for_status()
    known = {**read, "If-None-Match": tile.headers["etag"]}
    assert client.get(f"{path}/frames/b/tiles/1001/0/0/0", headers=known).status_code == 304
    assert client.delete(path, headers=admin).status_code == 204


def test_a_key_that_is_revoked_or_made_while_the_server_runs(tmp_path: Path) -> None:
    """The server looks at the file once a second: it is asked until it has seen it."""
    file = tmp_path / "keys.json"
    (old, kept), (new, made) = new_key("old", {"read"}), new_key("new", {"read"})
    with serving(FakeEngine(), keys=file) as client:

        def status(key: str) -> int:
            return client.get("/v1/assets", headers=bearer(key)).status_code

        assert status(old) == 200  # nobody is asked for a key yet
        write_keys(file, [kept])
        while client.get("/v1/assets").status_code == 200:
            time.sleep(0.02)
        assert (status(old), status(new)) == (200, 401)
        write_keys(file, [made])
        while status(old) == 200:
            time.sleep(0.02)
        assert (status(old), status(new)) == (401, 200)


def test_a_file_that_cannot_be_read_is_told_to_the_log_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "keys.json"
    file.write_text("no keys")
    with serving(FakeEngine(), keys=file) as client:
        key, _ = new_key("any", SCOPES)
        answer = client.get("/v1/assets", headers=bearer(key))
        assert is_problem(answer, 500, "storage") == "the server's log has the reason"
        assert str(tmp_path) in caplog.text
        assert client.get("/v1/assets").status_code == 401
        assert client.get("/healthz").status_code == 200


def test_without_keys_a_file_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "keys.json"
    file.write_text("no keys")
    with serving(FakeEngine(), keys=file, ask_keys=False) as client:
        assert client.get("/v1/assets").status_code == 200


def test_the_log_says_which_key_asked_and_never_the_key(
    keyed: Keyed, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    key = keyed.keys["read"]
    with serving(FakeEngine(), keys=keyed.file) as client:
        client.get("/v1/devices", headers=bearer(key))
    lines = [r.getMessage() for r in caplog.records if r.name == "rhytid.api.metrics"]
    (line,) = [line for line in lines if "/v1/devices" in line]
    assert line.endswith(f" key {key.split('_')[1]}")
    ours = [r.getMessage() for r in caplog.records if r.name.startswith(("rhytid", "uvicorn"))]
    assert not any(key[16:] in message for message in ours)


def request(key: str | None = None, address: str = "10.0.0.1") -> dict[str, Any]:
    headers = [] if key is None else [(b"authorization", f"Bearer {key}".encode())]
    return {"headers": headers, "client": (address, 1)}


def admitted(access: Access, times: int, *args: Any) -> int:
    """Of so many requests, how many were let in."""
    count = 0
    for _ in range(times):
        with suppress(QuotaError):
            access.admit(request(*args), "read")
            count += 1
    return count


def ring(tmp_path: Path, *keys: ApiKey) -> ServiceSettings:
    write_keys(tmp_path / "keys.json", list(keys))
    return ServiceSettings(store=tmp_path, key_rate=10)


@pytest.fixture
def stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of the rates stands still."""
    monkeypatch.setattr("rhytid.api.access.RateLimiter", lambda: RateLimiter(lambda: 1.0))


def test_each_key_has_a_rate_of_its_own(tmp_path: Path, stopped: None) -> None:
    (one, a), (two, b) = new_key("one", {"read"}), new_key("two", {"read"}, rate=3)
    access = Access(ring(tmp_path, a, b))
    asyncio.run(access.refresh())
    # From wherever they come: two seconds' worth may be saved.
    assert admitted(access, 15, one, "10.0.0.1") + admitted(access, 15, one, "10.0.0.2") == 20
    assert admitted(access, 15, two, "10.0.0.1") == 6


def test_who_shows_no_key_is_counted_by_address(tmp_path: Path, stopped: None) -> None:
    shown, key = new_key("one", {"read"})
    access = Access(ring(tmp_path, key))
    asyncio.run(access.refresh())
    for _ in range(20):
        with pytest.raises(ApiKeyError):
            access.admit(request(None), "read")
    with pytest.raises(QuotaError):
        access.admit(request("wrong"), "read")
    access.admit(request(shown), "read")  # a key from the same address is not refused with it
    with pytest.raises(ApiKeyError):
        access.admit(request(None, "10.0.0.2"), "read")


def test_addresses_of_one_network_of_version_6_are_one_caller(
    tmp_path: Path, stopped: None
) -> None:
    access = Access(ServiceSettings(store=tmp_path, key_rate=1))
    scopes = [request(None, a) for a in ("2001:db8::1", "2001:db8::2%eth0", "2001:db8:0:1::1")]
    for scope in scopes:
        access.admit(scope, "read")
    names = [scope["rhytid.caller"].name for scope in scopes]
    assert names == ["address 2001:db8::/64"] * 2 + ["address 2001:db8:0:1::/64"]


def test_the_document_says_which_key_a_call_needs() -> None:
    engine: Any = FakeEngine()
    document = create_app(engine, ServiceSettings()).openapi()
    assert document["components"]["securitySchemes"]["key"]["scheme"] == "bearer"
    for path, found in document["paths"].items():
        for method, call in found.items():
            scope = ROUTES[f"{method.upper()} {path}"]
            assert call.get("security") == (None if scope == OPEN else [{"key": [scope]}])
            assert ("401" in call["responses"]) == (scope != OPEN)
            assert {"400", "403"} <= set(call["responses"])
            assert ("429" in call["responses"]) == (path != "/healthz")


def test_a_websocket_is_guarded_as_a_route_is(
    keyed: Keyed, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine: Any = FakeEngine()
    app = create_app(engine, ServiceSettings(keys=keyed.file))

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        await socket.close()

    def told(key: str) -> tuple[str, int | None]:
        messages: list[Any] = []

        async def send(message: Any) -> None:
            messages.append(message)

        async def receive() -> Any:
            return {"type": "websocket.connect"}

        headers = {"host": "localhost", **bearer(key)}
        scope = {"type": "websocket", "path": "/live", "query_string": b"", "state": {},
                 "headers": [(n.lower().encode(), v.encode()) for n, v in headers.items()],
                 "extensions": {"websocket.http.response": {}}}  # fmt: skip
        asyncio.run(app(scope, receive, send))
        return messages[0]["type"], messages[0].get("status")

    refused = "websocket.http.response.start"
    assert told(keyed.keys["read"]) == (refused, 500)  # it has no row yet
    monkeypatch.setitem(ROUTES, "WS /live", "read")
    assert told(keyed.keys["read"]) == ("websocket.accept", None)
    assert told(keyed.keys["admin"]) == (refused, 403)
    assert told("wrong") == (refused, 401)


def test_a_route_without_a_scope_answers_nobody(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delitem(ROUTES, "GET /v1/devices")
    with serving(FakeEngine()) as client:
        is_problem(client.get("/v1/devices"), 500, "internal")
    assert "GET /v1/devices is in no row" in caplog.text
