"""What the blocking clients share: every call, run step by step over a transport."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import sleep
from types import MappingProxyType
from typing import Concatenate, ParamSpec, TypeVar

from rhytid_client import calls
from rhytid_client.exchange import Flow, Listen, Step, patient
from rhytid_client.live import opening
from rhytid_client.live.blocking import Live
from rhytid_client.live.opening import LiveRequest
from rhytid_client.methods import described
from rhytid_client.parse import Response
from rhytid_client.requests import Request

P = ParamSpec("P")
T = TypeVar("T")


def _method(call: Callable[P, Flow[T]]) -> Callable[Concatenate[BlockingClient, P], T]:
    def method(self: BlockingClient, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._run(call(*args, **kwargs))

    return described(method, call)


def _live(call: Callable[P, LiveRequest]) -> Callable[Concatenate[BlockingClient, P], Live]:
    def method(self: BlockingClient, /, *args: P.args, **kwargs: P.kwargs) -> Live:
        return Live(call(*args, **kwargs).to(self._url, self._headers))

    return described(method, call)


class BlockingClient:
    """The calls of the service; a subclass sends requests and listens to streams.

    url: the server's address.  max_wait: seconds that a call may spend asking again while the
    server is busy or the asset is building.
    """

    _headers: Mapping[str, str] = MappingProxyType({})

    def __init__(self, url: str, max_wait: float) -> None:
        self._url = url.rstrip("/")
        self._max_wait = max_wait

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
        """The answer of any status; raises ConnectionFailed."""
        raise NotImplementedError

    def _listen(self, step: Listen) -> None:
        """Hand the chunks of a stream to `step.feed`; a stream that fails is no error."""
        raise NotImplementedError
