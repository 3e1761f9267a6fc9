"""The server: one client, its errors in words, and the calls that are more than one request."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from urllib.parse import urlsplit

import bpy
import numpy as np

from rhytid_client import (
    BadAnswer,
    ConnectionFailed,
    NotAllowed,
    NotFound,
    PlainClient,
    ProblemError,
    RhytidError,
    RhytidWarning,
)

from .preferences import preferences
from .state import SESSION
from .words import Trouble, no_answer

CONNECT_SECONDS = 3.0
WAIT_SECONDS = 30.0
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


@contextmanager
def server() -> Iterator[PlainClient]:
    """A client; what goes wrong with it is raised as Trouble."""
    url, key = preferences().server.strip(), preferences().key.strip()
    try:
        _permitted(url)
        client = PlainClient(url, key=key, connect=CONNECT_SECONDS, max_wait=WAIT_SECONDS)
        with warnings.catch_warnings():
            # They come with the results, too, from where the panel shows them.
            warnings.simplefilter("ignore", RhytidWarning)
            yield client
    except ConnectionFailed as exc:
        raise Trouble(no_answer(url, exc.__cause__)) from exc
    except (RhytidError, ValueError) as exc:
        raise Trouble(_words(exc, url)) from exc


def _permitted(url: str) -> None:
    if urlsplit(url).hostname not in _LOOPBACK and not bpy.app.online_access:
        raise Trouble(
            f"{url} is another machine, and Blender may not go online: allow it in Preferences, "
            "System, Network"
        )


def _words(exc: Exception, url: str) -> str:
    if isinstance(exc, BadAnswer):
        return f"{url} answers, but not as a rhytid server does: {exc}"
    if isinstance(exc, NotFound):
        return f"The server does not have it: {exc.detail}. Send the mesh again"
    if isinstance(exc, NotAllowed):
        return f"The server refuses the key ({exc.status}): {exc.detail}"
    if isinstance(exc, ProblemError):
        return exc.detail or str(exc)
    return str(exc)


def tested() -> str:
    """What the server computes on, in words; raises Trouble."""
    with server() as client:
        if not client.ready():
            raise Trouble("The server answers, but its device does not compute")
        used = [device.name for device in client.devices() if device.selected]
    return f"Connected: {used[0] if used else 'device unknown'}"


def drawn(
    asset: str, who: str, positions: np.ndarray, udims: list[int], query: dict[str, str]
) -> tuple[dict[int, bytes], tuple[str, ...]]:
    """The maps of positions (V, 3) as files by UDIM, and warnings; raises Trouble."""
    frame = f"blender-{SESSION}-{who}"
    with server() as client:
        stored = client.put_frame(asset, frame, positions)
        try:
            maps = {udim: client.map(asset, frame, udim, **query).content for udim in udims}
        finally:
            with suppress(RhytidError):
                client.delete_frame(asset, frame)
    return {udim: bytes(data) for udim, data in maps.items()}, tuple(map(str, stored.warnings))
