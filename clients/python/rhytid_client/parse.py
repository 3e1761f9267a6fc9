"""From a status, headers and bytes to a result or an error: nothing here sends or waits."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from email.utils import parsedate_to_datetime
from time import time
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid_client import npy
from rhytid_client.errors import (
    BadAnswer,
    Conflict,
    NotAllowed,
    NotFound,
    NotReady,
    ProblemError,
    RequestError,
    ServerBusy,
    ServerError,
    TooLarge,
    TooMany,
)
from rhytid_client.requests import Request
from rhytid_client.results import InputWarning, Notice
from rhytid_client.tiles import Tile

T = TypeVar("T")
SCALE = "x-rhytid-scale"
WARNINGS = "x-rhytid-warnings"

_KNOWN: dict[int, type[ProblemError]] = {
    401: NotAllowed,
    403: NotAllowed,
    404: NotFound,
    409: Conflict,
    413: TooLarge,
    429: TooMany,
}


@dataclass(frozen=True)
class Response:
    """What came back; the names of `headers` are in lower case."""

    request: Request
    status: int
    headers: Mapping[str, str]
    content: bytes

    @property
    def retry_after(self) -> float | None:
        """Seconds until the server wants to be asked again, or None where it does not say."""
        text = self.headers.get("retry-after", "").strip()
        if text.isascii() and text.isdigit():
            return float(text)
        try:
            return max(parsedate_to_datetime(text).timestamp() - time(), 0.0) if text else None
        except ValueError:
            return None


def content(response: Response) -> bytes:
    """The body of a success; raises the error that any other status means."""
    if 200 <= response.status < 300:
        return response.content
    raise failure(response)


def failure(response: Response) -> ProblemError | BadAnswer:
    """The error for a status that is not a success, read from its problem details."""
    return _failure(response.status, _problem(response), response.request, response.retry_after)


def refusal(problem: Mapping[str, Any], request: Request) -> ProblemError | BadAnswer:
    """The error for a problem that came as a message, with its status and when to try again."""
    status, retry_after = problem.get("status"), problem.get("retry_after")
    comes_back = float(retry_after) if isinstance(retry_after, int | float) else None
    return _failure(status if isinstance(status, int) else 0, problem, request, comes_back)


def _failure(
    status: int, problem: Mapping[str, Any], request: Request, retry_after: float | None
) -> ProblemError | BadAnswer:
    kind = _kind(status, retry_after is not None)
    if kind is None:
        return BadAnswer(f"status {status} was not expected [{request}]")
    warned = problem.get("warnings")
    return kind(
        status,
        str(problem.get("title", "")),
        str(problem.get("detail", "")),
        str(problem.get("type", "about:blank")),
        str(request),
        retry_after,
        input_warnings(warned) if isinstance(warned, list) else (),
        str(problem.get("request_id", "")),
    )


def _kind(status: int, comes_back: bool) -> type[ProblemError] | None:
    if status == 409 and comes_back:
        return NotReady
    if status == 503 and comes_back:
        return ServerBusy
    classes: dict[int, type[ProblemError]] = {4: RequestError, 5: ServerError}
    return _KNOWN.get(status, classes.get(status // 100))


def _problem(response: Response) -> Mapping[str, Any]:
    """The problem details; a body that is none (a proxy's page) is quoted in their place."""
    try:
        problem = json.loads(response.content)
    except (ValueError, RecursionError):
        problem = None
    if isinstance(problem, dict) and "title" in problem:
        return problem
    return {"title": "Error", "detail": response.content[:200].decode("utf-8", "replace")}


def value(response: Response) -> Any:
    """The decoded JSON of a success."""
    try:
        return json.loads(content(response))
    except (ValueError, RecursionError) as exc:
        raise BadAnswer(f"the answer is not JSON: {exc} [{response.request}]") from exc


def one(kind: type[T], response: Response) -> T:
    """The dataclass `kind` from a JSON object."""
    return read(kind, value(response))


def many(kind: type[T], response: Response) -> list[T]:
    """Dataclasses `kind` from a JSON list of objects."""
    items = value(response)
    if not isinstance(items, list):
        raise BadAnswer(f"the answer is not a list [{response.request}]")
    return [read(kind, item) for item in items]


def read(kind: type[T], data: Any) -> T:
    """The dataclass `kind` from decoded JSON; extra keys are ignored, lists become tuples."""
    if not isinstance(data, dict):
        raise BadAnswer(f"{kind.__name__}: expected an object, not {data!r:.80}")
    declared = fields(kind)  # type: ignore[arg-type]
    for field in declared:
        needed = field.default is MISSING and field.default_factory is MISSING
        if needed and field.name not in data:
            raise BadAnswer(f"{kind.__name__}: the answer has no {field.name!r}")
    known = {f.name: _frozen(data[f.name]) for f in declared if f.name in data}
    if "warnings" in known:
        known["warnings"] = input_warnings(known["warnings"])
    if "notices" in known:
        known["notices"] = listed(Notice, known["notices"], "notices")
    return kind(**known)


def input_warnings(found: Any) -> tuple[InputWarning, ...]:
    """The warnings of a decoded answer."""
    return listed(InputWarning, found, "warnings")


def listed(kind: type[T], found: Any, name: str) -> tuple[T, ...]:
    """Dataclasses `kind` from a decoded list that an answer calls `name`."""
    if not isinstance(found, (tuple, list)):
        raise BadAnswer(f"{name}: expected a list, not {found!r:.80}")
    return tuple(read(kind, one) for one in found)


def header_warnings(response: Response) -> tuple[InputWarning, ...]:
    """The warnings of an answer that is no JSON."""
    text = response.headers.get(WARNINGS, "[]")
    try:
        return input_warnings(json.loads(text))
    except (ValueError, RecursionError) as exc:
        raise BadAnswer(f"{WARNINGS} is not JSON: {exc} [{response.request}]") from exc


def _frozen(item: Any) -> Any:
    if isinstance(item, list):
        return tuple(_frozen(entry) for entry in item)
    return {k: _frozen(v) for k, v in item.items()} if isinstance(item, dict) else item


def tile(response: Response, format: str) -> Tile:
    """A tile or a map in `format`."""
    return read_tile(content(response), response.headers, format)


def read_tile(data: bytes | memoryview, headers: Mapping[str, str], format: str) -> Tile:
    """The same from the headers and content of an answer or of a part of one."""
    scale = headers.get(SCALE)
    try:
        known = None if scale is None else float(scale)
    except ValueError as exc:
        raise BadAnswer(f"{SCALE} is {scale!r}: not a number") from exc
    return Tile(format, data, headers.get("etag"), known, _values(data, format))


def _values(data: bytes | memoryview, format: str) -> NDArray[Any] | None:
    if format == "npy":
        return npy.decode(data)
    return half(data) if format == "f16" else None


def half(data: bytes | memoryview) -> NDArray[np.float16]:
    """A square of raw little-endian float16, read-only; raises BadAnswer for another count."""
    side = math.isqrt(len(data) // 2)
    if 2 * side * side != len(data):
        raise BadAnswer(f"{len(data)} bytes are not a square of float16")
    return np.frombuffer(data, "<f2").reshape(side, side)
