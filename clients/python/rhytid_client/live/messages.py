"""The messages of a live connection as plain values: nothing here sends or waits."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid_client.errors import BadAnswer
from rhytid_client.parse import read, refusal
from rhytid_client.requests import Request

PROTOCOL = "rhytid.live.1"
# number, kind, count
_FRAME = struct.Struct("<QII")
_POSITIONS, _WEIGHTS = 1, 2
# number, udim, level, row, column, side, codes, 0, dropped, scale
_TILE = struct.Struct("<QIIIIIHHIf")
_CODES: dict[int, np.dtype[Any]] = {1: np.dtype("<f4"), 2: np.dtype("<f2"), 3: np.dtype("<u2")}
_F16, _U16 = 2, 3
_OTHERS = "open it with shapes=[…], the names of your weights, to send others"
# udim, level, row, column
Address = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class LiveTile:
    """One tile of one frame.

    array: (n, n) float32 displacement in mesh units, row 0 at the top.  dropped: frames that were
    sent before this one and not drawn.
    """

    frame: int
    udim: int
    level: int
    row: int
    column: int
    array: NDArray[np.float32]
    dropped: int = 0

    @property
    def address(self) -> Address:
        """udim, level, row and column."""
        return self.udim, self.level, self.row, self.column


@dataclass(frozen=True)
class LiveAnswer:
    """What became of a frame.

    sent: tiles that came.  unchanged: tiles that did not, because they changed too little.
    dropped: frames before it that were not drawn.  seconds: from the start of drawing to its end.
    """

    frame: int
    sent: int = 0
    unchanged: int = 0
    dropped: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class LiveAsset:
    """What the server said of the asset.

    shapes: the order of weights, empty where it has no named shapes.  unknown: those of these names
    that mean none of its shapes.
    """

    asset: str
    vertices: int
    udims: tuple[int, ...] = ()
    levels: int = 0
    resolution: int = 0
    tile_size: int = 0
    unit: str | None = None
    shapes: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


def view_message(
    tiles: Iterable[Address] | None = None,
    camera: ArrayLike | None = None,
    level: int = 0,
    two_sided: bool = False,
    **header: Any,
) -> str:
    """The message that says which tiles are wanted; the header where there is more to say.

    Raises ValueError unless there is one of tiles and camera.
    """
    if (tiles is None) == (camera is None):
        raise ValueError("give either tiles or camera")
    message: dict[str, Any] = {"message": "open" if header else "view", **header}
    if camera is None:
        message["tiles"] = [[int(number) for number in tile] for tile in tiles or ()]
    else:
        matrix = np.asarray(camera, float)
        if matrix.shape != (4, 4):
            raise ValueError(f"camera has shape {matrix.shape}, not (4, 4)")
        message["camera"] = {"matrix": matrix.tolist(), "level": level, "two_sided": two_sided}
    return json.dumps(message, allow_nan=False)


def positions_message(number: int, positions: ArrayLike) -> bytes:
    """A frame of positions (V, 3); raises ValueError for another shape."""
    array = np.ascontiguousarray(positions, "<f4")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"positions have shape {array.shape}, not (V, 3)")
    return _FRAME.pack(number, _POSITIONS, len(array)) + array.tobytes()


def weights_message(
    number: int, weights: ArrayLike | Mapping[str, float], shapes: Sequence[str]
) -> bytes:
    """A frame of weights in the order of `shapes`, or by their names, others being 0.

    Raises ValueError for another number of weights, or a name that is not among the shapes.
    """
    if isinstance(weights, Mapping):
        strange = [name for name in weights if name not in shapes]
        if strange:
            told = f"{strange[0]!r} is none of the shapes of this connection"
            raise ValueError(f"{told}: {_instead(strange[0], shapes)}")
        weights = [weights.get(name, 0.0) for name in shapes]
    array = np.ascontiguousarray(weights, "<f4")
    if array.shape != (len(shapes),):
        told = f"weights have shape {array.shape}, not ({len(shapes)},)"
        raise ValueError(f"{told}: {_OTHERS} or in another order" if len(shapes) else told)
    return _FRAME.pack(number, _WEIGHTS, len(array)) + array.tobytes()


def _instead(name: str, shapes: Sequence[str]) -> str:
    """What to do about a name that is none of the shapes."""
    if not shapes:
        return "the asset has none"
    spelt = {shape.lower(): shape for shape in reversed(shapes)}
    near = get_close_matches(name.lower(), spelt, n=3, cutoff=0.0)
    return f"closest are {', '.join(spelt[one] for one in near)}; {_OTHERS}"


def read_ready(message: str | bytes, call: Request) -> LiveAsset:
    """The answer to the header."""
    facts = _json(message)
    if facts.get("message") != "ready":
        raise BadAnswer(f"the first message is not ready but {str(message)[:80]!r} [{call}]")
    found: LiveAsset = read(LiveAsset, facts)
    return found


def read_answer(message: str | bytes, call: Request) -> LiveTile | LiveAnswer:
    """A tile, or the end of a frame; raises the error that a problem means, and BadAnswer."""
    if isinstance(message, bytes | bytearray | memoryview):
        return _tile(bytes(message))
    facts = _json(message)
    if facts.get("message") == "frame":
        return read(LiveAnswer, facts)
    if facts.get("message") == "problem":
        raise refusal(facts, call)
    raise BadAnswer(f"a message that is not known: {message[:80]!r} [{call}]")


def _tile(message: bytes) -> LiveTile:
    if len(message) < _TILE.size:
        raise BadAnswer(f"a tile of {len(message)} bytes: its header has {_TILE.size}")
    number, udim, level, row, column, side, codes, _, dropped, scale = _TILE.unpack_from(message)
    kind = _CODES.get(codes)
    if kind is None or len(message) != _TILE.size + side * side * kind.itemsize:
        raise BadAnswer(f"a tile of {side}² of codes {codes} in {len(message)} bytes")
    values = np.frombuffer(message, kind, offset=_TILE.size).reshape(side, side)
    if codes == _U16:
        array = ((values.astype(np.float64) - 32768.0) * (scale / 32767.0)).astype(np.float32)
    elif codes == _F16:
        array = from_half(values)
    else:
        array = values.astype(np.float32)
    return LiveTile(number, udim, level, row, column, array, dropped)


def from_half(values: NDArray[np.float16]) -> NDArray[np.float32]:
    """The same numbers as float32, in half of the time that numpy takes to convert them. By a table
    and not by arithmetic: some hosts of this client take small numbers for 0."""
    # No code is outside of the table: `clip` saves the search for one.
    return _floats().take(values.view("<u2"), mode="clip")


@cache
def _floats() -> NDArray[np.float32]:
    """The float32 of every half float, by its code."""
    return np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)


def _json(message: str | bytes) -> dict[str, Any]:
    try:
        facts = json.loads(message)
    except (ValueError, RecursionError) as exc:
        raise BadAnswer(f"a message that is not JSON: {exc}") from exc
    if not isinstance(facts, dict):
        raise BadAnswer(f"a message that is no JSON object: {str(message)[:80]!r}")
    return facts
