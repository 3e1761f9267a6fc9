"""The client for asyncio."""

from __future__ import annotations

from asyncio import sleep
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import httpx
from numpy.typing import ArrayLike

from rhytid_client import calls
from rhytid_client.choices import LiveFormat, Method, Sampling, StretchModel
from rhytid_client.errors import ConnectionFailed
from rhytid_client.exchange import Flow, Listen, Step, patient
from rhytid_client.file_body import Arriving, FileBody
from rhytid_client.live.awaited import AsyncLive
from rhytid_client.live.messages import Address
from rhytid_client.live.opening import opening
from rhytid_client.methods import ANSWER_SECONDS, CONNECT_SECONDS, described
from rhytid_client.multipart_form import Form
from rhytid_client.parse import Response
from rhytid_client.requests import Request, with_key
from rhytid_client.results import Asset

P = ParamSpec("P")
T = TypeVar("T")


def _method(
    call: Callable[P, Flow[T]],
) -> Callable[Concatenate[AsyncClient, P], Coroutine[Any, Any, T]]:
    async def method(self: AsyncClient, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._run(call(*args, **kwargs))

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

    def live(
        self,
        asset: Asset | str,
        *,
        tiles: Iterable[Address] | None = None,
        camera: ArrayLike | None = None,
        level: int = 0,
        two_sided: bool = False,
        method: Method = "redraw",
        stretch: StretchModel = "tensor",
        sampling: Sampling = "nearest",
        format: LiveFormat = "f32",
        scale: float | None = None,
        tolerance: float = 0.0,
        shapes: Sequence[str] = (),
    ) -> AsyncLive:
        """A live connection, opened by `async with`: frames go out, tiles come in. Proxies and an
        httpx client of your own are not used for it. It needs the extra `live`.

        tiles: (udim, level, row, column) each.  camera: (4, 4) projection times view, in place of
        tiles: what it sees of one `level`; `two_sided` counts what turns its back, too.  format:
        how tiles travel: f32, f16, or u16, of which `scale` is the largest displacement.
        tolerance: mesh units that a tile has to change by to be sent again.  shapes: names of the
        weights that will be sent, such as those of ARKit; empty = the asset's own, in its order.
        """
        wanted = opening(
            self._url, self._headers, asset, tiles=tiles, camera=camera, level=level,
            two_sided=two_sided, method=method, stretch=stretch, sampling=sampling, format=format,
            scale=scale, tolerance=tolerance, shapes=shapes,
        )  # fmt: skip
        return AsyncLive(wanted)

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
