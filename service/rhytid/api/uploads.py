"""Reads request bodies: never more than the limit, and every byte is checked."""

from __future__ import annotations

import io
import json
from collections.abc import AsyncIterator, Iterable
from typing import Any

from fastapi import Request
from starlette.exceptions import HTTPException

from rhytid.api.accept import OCTETS
from rhytid.api.multipart import Part, PartReader, boundary
from rhytid.api.request_memory import DECODED, RequestMemory
from rhytid.api.spool import Spool
from rhytid.engine.byte_budget import Hold
from rhytid.errors import InputError, LimitError, SettingsError
from rhytid.formats.frames import NPY
from rhytid.support.settings import ServiceSettings

JSON_LIMIT = 1 << 16
# A frame in its widest form: three float64 per vertex after the header of a .npy file.
WIDEST_VERTEX = 24
HEADER_ROOM = 1 << 16
TAR = "application/x-tar"
# Letters of a media type that an error repeats.
_SHOWN = 80
JSON_TYPES = ("application/json", "application/merge-patch+json")


async def read_frame(request: Request, vertices: int) -> bytes:
    """The body with one frame of that many vertices; 415 for any media type but these of positions.

    Raises LimitError where it is larger, HostBusyError where other requests hold the memory.
    """
    _check_type(request, NPY, OCTETS)
    largest = min(WIDEST_VERTEX * vertices + HEADER_ROOM, _limit(request))
    most = DECODED * min(largest, _declared(request) or largest)
    hold = RequestMemory.of(request).hold("uploads", most)
    return await _body(request, largest, hold)


async def read_parts(request: Request) -> dict[str, Part]:
    """The parts of a multipart/form-data body by name.

    Their bytes are on disk until the request ends, but for the last MiB. Raises LimitError above
    `upload_limit`, InputError naming the part that is wrong, and what `Spool.settle` does.
    """
    spool = RequestMemory.of(request).spooled()
    reader = PartReader(boundary(request.headers.get("content-type", "")), spool)
    async for chunk in _chunks(request, _limit(request)):
        reader.feed(chunk)
        await spool.settle()
    return reader.finish()


async def read_snapshot(request: Request) -> Spool:
    """The body with a snapshot, on disk until the request ends; 415 for any other media type.

    Raises LimitError above `upload_limit`, and what `Spool.settle` does.
    """
    _check_type(request, TAR, OCTETS)
    spool = RequestMemory.of(request).spooled()
    async for chunk in _chunks(request, _limit(request)):
        spool.write(chunk)
        await spool.settle()
    return spool


async def read_json(request: Request) -> Any:
    """The decoded JSON body of at most 64 KiB."""
    _check_type(request, *JSON_TYPES)
    return decode_json(await _body(request, JSON_LIMIT), "body")


def _check_type(request: Request, *known: str) -> None:
    media_type = media_type_of(request)
    if media_type not in known:
        told = repr(media_type[:_SHOWN]) if media_type else "missing"
        raise HTTPException(415, f"Content-Type is {told}: one of {', '.join(known)}")


def media_type_of(request: Request) -> str:
    """Content-Type without its parameters, in lower case; empty where the request has none."""
    return request.headers.get("content-type", "").split(";")[0].strip().lower()


def decode_json(data: bytes, what: str) -> Any:
    """Strict JSON: UTF-8, no key twice, no NaN, at most 64 KiB; raises naming `what`."""
    if len(data) > JSON_LIMIT:
        raise LimitError(f"{what} has {len(data)} bytes: at most {JSON_LIMIT}")
    try:
        text = data.decode("utf-8-sig")
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_no_constant)
    except UnicodeDecodeError as error:
        raise SettingsError(f"{what} is not UTF-8 at byte {error.start}") from error
    except RecursionError as error:
        raise SettingsError(f"{what} is JSON nested too deeply") from error
    except ValueError as error:
        raise SettingsError(f"{what} is not JSON: {error}") from error


async def _body(request: Request, limit: int, hold: Hold | None = None) -> bytes:
    # Unlike a list of chunks that are joined, the bytes are in memory once.
    body = io.BytesIO()
    async for chunk in _chunks(request, limit):
        if hold is not None:
            await hold.grow_async(DECODED * len(chunk))
        body.write(chunk)
    return body.getvalue()


async def _chunks(request: Request, limit: int) -> AsyncIterator[bytes]:
    declared = _declared(request)
    if declared is not None and declared > limit:
        raise LimitError(f"body has {declared} bytes: at most {limit}")
    total = 0
    async for chunk in request.stream():
        total += len(chunk)
        if total > limit:
            raise LimitError(f"body has more than {total - 1} bytes: at most {limit}")
        yield chunk


def _declared(request: Request) -> int | None:
    """Bytes of the body, by its head; None where that does not say."""
    declared = request.headers.get("content-length", "")
    return int(declared[:20]) if declared.isascii() and declared.isdigit() else None


def _limit(request: Request) -> int:
    settings: ServiceSettings = request.app.state.settings
    return settings.upload_limit


def _unique(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise SettingsError(f"key {key!r} occurs twice in one object")
        found[key] = value
    return found


def _no_constant(name: str) -> Any:
    raise SettingsError(f"{name} is not a JSON number")


def require(parts: dict[str, Part], name: str) -> Part:
    """The part of that name; raises InputError where it is absent."""
    if name not in parts:
        raise InputError(f"part {name} is missing; parts here: {', '.join(parts) or 'none'}")
    return parts[name]
