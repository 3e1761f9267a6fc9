"""From arrays to response bodies: media types, ETags, conditional requests."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from fastapi import Request, Response
from fastapi.responses import StreamingResponse
from numpy.typing import NDArray

from rhytid import __version__
from rhytid.api.request_memory import PIECE, RequestMemory
from rhytid.api.spool import Spool
from rhytid.device.figures import working_on
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.domain.warnings import InputWarning
from rhytid.engine.byte_budget import Hold
from rhytid.engine.messages import AssetContent, DrawnTile, FrameStretch, MapQuery, TileDescription
from rhytid.errors import QueryError
from rhytid.formats.tile_header import TileHeader
from rhytid.formats.tiles import FORMATS, Encoded, encode

if TYPE_CHECKING:
    from rhytid.api.dependencies import Drawing

NPY = "application/x-npy"
RAW = "application/octet-stream"
# Bytes of a texel.
TEXEL = 4
# An array and what it is encoded to, over the array.
WORKING = 2
# Bytes of an answer from which on it is sent from disk.
LARGE = 32 << 20
SCALE = "X-Rhytid-Scale"
WARNINGS = "X-Rhytid-Warnings"


def check_format(format: str) -> str:
    """The name itself; raises QueryError naming the known formats."""
    if format not in FORMATS:
        raise QueryError(f"format {format!r}: one of {', '.join(FORMATS)}")
    return format


def etag(*parts: object) -> str:
    """A strong entity tag over short values that determine the bytes."""
    return _quoted(hashlib.sha256(repr(parts).encode()))


def _quoted(digest: hashlib._Hash) -> str:
    return f'"{digest.hexdigest()[:32]}"'


def matches(if_none_match: str | None, tag: str) -> bool:
    """RFC 9110, section 13.1.2: a list of tags, weakly compared, or `*`."""
    tags = [t.strip() for t in (if_none_match or "").split(",")]
    return "*" in tags or any(t.removeprefix("W/") == tag for t in tags)


def answer(
    request: Request,
    format: str,
    drawing: Drawing,
    asset: str,
    frame: str,
    query: MapQuery,
    place: TileAddress | MapAddress,
) -> Response:
    """The encoded displacement, 304 where the client has it, headers alone for HEAD.

    Only drawing takes a slot; raises BusyError, and what `RequestMemory.answer` does.
    """
    check_format(format)
    asked, headers_alone = request.headers.get("if-none-match"), request.method == "HEAD"
    # Otherwise the key comes with the tile.
    if asked is not None or headers_alone:
        known = drawing.engine.tiles.describe(asset, frame, query, place)
        validators = _validators(known, format)
        if matches(asked, validators["ETag"]):
            return Response(status_code=304, headers=validators)
        if headers_alone:
            about = {**validators, **scale_header(format, known.header)}
            return bodiless(about, FORMATS[format].media_type)
    nbytes = TEXEL * drawing.engine.assets.dimensions(asset).grid.side_of(place) ** 2
    memory = drawing.memory
    with drawing.slot, memory.making(nbytes):
        hold = memory.answer(FORMATS[format].working * nbytes)
        drawn = drawing.engine.tiles.draw(asset, frame, query, place)
        found, key = drawn.description, drawn.key
        # Where it was replaced while it was drawn, these bytes may belong to either content.
        tags = _validators(found, format) if key == found.key else {"Cache-Control": "no-store"}
        encoded = _encoded(drawing, drawn, format, tags.get("ETag"))
        del drawn
        hold.resize(len(encoded.body))
        file = memory.aside(encoded.body) if len(encoded.body) >= LARGE else None
    drawing.metrics.tiles_of(query.method).inc()
    about = {**tags, **scale_header(format, found.header)}
    return _sent(encoded, about, hold, file)


def _encoded(drawing: Drawing, drawn: DrawnTile, format: str, tag: str | None) -> Encoded:
    """An encoded tile.  tag: its ETag, by which other requests for it have it, too."""
    header = drawn.description.header

    def make() -> Encoded:
        with working_on(header.method), drawing.metrics.figures.stage("encode"):
            return encode(drawn.tile, format, header)

    if tag is None or not FORMATS[format].compressed:
        return make()
    return drawing.encoded.get(tag, make)


def _sent(encoded: Encoded, headers: Mapping[str, str], hold: Hold, file: Spool | None) -> Response:
    """An answer; a large one from disk, so that who does not read it holds no memory."""
    body, kind = encoded.body, encoded.media_type
    if file is None:
        return Response(body, headers=headers, media_type=kind)
    hold.release()
    about = {**headers, "Content-Length": str(len(body))}
    return StreamingResponse(file.pieces(PIECE), headers=about, media_type=kind)


def _validators(tile: TileDescription, format: str) -> dict[str, str]:
    tag = etag(tile.key, format, tile.header, __version__)
    return {"ETag": tag, "Cache-Control": "no-cache"}


def bodiless(headers: Mapping[str, str], media_type: str) -> Response:
    """An answer to HEAD that does not claim a length it has not computed."""
    response = Response(headers=headers, media_type=media_type)
    del response.headers["content-length"]
    return response


def scale_header(format: str, header: TileHeader) -> dict[str, str]:
    """`X-Rhytid-Scale` for png, whose 16 bit mean nothing without it."""
    return {SCALE: repr(float(header.scale))} if format == "png" else {}


def warnings_header(warnings: Sequence[InputWarning]) -> dict[str, str]:
    """`X-Rhytid-Warnings` where there are any, as a JSON list in ASCII."""
    listed = [asdict(warning) for warning in warnings]
    return {WARNINGS: json.dumps(listed)} if listed else {}


def npy(array: NDArray[Any]) -> bytes:
    """The array as a .npy file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def npz(stretch: FrameStretch) -> bytes:
    """`axes`, `ratios` and `folds` as an uncompressed .npz file."""
    file = io.BytesIO()
    np.savez(file, axes=stretch.axes, ratios=stretch.ratios, folds=stretch.folds)
    return file.getvalue()


def tagged(request: Request, body: bytes, media_type: str) -> Response:
    """A body with the ETag of its own bytes."""
    headers = {"ETag": _quoted(hashlib.sha256(body)), "Cache-Control": "no-cache"}
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    return Response(body, headers=headers, media_type=media_type)


def answer_stored(
    request: Request,
    kind: str,
    content: Callable[[], AssetContent],
    write: Callable[[], bytes | Iterable[bytes]],
    media_type: str,
    slot: AbstractContextManager[None],
    memory: RequestMemory,
) -> Response:
    """What is stored of an asset, written as `kind`; 304 where the client has it.

    content: what there is now.  write: the file, or its lines one after the other. Only writing
    takes a slot; raises BusyError, and what `RequestMemory.answer` does.
    """
    wanted = content()
    headers = {"ETag": etag(wanted.key, kind, __version__), "Cache-Control": "no-cache"}
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    with slot:
        hold = memory.answer(WORKING * wanted.nbytes)
        body = write()
    if content().key != wanted.key:  # changed while it was written
        headers = {"Cache-Control": "no-store"}
    if isinstance(body, bytes):
        hold.resize(len(body))
        return Response(body, headers=headers, media_type=media_type)
    return StreamingResponse(body, headers=headers, media_type=media_type)
