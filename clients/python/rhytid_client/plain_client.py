"""The blocking client over Python's own HTTP, for programs that have no httpx."""

from __future__ import annotations

import ssl
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from pathlib import Path
from urllib.parse import SplitResult, urlencode, urlsplit

from rhytid_client.blocking import BlockingClient
from rhytid_client.errors import ConnectionFailed
from rhytid_client.exchange import Listen
from rhytid_client.file_body import Arriving, FileBody
from rhytid_client.methods import ANSWER_SECONDS, CONNECT_SECONDS
from rhytid_client.multipart_form import Form
from rhytid_client.parse import Response
from rhytid_client.requests import Request, with_key

_CHUNK = 1 << 16


class PlainClient(BlockingClient):
    """A rhytid server, asked and waited for, with the methods of `Client` and without httpx.

    url: the server's address, http or https.  key: an API key of the server.  headers: sent with
    every request.  connect: seconds that a connection may take.  Proxies are not
    used and redirections are not followed, so that headers go to this server alone. Every request
    has a connection of its own: there is nothing to close, and threads may share a client. Raises
    ValueError for another kind of address.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8717",
        *,
        max_wait: float = 60.0,
        key: str | None = None,
        headers: Mapping[str, str] | None = None,
        connect: float = CONNECT_SECONDS,
    ) -> None:
        super().__init__(url, max_wait)
        self._address = _checked(self._url)
        self._headers = {**with_key(key), **(headers or {})}
        self._connect = connect

    def _send(self, request: Request) -> Response:
        try:
            with self._asked(request, ANSWER_SECONDS) as answer:
                headers = {name.lower(): value for name, value in answer.getheaders()}
                if request.into is None or answer.status != 200:
                    came = answer.read()
                else:
                    came = _kept(request.into, answer)
                return Response(request, answer.status, headers, came)
        except (OSError, HTTPException, EOFError) as exc:
            raise ConnectionFailed(f"{type(exc).__name__}: {exc} [{request}]") from exc

    def _listen(self, step: Listen) -> None:
        try:
            with self._asked(step.request, step.timeout) as answer:
                if answer.status != 200:
                    return
                while chunk := answer.read1(_CHUNK):
                    if step.feed(chunk):
                        return
        except (OSError, HTTPException):
            # Listening is a convenience: the flow asks again, and a dead server shows then.
            return

    @contextmanager
    def _asked(self, request: Request, timeout: float) -> Iterator[HTTPResponse]:
        query = f"?{urlencode(request.params)}" if request.params else ""
        body = request.content
        with closing(self._connection()) as connection:
            connection.connect()
            connection.sock.settimeout(timeout)
            # A server that refuses a body closes its end, and has answered all the same.
            with suppress(BrokenPipeError, ConnectionResetError):
                connection.request(
                    request.method,
                    self._address.path + request.path + query,
                    body.chunks() if isinstance(body, Form | FileBody) else body,
                    {"Connection": "close", **self._headers, **request.headers},
                )
            yield connection.getresponse()

    def _connection(self) -> HTTPConnection:
        host, port = self._address.hostname or "", self._address.port
        if self._address.scheme == "http":
            return HTTPConnection(host, port, timeout=self._connect)
        context = ssl.create_default_context()
        return HTTPSConnection(host, port, timeout=self._connect, context=context)


def _checked(url: str) -> SplitResult:
    address = urlsplit(url)
    if address.scheme not in ("http", "https") or not address.hostname or address.query:
        raise ValueError(f"{url!r} is not the address of a server, as http://127.0.0.1:8717 is")
    address.port  # noqa: B018  raises ValueError for a port that is none
    return address


def _kept(path: Path, answer: HTTPResponse) -> bytes:
    """No bytes: those of the answer are in the file."""
    with Arriving(path) as file:
        while chunk := answer.read(_CHUNK):
            file.write(chunk)
        file.done(answer.getheader("content-length"))
    return b""
