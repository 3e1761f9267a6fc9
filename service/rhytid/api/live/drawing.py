"""What a live connection draws: the tiles in view, and of these the ones that changed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from copy import deepcopy
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rhytid.api.live.wire import (
    GONE,
    MOST_TILES,
    TOO_LARGE,
    WEIGHTS,
    Camera,
    LiveClosed,
    LiveFrame,
    Opening,
    View,
    tile_message,
)
from rhytid.domain.blendshapes import Blendshapes
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import TileAddress, TileGrid
from rhytid.domain.view import ViewedTiles
from rhytid.engine.call_context import drawn_live
from rhytid.engine.frames import Frame
from rhytid.engine.messages import AssetInfo
from rhytid.errors import HostMemoryError, NotFoundError
from rhytid.formats.frames import RAW, read_positions
from rhytid.formats.tile_header import TileHeader

if TYPE_CHECKING:
    from prometheus_client import Counter

    from rhytid.engine.operations import Engine

# Of one view: as many as a map of 8192² has.
MOST_TEXELS = 8192**2
# Rows of a tile that are compared at a time.
_ROWS = 8
# A tile that was drawn, and what it is encoded to.
_WORKING = 2
# How many times the bytes of shapes are there while they are read.
_READING = 3
# Frames that a connection may have at once: one that comes, one that waits, one that is drawn.
_FRAMES = 3


class LiveDrawing:
    """Draws for one connection; one thread at a time.

    slot: held while something is drawn.  drawn: counts tiles. Raises LiveClosed where the header
    asks for what the asset does not have or for more than a connection may hold, and HostBusyError
    where the memory is held by others.
    """

    def __init__(
        self,
        engine: Engine,
        info: AssetInfo,
        opening: Opening,
        slot: Callable[[], AbstractContextManager[None]],
        drawn: Counter,
    ) -> None:
        self._engine, self._info, self._opening = engine, info, opening
        self._slot, self._drawn, self._query = slot, drawn, opening.query()
        self._grid = TileGrid(info.settings["resolution"], info.settings["tile_size"])
        self._centre = np.array(info.centre)
        self._sent: dict[TileAddress, NDArray[Any]] = {}
        self._viewed: tuple[int, ViewedTiles] | None = None
        self._hold, self._loading = engine.memory.hold("answers"), 0
        self.blendshapes: Blendshapes | None = None
        try:
            self._reserve(0)
            self._take_shapes()
            self._reserve(0)
            self.look(opening)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Give back the memory that it holds."""
        self._hold.release()

    @property
    def weights(self) -> int:
        """How many weights a frame of weights has; 0 where the asset has no named shapes."""
        return 0 if self.blendshapes is None else len(self.blendshapes.names)

    def look(self, view: View) -> None:
        """Want other tiles from now on; raises LiveClosed naming one that there is not."""
        for address in view.addresses():
            self._check(address)
        if view.camera is not None:
            for udim in self._info.udims[:1]:
                self._check(TileAddress(udim, view.camera.level, 0, 0))
        self._check_texels(view.addresses())
        self._view = view

    def in_view(self, frame: LiveFrame) -> tuple[Frame, list[TileAddress]]:
        """The positions of a frame, and the tiles in view of it, the largest first where a camera
        looks.

        Raises FrameError for numbers that are not finite, NotFoundError where the asset is gone,
        what the budget of memory does.
        """
        found, view = self._frame(frame), self._view
        addresses = view.addresses()
        if view.camera is not None:
            addresses = self._seen(found, view.camera)
            if len(addresses) > MOST_TILES:
                raise LiveClosed(TOO_LARGE, f"{len(addresses)} tiles in view: at most {MOST_TILES}")
            self._check_texels(addresses)
        wanted = set(addresses)
        self._sent = {at: tile for at, tile in self._sent.items() if at in wanted}
        self._reserve(self._tile_bytes(addresses))
        return found, addresses

    def first(
        self, frame: LiveFrame, dropped: int
    ) -> tuple[Frame, list[TileAddress], bytes | None]:
        """As `in_view`, and the message with the first of the tiles, as `tile` has it: to change
        threads in between takes as long as to encode a quarter of a tile."""
        found, addresses = self.in_view(frame)
        if not addresses:
            return found, addresses, None
        return found, addresses, self.tile(found, addresses[0], frame.number, dropped)

    def tile(self, frame: Frame, at: TileAddress, number: int, dropped: int) -> bytes | None:
        """The message with a tile; None where it changed too little since it was last sent."""
        tile, header = self._displacement(frame, at)
        self._drawn.inc()
        before = self._sent.get(at)
        if before is not None and not has_changed(before, tile, self._opening.tolerance):
            return None
        scale = self._opening.scale or header.scale
        message = tile_message(number, tile, header, self._opening.format, scale, dropped)
        # A copy: what an engine in another process answers lies in memory that it uses again.
        if before is None:
            self._sent[at] = np.array(tile)
        else:
            np.copyto(before, tile)
        return message

    def _displacement(self, frame: Frame, at: TileAddress) -> tuple[NDArray[Any], TileHeader]:
        """A tile as it is sent where that is half floats, so that the device converts it; else
        float32."""
        tiles, asked = self._engine.tiles, (self._info.id, frame, self._query, at)
        with self._slot(), drawn_live():
            if self._opening.format == "f16":
                half = tiles.draw_half(*asked)
                return half.tile, half.header
            drawn = tiles.draw(*asked)
        return drawn.tile, drawn.description.header

    @cached_property
    def _mesh(self) -> Mesh:
        """The neutral mesh, which not every connection needs. A copy: what an engine in another
        process answers keeps memory of its connection for as long as it is there."""
        return deepcopy(self._engine.assets.mesh(self._info.id))

    def _take_shapes(self) -> None:
        assets, id = self._engine.assets, self._info.id
        try:
            # Held before they are read: what was read, a copy, and the differences.
            self._loading = _READING * assets.shapes_nbytes(id)
            self._reserve(0)
            shapes = assets.shapes(id)
        except NotFoundError:
            self._loading = 0
            if self._opening.shapes:
                raise
            return
        self.blendshapes = Blendshapes(self._mesh.positions, shapes, self._opening.shapes)
        self._loading = 0

    def _frame(self, frame: LiveFrame) -> Frame:
        """The positions of a frame, checked once: what reads them checks them, too."""
        vertices = self._info.vertices
        if frame.kind == WEIGHTS:
            assert self.blendshapes is not None  # `read_frame` refuses weights otherwise
            moved = self.blendshapes.positions(np.frombuffer(frame.content, "<f4"))
            return Frame.checked(moved, vertices)
        return Frame.of(read_positions(frame.content, RAW, vertices, self._centre))

    def _seen(self, frame: Frame, camera: Camera) -> list[TileAddress]:
        if self._viewed is None or self._viewed[0] != camera.level:
            viewed = ViewedTiles(self._mesh, self._info.udims, self._grid, camera.level)
            self._viewed = (camera.level, viewed)
        matrix = np.array(camera.matrix)
        # Positions are less the centre here, the camera is where the client sees them.
        matrix[:, 3] += matrix[:, :3] @ self._centre
        assert frame.positions is not None
        return self._viewed[1].seen(frame.positions, matrix, two_sided=camera.two_sided)

    def _check(self, address: TileAddress) -> None:
        try:
            self._grid.check(address)
        except NotFoundError as error:
            raise LiveClosed(GONE, f"tile {address}: {error}") from error
        if address.udim not in self._info.udims:
            have = ", ".join(str(udim) for udim in self._info.udims)
            raise LiveClosed(GONE, f"tile {address}: the asset has the UDIMs {have}")

    def _check_texels(self, addresses: list[TileAddress]) -> None:
        texels = self._tile_bytes(addresses) // 4
        if texels > MOST_TEXELS:
            raise LiveClosed(TOO_LARGE, f"{texels} texels in view: at most {MOST_TEXELS}")

    def _tile_bytes(self, addresses: list[TileAddress]) -> int:
        """Of these tiles, which are kept once they were sent."""
        return sum(4 * self._grid.texels(address.level) ** 2 for address in addresses)

    def _reserve(self, tiles: int) -> None:
        """Hold what the connection takes: waits for it; raises as `Hold.grow` does."""
        largest = 4 * self._grid.texels(0) ** 2
        frames = _FRAMES * 12 * self._info.vertices
        shapes = self._loading if self.blendshapes is None else self.blendshapes.nbytes
        viewed = 0 if self._viewed is None else self._viewed[1].nbytes
        mesh = 36 * self._info.vertices + 24 * self._info.triangles
        try:
            self._hold.resize(tiles + _WORKING * largest + frames + shapes + viewed + mesh)
        except HostMemoryError as error:
            raise LiveClosed(TOO_LARGE, str(error)) from error


def has_changed(before: NDArray[Any], now: NDArray[Any], tolerance: float) -> bool:
    """Whether some texel of a tile, of float32 or half floats, differs by more than the tolerance.
    Of most tiles one is found in the first rows that are compared, those in the middle."""
    middle = len(now) // 2
    firsts = chain(range(middle, len(now), _ROWS), range(0, middle, _ROWS))
    rows = (slice(first, first + _ROWS) for first in firsts)
    return any(_differ(before[some], now[some], tolerance) for some in rows)


def _differ(before: NDArray[Any], now: NDArray[Any], tolerance: float) -> bool:
    bits = f"u{now.itemsize}"
    if np.array_equal(before.view(bits), now.view(bits)):  # numpy is slow at half floats
        return False
    return float(np.abs(np.subtract(now, before, dtype=np.float32)).max()) > tolerance
