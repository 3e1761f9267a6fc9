"""The blocking client."""

from __future__ import annotations

from collections.abc import Callable
from time import sleep
from typing import Any, Concatenate, ParamSpec, TypeVar

import httpx

from rhytid_client import calls
from rhytid_client.errors import ConnectionFailed
from rhytid_client.exchange import Flow, Listen, Step, patient
from rhytid_client.methods import TIMEOUT, described
from rhytid_client.multipart_form import Form
from rhytid_client.parse import Response
from rhytid_client.requests import Request

P = ParamSpec("P")
T = TypeVar("T")


def _method(call: Callable[P, Flow[T]]) -> Callable[Concatenate[Client, P], T]:
    def method(self: Client, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._run(call(*args, **kwargs))

    return described(method, call)


class Client:
    """A rhytid server, asked and waited for.

    url: the server's address.  max_wait: seconds that a call may spend asking again while the
    server is busy or the asset is building.  http: an httpx client of your own, for proxies,
    certificates or headers; it stays yours to close.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8717",
        *,
        max_wait: float = 60.0,
        http: httpx.Client | None = None,
    ) -> None:
        self._url = url.rstrip("/")
        self._max_wait = max_wait
        self._owned = http is None
        self._http = httpx.Client(timeout=TIMEOUT) if http is None else http

    def close(self) -> None:
        """Close the connections that this client opened."""
        if self._owned:
            self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

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

    def _run(self, flow: Flow[T]) -> T:
        steps = patient(flow, self._max_wait)
        came: Response | None = None
        while True:
            try:
                step = steps.send(came)
            except StopIteration as end:
                result: T = end.value
                return result
            came = self._take(step)

    def _take(self, step: Step) -> Response | None:
        if isinstance(step, Request):
            return self._send(step)
        if isinstance(step, Listen):
            self._listen(step)
        else:
            sleep(step.seconds)
        return None

    def _send(self, request: Request) -> Response:
        body: Any = request.content
        content = body.chunks() if isinstance(body, Form) else body
        try:
            response = self._http.request(
                request.method,
                self._url + request.path,
                params=request.params,
                headers=request.headers,
                content=content,
            )
        except httpx.RequestError as exc:
            raise ConnectionFailed(f"{type(exc).__name__}: {exc} [{request}]") from exc
        return Response(request, response.status_code, dict(response.headers), response.content)

    def _listen(self, step: Listen) -> None:
        url, timeout = self._url + step.request.path, httpx.Timeout(step.timeout)
        try:
            with self._http.stream("GET", url, timeout=timeout) as response:
                if response.status_code != 200:
                    return
                for chunk in response.iter_bytes():
                    if step.feed(chunk):
                        return
        except httpx.RequestError:
            # Listening is a convenience: the flow asks again, and a dead server shows then.
            return
