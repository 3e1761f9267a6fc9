"""The blocking client."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx

from rhytid_client.blocking import BlockingClient
from rhytid_client.errors import ConnectionFailed
from rhytid_client.exchange import Listen
from rhytid_client.file_body import Arriving, FileBody
from rhytid_client.methods import ANSWER_SECONDS, CONNECT_SECONDS
from rhytid_client.multipart_form import Form
from rhytid_client.parse import Response
from rhytid_client.requests import Request, with_key


class Client(BlockingClient):
    """A rhytid server, asked and waited for.

    url: the server's address.  max_wait: seconds that a call may spend asking again while the
    server is busy or the asset is building.  key: an API key of the server.  http: an httpx client
    of your own, for proxies, certificates or headers; it stays yours to close.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8717",
        *,
        max_wait: float = 60.0,
        key: str | None = None,
        http: httpx.Client | None = None,
    ) -> None:
        super().__init__(url, max_wait)
        self._headers = with_key(key)
        self._owned = http is None
        timeout = httpx.Timeout(ANSWER_SECONDS, connect=CONNECT_SECONDS)
        self._http = httpx.Client(timeout=timeout) if http is None else http

    def close(self) -> None:
        """Close the connections that this client opened."""
        if self._owned:
            self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _send(self, request: Request) -> Response:
        body: Any = request.content
        content = body.chunks() if isinstance(body, Form | FileBody) else body
        try:
            with self._http.stream(
                request.method,
                self._url + request.path,
                params=request.params,
                headers={**self._headers, **request.headers},
                content=content,
            ) as response:
                if request.into is None or response.status_code != 200:
                    came = response.read()
                else:
                    came = _kept(request.into, response)
        except (httpx.RequestError, EOFError) as exc:
            raise ConnectionFailed(f"{type(exc).__name__}: {exc} [{request}]") from exc
        return Response(request, response.status_code, dict(response.headers), came)

    def _listen(self, step: Listen) -> None:
        url, timeout = self._url + step.request.path, httpx.Timeout(step.timeout)
        try:
            with self._http.stream("GET", url, headers=self._headers, timeout=timeout) as response:
                if response.status_code != 200:
                    return
                for chunk in response.iter_bytes():
                    if step.feed(chunk):
                        return
        except httpx.RequestError:
            # Listening is a convenience: the flow asks again, and a dead server shows then.
            return


def _kept(path: Path, response: httpx.Response) -> bytes:
    """No bytes: those of the answer are in the file."""
    with Arriving(path) as file:
        for chunk in response.iter_bytes():
            file.write(chunk)
        file.done(response.headers.get("content-length"))
    return b""
