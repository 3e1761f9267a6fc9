"""Requests as plain values: building one sends nothing."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from rhytid_client import npy
from rhytid_client.file_body import FileBody
from rhytid_client.multipart_form import Form

NPY = "application/x-npy"
RAW = "application/octet-stream"
# Positions this many times their own size away from the origin are sent as doubles.
FAR_SIZES = 16.0
Params = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Request:
    """What to send; `path` starts with a slash and goes behind the server's address.

    into: where the body of a success is written, piece by piece, in place of the answer.
    """

    method: str
    path: str
    params: Params = ()
    headers: Mapping[str, str] = field(default_factory=dict)
    content: bytes | Form | FileBody | None = None
    into: Path | None = None

    def __str__(self) -> str:
        return f"{self.method} {self.path}"


def with_key(key: str | None) -> dict[str, str]:
    """The header that shows an API key; a file that it was read from may end in a new line."""
    return {} if not key else {"Authorization": f"Bearer {key.strip()}"}


def request(
    method: str,
    *segments: str | int,
    params: Mapping[str, str | int] | Params = (),
    headers: Mapping[str, str] | None = None,
    content: bytes | Form | FileBody | None = None,
) -> Request:
    """A request of a path made of `segments`; none of them can leave its place in the path."""
    pairs = params.items() if isinstance(params, Mapping) else params
    sent = dict(headers or {})
    if isinstance(content, Form | FileBody):
        sent.update(content.headers())
    strings = tuple((name, str(value)) for name, value in pairs)
    return Request(method, path(*segments), strings, sent, content)


def get(
    *segments: str | int,
    params: Mapping[str, str | int] | Params = (),
    headers: Mapping[str, str] | None = None,
) -> Request:
    """A GET."""
    return request("GET", *segments, params=params, headers=headers)


def with_json(method: str, *segments: str, value: Any) -> Request:
    """A request with a JSON body."""
    body = json.dumps(value, allow_nan=False).encode()
    return request(method, *segments, headers={"Content-Type": "application/json"}, content=body)


def with_positions(
    method: str, *segments: str, positions: ArrayLike, raw: bool = False, params: Params = ()
) -> Request:
    """A request with (V, 3) positions as .npy, or as raw little-endian float32.

    Of .npy, doubles far from the origin stay doubles. Raises ValueError for another shape.
    """
    array = np.ascontiguousarray(positions, dtype="<f8" if _far(positions, raw) else "<f4")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"positions have shape {array.shape}, not (V, 3)")
    body = array.tobytes() if raw else npy.encode(array)
    kind = {"Content-Type": RAW if raw else NPY}
    return request(method, *segments, params=params, headers=kind, content=body)


def _far(positions: ArrayLike, raw: bool) -> bool:
    """Whether positions are doubles of which float32 would lose too much: where the server brings
    them to the origin."""
    array = np.asarray(positions)
    if raw or array.dtype != np.float64 or array.ndim != 2 or not len(array):
        return False
    low, high = array.min(axis=0), array.max(axis=0)
    farthest = np.maximum(np.abs(low), np.abs(high)).max()
    return bool(farthest > FAR_SIZES * (high - low).max())


def path(*segments: str | int) -> str:
    """Segments as a path; raises ValueError for one that would mean another place."""
    return "".join("/" + _segment(str(segment)) for segment in segments)


def _segment(text: str) -> str:
    if text in ("", ".", ".."):
        raise ValueError(f"{text!r} is not a name")
    return quote(text, safe="")
