"""What is refused by the head of a request alone; on sockets, against a real server."""

from __future__ import annotations

import asyncio
import gzip
import json
import socket
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.asking import NPY, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import smile
from rhytid.api.request_head import CheckHead
from rhytid.errors import SettingsError
from rhytid.support.settings import ServiceSettings


def sent(client: httpx.Client, text: bytes) -> tuple[int, bytes]:
    """The status of the first answer to bytes on a socket, and all that came until the server
    closed it."""
    address = (client.base_url.host, client.base_url.port or 0)
    with socket.create_connection(address, timeout=30) as raw:
        raw.sendall(text)
        came = b""
        while chunk := raw.recv(1 << 16):
            came += chunk
    return int(came.split()[1]), came


KNOWN = ["127.0.0.1", "127.0.0.1:8717", "localhost", "LocalHost:80", "[::1]", "[::1]:8717",
         "a.localhost", "192.168.7.9", "[fe80::1]:8717", "10.0.0.1:"]  # fmt: skip
STRANGE = ["evil.example", "evil.example:8717", "localhost.evil.example", "notlocalhost",
           "127.0.0.1.evil.example", "127.1", "0x7f000001", "[evil.example]", "[::1", "::1", "",
           "localhost:evil", "localhost:123456", "localhost@evil.example", "user@localhost",
           "localhost/", "localhost, evil.example", "a b", "x" * 300]  # fmt: skip


@pytest.mark.parametrize("host", KNOWN)
def test_a_server_is_asked_by_its_address_or_as_localhost(client: httpx.Client, host: str) -> None:
    answer = client.get("/v1/assets", headers={"Host": host})
    assert answer.status_code == 200


@pytest.mark.parametrize("path", ["/", "/healthz", "/v1/assets", "/nowhere"])
@pytest.mark.parametrize("host", STRANGE)
def test_a_page_whose_name_leads_here_is_refused(
    client: httpx.Client, host: str, path: str
) -> None:
    status, came = sent(
        client, f"GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode()
    )
    assert status == 400
    assert b"RHYTID_ALLOWED_HOSTS" in came
    assert b"application/problem+json" in came


@pytest.mark.parametrize(
    "head",
    ["HTTP/1.0\r\n", "HTTP/1.1\r\n", "HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n"],
)
def test_a_request_without_one_host_is_refused(client: httpx.Client, head: str) -> None:
    status, _ = sent(client, f"GET /healthz {head}Connection: close\r\n\r\n".encode())
    assert status == 400


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_two_hosts_are_refused_whatever_server_lets_them_through(kind: str) -> None:
    reached: list[str] = []
    told: list[Any] = []

    async def app(*args: Any) -> None:
        reached.append(kind)

    async def send(message: Any) -> None:
        told.append(message)

    async def ask(*hosts: bytes) -> None:
        scope = {"type": kind, "headers": [(b"host", host) for host in hosts]}
        await CheckHead(app, (), ())(scope, app, send)

    asyncio.run(ask(b"localhost"))
    assert reached == [kind]
    asyncio.run(ask(b"localhost", b"localhost"))
    asyncio.run(ask())
    assert reached == [kind]
    assert [m["status"] for m in told if "status" in m] == [400, 400]


@pytest.fixture(scope="module")
def studio() -> Iterator[httpx.Client]:
    """A server with names of its own and pages that may use it."""
    names = {
        "RHYTID_ALLOWED_HOSTS": "Skin.studio.example, *.farm.example",
        "RHYTID_CORS_ORIGINS": "https://pages.studio.example, http://localhost:5173",
    }
    found = ServiceSettings.from_environment(names)
    with serving(FakeEngine(), hosts=found.hosts, origins=found.origins) as client:
        yield client


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("skin.studio.example:443", 200),
        ("SKIN.STUDIO.EXAMPLE", 200),
        ("n1.farm.example", 200),
        ("localhost", 200),
        ("farm.example", 400),
        ("a.skin.studio.example", 400),
        ("evilfarm.example", 400),
    ],
)
def test_a_server_has_the_names_that_it_is_given(
    studio: httpx.Client, host: str, status: int
) -> None:
    assert studio.get("/v1/assets", headers={"Host": host}).status_code == status


def test_a_server_may_be_called_anything() -> None:
    with serving(FakeEngine(), hosts=("*",)) as client:
        assert client.get("/v1/assets", headers={"Host": "any.example"}).status_code == 200


@pytest.mark.parametrize(
    "name", ["http://a", "a:80", "a/b", "a b", "*a", "a.*", "[::1]", "a..b", "b.", ".b"]
)
def test_what_is_no_name_of_a_host_is_refused(name: str) -> None:
    with pytest.raises(SettingsError, match="RHYTID_ALLOWED_HOSTS"):
        ServiceSettings.from_environment({"RHYTID_ALLOWED_HOSTS": f"good, {name}"})


@pytest.mark.parametrize("name", ["a", "null", "ftp://a", "http://a/", "http://a:b", "https://*.a"])
def test_what_is_no_origin_is_refused(name: str) -> None:
    with pytest.raises(SettingsError, match="RHYTID_CORS_ORIGINS"):
        ServiceSettings.from_environment({"RHYTID_CORS_ORIGINS": f"https://good, {name}"})


STRANGERS = ["https://evil.example", "null", "http://127.0.0.1:1", "https://pages.studio.example.x"]


@pytest.mark.parametrize("origin", STRANGERS)
@pytest.mark.parametrize("method", ["GET", "POST", "DELETE", "OPTIONS"])
def test_pages_from_elsewhere_may_not_use_the_server(
    client: httpx.Client, studio: httpx.Client, method: str, origin: str
) -> None:
    for server in (client, studio):
        answer = server.request(method, "/v1/assets", headers={"Origin": origin})
        assert "Origin" in is_problem(answer, 403)
        assert "access-control-allow-origin" not in answer.headers


def test_pages_of_the_server_itself_may(client: httpx.Client) -> None:
    origin = f"http://127.0.0.1:{client.base_url.port}"
    answer = client.get("/v1/assets", headers={"Origin": origin})
    assert answer.status_code == 200
    assert "access-control-allow-origin" not in answer.headers


def test_pages_that_were_named_may_send_keys_and_read_tags(studio: httpx.Client) -> None:
    origin = {"Origin": "https://pages.studio.example"}
    asked = {"Access-Control-Request-Method": "PUT",
             "Access-Control-Request-Headers": "authorization, content-type"}  # fmt: skip
    before = studio.options("/v1/assets/a/frames/b", headers={**origin, **asked})
    assert before.status_code == 200
    assert before.headers["access-control-allow-origin"] == origin["Origin"]
    answer = studio.get("/v1/assets", headers=origin)
    assert answer.headers["access-control-allow-origin"] == origin["Origin"]
    readable = answer.headers["access-control-expose-headers"].split(", ")
    assert {"ETag", "X-Rhytid-Package"} <= set(readable)
    assert "access-control-allow-credentials" not in answer.headers
    # What is refused can be read, too.
    refused = studio.get("/v1/assets/none", headers=origin)
    assert refused.headers["access-control-allow-origin"] == origin["Origin"]


SMUGGLED = b"GET /v1/devices HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.mark.parametrize("order", [1, -1])
def test_a_length_beside_chunks_is_refused_and_nothing_after_it_is_read(
    client: httpx.Client, order: int
) -> None:
    framing = [b"Content-Length: 4", b"Transfer-Encoding: chunked"][::order]
    lines = [b"POST /v1/assets HTTP/1.1", b"Host: localhost", *framing, b"", b"0", b"", SMUGGLED]
    status, came = sent(client, b"\r\n".join(lines))
    assert status == 400
    assert came.count(b"HTTP/1.1 ") == 1
    body = json.loads(came.partition(b"\r\n\r\n")[2])
    assert "Content-Length and Transfer-Encoding" in body["detail"]


@pytest.mark.parametrize(
    "framing",
    [
        b"Content-Length: 4\r\nContent-Length: 5",
        b"Content-Length: 4, 5",
        b"Content-Length: -4",
        b"Content-Length: 0x4",
        b"Transfer-Encoding: gzip, chunked",
        b"Transfer-Encoding: chunked\r\nTransfer-Encoding: identity",
        b"Transfer-Encoding : chunked",
    ],
)
def test_other_framing_that_means_two_things_is_refused(
    client: httpx.Client, framing: bytes
) -> None:
    head = b"POST /v1/assets HTTP/1.1\r\nHost: localhost\r\n" + framing + b"\r\n\r\n"
    status, came = sent(client, head + b"0\r\n\r\n" + SMUGGLED)
    assert status in (400, 501)
    assert came.count(b"HTTP/1.1 ") == 1


@pytest.mark.parametrize("coding", ["gzip", "deflate", "br", "gzip, identity", "x" * 300])
def test_a_compressed_body_is_refused(client: httpx.Client, asset: str, coding: str) -> None:
    body = gzip.compress(npy(smile()))
    headers = {**NPY, "Content-Encoding": coding}
    answer = client.put(f"/v1/assets/{asset}/frames/zipped", content=body, headers=headers)
    assert "send the body as it is" in is_problem(answer, 415)
    assert answer.headers["accept-encoding"] == "identity"


def test_a_body_that_says_it_is_not_compressed_is_taken(client: httpx.Client, asset: str) -> None:
    headers = {**NPY, "Content-Encoding": "Identity"}
    path = f"/v1/assets/{asset}/frames/plain"
    assert client.put(path, content=npy(smile()), headers=headers).status_code == 200
    client.delete(path)
