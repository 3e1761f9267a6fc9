"""What a live connection is opened with, and what the errors of its library mean."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from numpy.typing import ArrayLike

from rhytid_client.calls.asset_calls import asset_id
from rhytid_client.choices import LiveFormat, Method, Sampling, StretchModel
from rhytid_client.errors import ConnectionFailed, LiveClosed
from rhytid_client.live.messages import (
    PROTOCOL,
    Address,
    positions_message,
    view_message,
    weights_message,
)
from rhytid_client.methods import CONNECT_SECONDS
from rhytid_client.parse import Response, failure
from rhytid_client.requests import Request, path
from rhytid_client.results import Asset


@dataclass(frozen=True)
class LiveOpening:
    """Where to connect, and the header to send."""

    url: str
    call: Request
    headers: Mapping[str, str]
    header: str

    @property
    def options(self) -> dict[str, Any]:
        """For `connect` of the library. Proxies are not used."""
        return {
            "additional_headers": dict(self.headers),
            "subprotocols": [PROTOCOL],
            "compression": None,
            "max_size": None,
            "open_timeout": CONNECT_SECONDS,
            "close_timeout": CONNECT_SECONDS,
            "proxy": None,
        }


@dataclass(frozen=True)
class LiveRequest:
    """A connection that is wanted of some server."""

    call: Request
    header: str

    def to(self, url: str, headers: Mapping[str, str]) -> LiveOpening:
        """Of the server at an address; raises ValueError for one that is not of http."""
        scheme, _, place = url.rstrip("/").partition("://")
        if scheme not in ("http", "https"):
            raise ValueError(f"{url!r} is no address of http or https")
        socket = f"{'wss' if scheme == 'https' else 'ws'}://{place}{self.call.path}"
        return LiveOpening(socket, self.call, headers, self.header)


def live(
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
) -> LiveRequest:
    """A live connection, opened by `with`, or of an `AsyncClient` by `async with`: frames go out,
    tiles come in. Proxies and an httpx client of your own are not used for it. It needs the extra
    `live`.

    tiles: (udim, level, row, column) each.  camera: (4, 4) projection times view, in place of
    tiles: what it sees of one `level`; `two_sided` counts what turns its back, too.  format: how
    tiles travel: f32, f16, or u16, of which `scale` is the largest displacement.  tolerance: mesh
    units that a tile has to change by to be sent again.  shapes: names of the weights that will be
    sent, such as those of ARKit; empty = the asset's own, in its order.
    """
    call = Request("WS", path("v1", "assets", asset_id(asset), "live"))
    header: dict[str, Any] = {
        "method": method,
        "stretch": stretch,
        "sampling": sampling,
        "format": format,
        "tolerance": tolerance,
        "shapes": list(shapes),
    }
    if scale is not None:
        header["scale"] = scale
    return LiveRequest(call, view_message(tiles, camera, level, two_sided, **header))


class FrameCounter:
    """Gives frames their numbers, which must grow."""

    def __init__(self) -> None:
        self._last = -1

    def message(
        self,
        shapes: Sequence[str],
        positions: ArrayLike | None,
        weights: ArrayLike | Mapping[str, float] | None,
        frame: int | None,
    ) -> tuple[int, bytes]:
        """The number of a frame, the next one where none is given, and the message with it.

        Raises ValueError for a number that does not grow, unless there is one of positions and
        weights, and as the messages do.
        """
        number = self._last + 1 if frame is None else frame
        if number <= self._last:
            raise ValueError(f"frame {number} after frame {self._last}: numbers must grow")
        if (positions is None) == (weights is None):
            raise ValueError("give either positions or weights")
        if positions is not None:
            message = positions_message(number, positions)
        else:
            assert weights is not None
            message = weights_message(number, weights, shapes)
        self._last = number
        return number, message


def library(name: str) -> ModuleType:
    """A module of the library `websockets`; raises ImportError naming the extra that brings it."""
    try:
        return import_module(f"websockets.{name}")
    except ImportError as exc:
        how = "in a clone of rhytid: pip install './clients/python[live]'"
        raise ImportError(f"live connections need websockets; {how}") from exc


@contextmanager
def translated(call: Request) -> Iterator[None]:
    """Errors of the library as ours: what the server refused, how it closed, that it is gone."""
    errors = library("exceptions")
    try:
        yield
    except errors.InvalidStatus as exc:
        answer = exc.response
        headers = {name.lower(): value for name, value in answer.headers.raw_items()}
        came = Response(call, answer.status_code, headers, bytes(answer.body or b""))
        raise failure(came) from exc
    except errors.ConnectionClosed as exc:
        end = exc.rcvd or exc.sent
        code, reason = (1006, "") if end is None else (end.code, end.reason)
        raise LiveClosed(code, reason, str(call)) from exc
    except (errors.WebSocketException, OSError, EOFError) as exc:
        raise ConnectionFailed(f"{type(exc).__name__}: {exc} [{call}]") from exc
