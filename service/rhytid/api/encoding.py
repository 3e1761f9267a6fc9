"""From arrays to response bodies: media types, ETags, conditional requests."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from fastapi import Request, Response
from fastapi.responses import StreamingResponse
from numpy.typing import NDArray
from starlette.exceptions import HTTPException

from rhytid import __version__
from rhytid.api.encoded_tiles import Asked, Known
from rhytid.api.request_memory import PIECE, RequestMemory
from rhytid.api.spool import Spool
from rhytid.api.written_files import WrittenFiles
from rhytid.device.figures import working_on
from rhytid.domain.methods import DISPLACEMENT, SLOPES
from rhytid.domain.warnings import InputWarning
from rhytid.engine.byte_budget import Hold
from rhytid.engine.changes import Mark
from rhytid.engine.messages import AssetContent, DrawnTile, FrameStretch, MapQuery, TileDescription
from rhytid.errors import QueryError
from rhytid.formats.tile_header import TileHeader
from rhytid.formats.tiles import FORMATS, OF_SLOPES, SLOPE_CHANNELS, Encoded, encode

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
Written = list[bytes | memoryview] | Iterator[bytes]
_UNKEPT = {"Cache-Control": "no-store"}
# A single range of bytes in a head.
_RANGE = re.compile(r"bytes=[ \t]*([0-9]{0,18})-([0-9]{0,18})[ \t]*", re.ASCII)


def check_format(format: str, layer: str = DISPLACEMENT) -> str:
    """The name itself; raises QueryError naming the known formats of a layer."""
    known = OF_SLOPES if layer == SLOPES else tuple(FORMATS)
    if format not in known:
        of = "" if layer == DISPLACEMENT else f" of the layer {layer}"
        raise QueryError(f"format {format!r}{of}: one of {', '.join(known)}")
    return format


def texel_bytes(query: MapQuery) -> int:
    """Bytes of a texel before it is encoded."""
    return TEXEL * (len(SLOPE_CHANNELS) if query.layer == SLOPES else 1)


def etag(*parts: object) -> str:
    """A strong entity tag over short values that determine the bytes."""
    return _quoted(hashlib.sha256(repr(parts).encode()))


def _quoted(digest: hashlib._Hash) -> str:
    return f'"{digest.hexdigest()[:32]}"'


def matches(if_none_match: str | None, tag: str) -> bool:
    """RFC 9110, section 13.1.2: a list of tags, weakly compared, or `*`."""
    tags = [t.strip() for t in (if_none_match or "").split(",")]
    return "*" in tags or any(t.removeprefix("W/") == tag for t in tags)


def answer(request: Request, drawing: Drawing, asked: Asked) -> Response:
    """The encoded displacement, 304 where the client has it, headers alone for HEAD. Raises what
    `made_answer` does."""
    kept = kept_answer(request, drawing, asked)
    return made_answer(request, drawing, asked) if kept is None else kept


def made_answer(request: Request, drawing: Drawing, asked: Asked) -> Response:
    """The answer where `kept_answer` has none.

    Only drawing takes a slot; raises BusyError, and what `RequestMemory.answer` does.
    """
    check_format(asked.format, asked.query.layer)
    if request.method == "HEAD" or "if-none-match" in request.headers:
        # Otherwise the key comes with the tile.
        mark = drawing.engine.mark(asked.asset, asked.frame)
        found = drawing.engine.tiles.describe(*asked[1:])
        short = _without_body(request, asked.format, *_noted(drawing, asked, found, mark))
        if short is not None:
            return short
    return _drawn(drawing, asked)


def kept_answer(request: Request, drawing: Drawing, asked: Asked) -> Response | None:
    """The answer where it is kept, or has no body, and nothing has changed since it was made. The
    engine is not called. Does not block."""
    known = drawing.encoded.known(asked, drawing.engine.mark(asked.asset, asked.frame))
    if known is None:
        return None
    known.mark.changes.use(asked.asset)  # else it might leave as one that rests
    short = _without_body(request, asked.format, known.validators, known.about)
    if short is not None:
        return short
    encoded = drawing.encoded.kept(known.validators["ETag"])
    if encoded is None or len(encoded.body) >= LARGE:
        return None
    if not drawing.memory.at_once(len(encoded.body)):
        return None
    drawing.metrics.tiles_of(asked.query.method).inc()
    return Response(encoded.body, headers=known.about, media_type=encoded.media_type)


def _without_body(
    request: Request, format: str, validators: Mapping[str, str], about: Mapping[str, str]
) -> Response | None:
    """The answer to HEAD, and 304 where the client has the tile."""
    if matches(request.headers.get("if-none-match"), validators["ETag"]):
        return Response(status_code=304, headers=validators)
    return bodiless(about, FORMATS[format].media_type) if request.method == "HEAD" else None


def _noted(
    drawing: Drawing, asked: Asked, found: TileDescription, mark: Mark | None
) -> tuple[dict[str, str], dict[str, str]]:
    """The headers of a tile, without and with a body, which are remembered.  mark: from before the
    engine was asked."""
    tag = etag(found.key, asked.format, found.header, __version__)
    validators = {"ETag": tag, "Cache-Control": "no-cache"}
    about = {**validators, **scale_header(asked.format, found.header)}
    if mark is not None:
        drawing.encoded.note(asked, Known(mark, validators, about))
    return validators, about


def _drawn(drawing: Drawing, asked: Asked) -> Response:
    """The answer with a body, drawn."""
    format, asset, frame, query, place = asked
    nbytes = texel_bytes(query) * drawing.engine.assets.dimensions(asset).grid.side_of(place) ** 2
    memory = drawing.memory
    with drawing.slot, memory.making(nbytes):
        hold = memory.answer(FORMATS[format].working * nbytes)
        mark = drawing.engine.mark(asset, frame)
        drawn = drawing.engine.tiles.draw(asset, frame, query, place)
        found = drawn.description
        # Where it was changed while it was drawn, these bytes may belong to either content. Another
        # mark tells of two changes, of which the second took the first back.
        same = mark is None or mark == drawing.engine.mark(asset, frame)
        # What takes no time to encode is kept from the second time on: the memory that fresh bytes
        # are written to costs more than it saves where each tile is asked for once.
        keeps = FORMATS[format].compressed or drawing.encoded.known(asked, mark) is not None
        if same and drawn.key == found.key:
            validators, about = _noted(drawing, asked, found, mark)
        else:
            validators, about = {}, {**_UNKEPT, **scale_header(format, found.header)}
        encoded = _encoded(drawing, drawn, format, validators.get("ETag") if keeps else None)
        del drawn
        hold.resize(len(encoded.body))
        file = memory.aside(encoded.body) if len(encoded.body) >= LARGE else None
    drawing.metrics.tiles_of(query.method).inc()
    return _sent(encoded, about, hold, file)


def _encoded(drawing: Drawing, drawn: DrawnTile, format: str, tag: str | None) -> Encoded:
    """An encoded tile.  tag: its ETag, by which other requests have it, too; None to keep it
    for nobody."""
    header = drawn.description.header

    def make() -> Encoded:
        with working_on(header.method), drawing.metrics.figures.stage("encode"):
            return encode(drawn.tile, format, header)

    return make() if tag is None else drawing.encoded.get(tag, make)


def _sent(encoded: Encoded, headers: Mapping[str, str], hold: Hold, file: Spool | None) -> Response:
    """An answer; a large one from disk, so that who does not read it holds no memory."""
    body, kind = encoded.body, encoded.media_type
    if file is None:
        return Response(body, headers=headers, media_type=kind)
    hold.release()
    about = {**headers, "Content-Length": str(len(body))}
    return StreamingResponse(file.pieces(PIECE), headers=about, media_type=kind)


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
    write: Callable[[], list[bytes | memoryview] | Iterator[bytes]],
    media_type: str,
    slot: AbstractContextManager[None],
    memory: RequestMemory,
    files: WrittenFiles | None,
) -> Response:
    """What is stored of an asset, written as `kind`; 304 where the client has it, 206 and 416 for a
    range of its bytes.

    content: what there is now.  write: the file in pieces, or its lines one after the other, whose
    length is not known before and of which no range is sent.  files: keep it for the next range;
    None where there are no ranges. Only writing, and waiting for another who writes the same, take
    a slot; raises BusyError, and what `RequestMemory.answer` and `WrittenFiles.opened` do.
    """
    wanted = content()
    headers = {"ETag": etag(wanted.key, kind, __version__), "Cache-Control": "no-cache"}
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    tag, nbytes = headers["ETag"], wanted.nbytes
    asked = None if files is None else _AskedRange.of_head(request, tag)
    kept_in = None if asked is None else files
    file = None if kept_in is None else kept_in.kept(tag)
    body: Written | None = None
    hold = memory.hold("answers", WORKING * nbytes)

    def written() -> list[bytes | memoryview] | None:
        """The pieces; None where they are of something else, since it was changed meanwhile."""
        nonlocal body
        hold.resize(WORKING * nbytes)
        body = write()
        return body if isinstance(body, list) and content().key == wanted.key else None

    if file is None:
        with slot:
            if kept_in is not None:
                file = kept_in.opened(tag, nbytes, written)
            if file is None and body is None:
                written()
    if file is not None:
        memory.closing(file)
        hold.resize(WORKING * min(PIECE, nbytes))
        part, status, about = _about_part(asked, file.nbytes, headers)
        return StreamingResponse(file.within(part, PIECE), status, about, media_type)
    assert body is not None
    if content().key != wanted.key:  # changed while it was written
        headers, asked = {"Cache-Control": "no-store"}, None
    if not isinstance(body, list):
        headers["Accept-Ranges"] = "none"
        return StreamingResponse(body, headers=headers, media_type=media_type)
    nbytes = sum(map(len, body))
    hold.resize(nbytes)
    part, status, about = _about_part(asked, nbytes, headers)
    return StreamingResponse(_within(body, part), status, about, media_type)


def _about_part(
    asked: _AskedRange | None, nbytes: int, headers: Mapping[str, str]
) -> tuple[range, int, dict[str, str]]:
    """The bytes to send of so many, with their status and headers; raises what `_AskedRange.of`
    does."""
    part = range(nbytes) if asked is None else asked.of(nbytes)
    about = {**headers, "Accept-Ranges": "bytes", "Content-Length": str(len(part))}
    if asked is None:
        return part, 200, about
    return part, 206, {**about, "Content-Range": f"bytes {part.start}-{part.stop - 1}/{nbytes}"}


class _AskedRange(NamedTuple):
    """A range of bytes as a head has it.  first: None for the last bytes, so many as `last` says.
    last: None for all to the end."""

    first: int | None
    last: int | None

    @classmethod
    def of_head(cls, request: Request, tag: str) -> _AskedRange | None:
        """None for all bytes, also where the head asks for several ranges, for none, or for a range
        of other bytes than `tag` names (RFC 9110, section 14)."""
        asked = _RANGE.fullmatch(request.headers.get("range", ""))
        if asked is None or request.headers.get("if-range", tag) != tag:
            return None
        first, last = (int(text) if text else None for text in asked.groups())
        nothing = last is None if first is None else last is not None and last < first
        return None if nothing else cls(first, last)

    def of(self, nbytes: int) -> range:
        """The bytes of so many; raises HTTPException, 416, where there are none."""
        first, last = self
        if first is None:
            found = range(max(nbytes - (last or 0), 0), nbytes)
        else:
            found = range(first, nbytes if last is None else min(last + 1, nbytes))
        if not found:
            headers = {"Content-Range": f"bytes */{nbytes}"}
            told = f"there are {nbytes} bytes, of which none are asked for"
            raise HTTPException(416, told, headers)
        return found


def _within(body: Sequence[bytes | memoryview], asked: range) -> Iterator[memoryview]:
    """The pieces of a body that lie in a range, cut to it."""
    start = 0
    for piece in body:
        cut = memoryview(piece)[max(asked.start - start, 0) : max(asked.stop - start, 0)]
        if len(cut):
            yield cut
        start += len(piece)
