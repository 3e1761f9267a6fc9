"""The messages of a live connection and the codes that it is closed with, which docs/live.md
describes."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, StrictBool, ValidationError, model_validator

from rhytid.api.problems import fault_at
from rhytid.api.uploads import decode_json
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery
from rhytid.errors import LimitError, QueryError, SettingsError
from rhytid.formats.tile_header import TileHeader
from rhytid.formats.tiles import half_tile, quantise

# The subprotocol: another version of the format has another name.
PROTOCOL = "rhytid.live.1"
MOST_TILES, MOST_SHAPES = 1024, 1024
# number, kind, count
FRAME = struct.Struct("<QII")
POSITIONS, WEIGHTS = 1, 2
# number, udim, level, row, column, side, codes, 0, dropped, scale
TILE = struct.Struct("<QIIIIIHHIf")
CODES = {"f32": 1, "f16": 2, "u16": 3}
_MOST_COUNT = 2**32 - 1

# Why a connection is closed, for clients to act on. Codes of RFC 6455; the server sends 1009 and
# 1012 by itself: a message above its limit, and its end.
INTERNAL = 1011
LATER = 1013
# Ours, near the status of HTTP that says the same.
BAD_MESSAGE = 4400
GONE = 4404
IDLE = 4408
ORDER = 4409
TOO_LARGE = 4413
# A close frame holds so many bytes, two of which are the code.
_LONGEST = 123
CLOSE_CODES = {
    1000: "the client is done",
    1001: "the client goes away",
    1009: "a message is larger than 1 MiB and than a frame of the asset, or than 16 MiB",
    INTERNAL: "the server failed, or a ping was not answered within 20 seconds",
    1012: "the server ends",
    LATER: "others hold the memory, or the device restarts; try again",
    BAD_MESSAGE: "a header, a view or a frame that is not as it must be; the reason names what",
    GONE: "the asset was deleted, or what was asked of it is not there",
    IDLE: "no header within 10 seconds, or nothing at all for 5 minutes",
    ORDER: "a frame number that is not larger than the one before",
    TOO_LARGE: "more tiles, texels or memory than one connection may have",
}

_Whole = Annotated[int, Field(ge=0, lt=2**31, strict=True)]
_Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]
_Four = Annotated[list[_Number], Field(min_length=4, max_length=4)]
_Name = Annotated[str, Field(min_length=1, max_length=256)]


class LiveClosed(Exception):
    """Ends the connection.  code: one of `CLOSE_CODES`.  reason: the cause in words, for the
    client."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code

    @property
    def reason(self) -> str:
        """As much of the reason as a close frame holds."""
        return str(self).encode()[:_LONGEST].decode(errors="ignore")


class Camera(BaseModel):
    """A camera, for the tiles of one level that it sees."""

    model_config = ConfigDict(extra="forbid")

    matrix: list[_Four] = Field(min_length=4, max_length=4)
    level: _Whole = 0
    two_sided: StrictBool = False


class View(BaseModel):
    """The tiles that the client wants: a list, or those that a camera sees."""

    model_config = ConfigDict(extra="forbid")

    message: Literal["view"]
    tiles: list[tuple[_Whole, _Whole, _Whole, _Whole]] | None = Field(
        None, min_length=1, max_length=MOST_TILES
    )
    camera: Camera | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Any:
        if (self.tiles is None) == (self.camera is None):
            raise ValueError("must have either tiles or camera")
        if self.tiles is not None and len(set(self.tiles)) < len(self.tiles):
            raise ValueError("tiles names a tile twice")
        return self

    def addresses(self) -> list[TileAddress]:
        """Addresses of the listed tiles."""
        return [TileAddress(*tile) for tile in self.tiles or ()]


class Opening(View):
    """The header, which is the first message of a client."""

    message: Literal["open"]  # type: ignore[assignment]
    method: str = "redraw"
    stretch: str = "tensor"
    sampling: str = "nearest"
    format: Literal["f32", "f16", "u16"] = "f32"
    scale: Annotated[_Number, Field(gt=0)] | None = None
    tolerance: Annotated[_Number, Field(ge=0)] = 0.0
    shapes: list[_Name] = Field([], max_length=MOST_SHAPES)

    def query(self) -> MapQuery:
        """Return the query for the engine; raises QueryError naming the known values."""
        return MapQuery(self.method, self.stretch, self.sampling)


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A frame as the client sent it.  content: little-endian float32, positions or weights."""

    number: int
    kind: int
    content: bytes


def largest_message(vertices: int) -> int:
    """Return the most bytes of a message for an asset of so many vertices. It is at least a MiB:
    what is wrong with a message can be said once it is read."""
    return max(1 << 20, FRAME.size + 12 * vertices)


def read_opening(text: str) -> Opening:
    """Read the header; raises LiveClosed naming what is wrong with it."""
    opening: Opening = _read(Opening, text, "header")
    try:
        opening.query()
    except QueryError as error:
        raise LiveClosed(BAD_MESSAGE, f"header: {error}") from error
    if opening.scale is not None and opening.format != "u16":
        raise LiveClosed(BAD_MESSAGE, "header: scale is of the format u16 alone")
    return opening


def read_view(text: str) -> View:
    """Read a changed view; raises LiveClosed naming what is wrong with it."""
    view: View = _read(View, text, "view")
    return view


def read_frame(message: bytes, after: int, vertices: int, weights: int) -> LiveFrame:
    """Read a frame, whose number must be larger than `after`; raises LiveClosed.

    vertices: number of vertices of the asset.  weights: number of weights that the header
    announced, 0 where the asset has no named shapes.
    """
    if len(message) < FRAME.size:
        raise LiveClosed(BAD_MESSAGE, f"frame of {len(message)} bytes: its header has {FRAME.size}")
    number, kind, count = FRAME.unpack_from(message)
    if number <= after:
        raise LiveClosed(ORDER, f"frame {number} came after frame {after}: numbers must grow")
    if kind not in (POSITIONS, WEIGHTS):
        raise LiveClosed(BAD_MESSAGE, f"frame {number} is of kind {kind}: must be 1 or 2")
    if kind == WEIGHTS and not weights:
        raise LiveClosed(BAD_MESSAGE, f"frame {number} has weights, the asset no named shapes")
    wanted = vertices if kind == POSITIONS else weights
    if count != wanted:
        what = "vertices" if kind == POSITIONS else "weights"
        why = "" if kind == POSITIONS else ", or name yours as shapes in the header"
        raise LiveClosed(BAD_MESSAGE, f"frame {number} has {count} {what}: must be {wanted}{why}")
    nbytes = (12 if kind == POSITIONS else 4) * count
    if len(message) != FRAME.size + nbytes:
        raise LiveClosed(
            BAD_MESSAGE,
            f"frame {number} has {len(message) - FRAME.size} bytes of numbers: must be {nbytes}",
        )
    return LiveFrame(number, kind, message[FRAME.size :])


def tile_message(
    number: int,
    tile: NDArray[Any],
    header: TileHeader,
    format: str,
    scale: float,
    dropped: int,
) -> bytes:
    """Return the message with one tile of float32, or of half floats where these are sent; raises
    QueryError where half floats cannot hold it.

    dropped: frames that were replaced by newer ones since the last answer.
    """
    head = TILE.pack(
        number, header.udim, header.level, header.row, header.column, len(tile), CODES[format], 0,
        min(dropped, _MOST_COUNT), scale,
    )  # fmt: skip
    codes: NDArray[Any]
    if format == "f16":
        codes = tile if tile.dtype == np.float16 else half_tile(tile)
    elif format == "u16":
        codes = quantise(tile, scale).astype("<u2", copy=False)
    else:
        codes = np.ascontiguousarray(tile, "<f4")
    return b"".join((head, codes.data))


def _read(kind: type[BaseModel], text: str, what: str) -> Any:
    try:
        return kind.model_validate(decode_json(text.encode(), what))
    except (SettingsError, LimitError) as error:
        raise LiveClosed(BAD_MESSAGE, str(error)) from error
    except ValidationError as error:
        raise LiveClosed(BAD_MESSAGE, f"{what}: {_fault(error.errors()[0])}") from error


def _fault(fault: Mapping[str, Any]) -> str:
    """What is wrong and where, as problems of HTTP say it."""
    place = ".".join(str(step) for step in fault["loc"])
    if fault["type"] == "value_error":  # one of ours
        return str(fault["ctx"]["error"])
    if not place:
        return "must be a JSON object"
    return fault_at(f"key {place}" if fault["type"] == "extra_forbidden" else place, fault)
