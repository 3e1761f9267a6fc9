"""The client for asyncio."""

from __future__ import annotations

from asyncio import sleep
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import httpx

from rhytid_client import calls
from rhytid_client.errors import ConnectionFailed
from rhytid_client.exchange import Flow, Listen, Step, patient
from rhytid_client.file_body import Arriving, FileBody
from rhytid_client.live import opening
from rhytid_client.live.awaited import AsyncLive
from rhytid_client.live.opening import LiveRequest
from rhytid_client.methods import ANSWER_SECONDS, CONNECT_SECONDS, described
from rhytid_client.multipart_form import Form
from rhytid_client.parse import Response
from rhytid_client.requests import Request, with_key

P = ParamSpec("P")
T = TypeVar("T")


def _method(
    call: Callable[P, Flow[T]],
) -> Callable[Concatenate[AsyncClient, P], Coroutine[Any, Any, T]]:
    async def method(self: AsyncClient, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._run(call(*args, **kwargs))

    return described(method, call)


def _live(call: Callable[P, LiveRequest]) -> Callable[Concatenate[AsyncClient, P], AsyncLive]:
    def method(self: AsyncClient, /, *args: P.args, **kwargs: P.kwargs) -> AsyncLive:
        return AsyncLive(call(*args, **kwargs).to(self._url, self._headers))

    return described(method, call)


class AsyncClient:
    """A rhytid server, asked without blocking; the methods of `Client`, to be awaited.

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
        http: httpx.AsyncClient | None = None,
    ) -> None:
        self._url = url.rstrip("/")
        self._max_wait = max_wait
        self._headers = with_key(key)
        self._owned = http is None
        timeout = httpx.Timeout(ANSWER_SECONDS, connect=CONNECT_SECONDS)
        self._http = httpx.AsyncClient(timeout=timeout) if http is None else http

    async def close(self) -> None:
        """Close the connections that this client opened."""
        if self._owned:
            await self._http.aclose()

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.close()

    health = _method(calls.health)
    ready = _method(calls.ready)
    metrics = _method(calls.metrics)
    devices = _method(calls.devices)

    create_asset = _method(calls.create_asset)
    assets = _method(calls.assets)
    asset = _method(calls.asset)
    change_asset = _method(calls.change_asset)
    delete_asset = _method(calls.delete_asset)
    graph = _method(calls.graph)
    mesh = _method(calls.mesh)
    package = _method(calls.package)
    snapshot = _method(calls.snapshot)
    restore = _method(calls.restore)

    job = _method(calls.job)
    cancel = _method(calls.cancel)
    wait = _method(calls.wait)

    put_frame = _method(calls.put_frame)
    frames = _method(calls.frames)
    frame = _method(calls.frame)
    positions = _method(calls.positions)
    delete_frame = _method(calls.delete_frame)
    stretch = _method(calls.stretch)
    calibrate = _method(calls.calibrate)

    tile = _method(calls.tile)
    map = _method(calls.map)
    tiles = _method(calls.tiles)
    bins = _method(calls.bins)
    bin_tile = _method(calls.bin_tile)

    live = _live(opening.live)

    async def _run(self, flow: Flow[T]) -> T:
        steps = patient(flow, self._max_wait)
        came: Response | None = None
        while True:
            try:
                step = steps.send(came)
            except StopIteration as end:
                result: T = end.value
                return result
            came = await self._take(step)

    async def _take(self, step: Step) -> Response | None:
        if isinstance(step, Request):
            return await self._send(step)
        if isinstance(step, Listen):
            await self._listen(step)
        else:
            await sleep(step.seconds)
        return None

    async def _send(self, request: Request) -> Response:
        body: Any = request.content
        content = _awaited(body.chunks()) if isinstance(body, Form | FileBody) else body
        try:
            async with self._http.stream(
                request.method,
                self._url + request.path,
                params=request.params,
                headers={**self._headers, **request.headers},
                content=content,
            ) as response:
                if request.into is None or response.status_code != 200:
                    came = await response.aread()
                else:
                    came = await _kept(request.into, response)
        except (httpx.RequestError, EOFError) as exc:
            raise ConnectionFailed(f"{type(exc).__name__}: {exc} [{request}]") from exc
        return Response(request, response.status_code, dict(response.headers), came)

    async def _listen(self, step: Listen) -> None:
        url, timeout = self._url + step.request.path, httpx.Timeout(step.timeout)
        try:
            async with self._http.stream(
                "GET", url, headers=self._headers, timeout=timeout
            ) as response:
                if response.status_code != 200:
                    return
                async for chunk in response.aiter_bytes():
                    if step.feed(chunk):
                        return
        except httpx.RequestError:
            # Listening is a convenience: the flow asks again, and a dead server shows then.
            return


async def _awaited(chunks: Iterator[bytes]) -> AsyncIterator[bytes]:
    """The form httpx wants; a chunk of a file is read in less time than it takes to send."""
    for chunk in chunks:
        yield chunk


async def _kept(path: Path, response: httpx.Response) -> bytes:
    """No bytes: those of the answer are in the file. Each is written in less time than it takes to
    come."""
    with Arriving(path) as file:
        async for chunk in response.aiter_bytes():
            file.write(chunk)
        file.done(response.headers.get("content-length"))
    return b""
