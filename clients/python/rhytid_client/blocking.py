"""What the blocking clients share: every call, run step by step over a transport."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from time import sleep
from types import MappingProxyType
from typing import Concatenate, ParamSpec, TypeVar

from numpy.typing import ArrayLike

from rhytid_client import calls
from rhytid_client.choices import LiveFormat, Method, Sampling, StretchModel
from rhytid_client.exchange import Flow, Listen, Step, patient
from rhytid_client.live.blocking import Live
from rhytid_client.live.messages import Address
from rhytid_client.live.opening import opening
from rhytid_client.methods import described
from rhytid_client.parse import Response
from rhytid_client.requests import Request
from rhytid_client.results import Asset

P = ParamSpec("P")
T = TypeVar("T")


def _method(call: Callable[P, Flow[T]]) -> Callable[Concatenate[BlockingClient, P], T]:
    def method(self: BlockingClient, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._run(call(*args, **kwargs))

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
    ) -> Live:
        """A live connection, opened by `with`: frames go out, tiles come in. Proxies and an httpx
        client of your own are not used for it. It needs the extra `live`.

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
        return Live(wanted)

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
