"""Arrays computed from the frames of an asset: their stretch, and what follows from it for wrinkles
and triangles."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.mesh import DeviceMesh
from rhytid.engine.frames import Frame
from rhytid.engine.messages import FrameStretch, MapQuery
from rhytid.pipeline.bin_maker import BinTile
from rhytid.pipeline.blend import Coefficients
from rhytid.pipeline.cushion import CushionTile
from rhytid.pipeline.grain import (
    GrainPlace,
    fill_gains,
    grain_place,
    relief,
)
from rhytid.pipeline.line_stretches import LineStretches, OwnerLines
from rhytid.pipeline.nearby import FrameValues, Groups, NearbyGroups, Numbers, united
from rhytid.pipeline.redraw import (
    R_ALONE,
    Responder,
    ScaleBuffers,
    respond_nearby,
    wrinkle_responder,
)
from rhytid.pipeline.smooth import SmoothFields, respond_smooth, smooth_wrinkle_responder
from rhytid.pipeline.stretch import NearbyTriangles, StretchBuffers
from rhytid.pipeline.work import Place, Square

G = TypeVar("G")
# A square costs as much time, beside its own elements, as so many lines that answer to a frame:
# measured with PoCL on two cores of an AMD EPYC. The bits do not depend on it.
_SQUARE = 1 << 17
# Frames of one UDIM whose lines keep their log stretch: clients on as many frames take turns.
_LINE_FRAMES = 4


class DeviceFrames:
    """Stretch of the frames of an asset, and what follows from it, kept for the frames used
    last."""

    def __init__(self, base: DeviceMesh) -> None:
        self._base = base
        # Which of the buffers of lines a frame has, the one used longest ago first.
        self._held: dict[tuple[Any, ...], dict[str, int]] = {}
        # By what is found, for the frames that were new last: squares that were asked for, and how
        # many of the frame that was new before.
        self._asked: dict[tuple[Any, ...], dict[str, tuple[set[Square], int]]] = {}

    def ratios(self, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Ratios (F, 2), unclamped, and axes (F, 2, 2) of the stretch of a frame."""
        return self._base.stretch.read(self.stretch(frame, "tensor"))

    def measured(self, frame: Frame) -> FrameStretch:
        """The stretch of a frame, and what folds of the mesh take of it."""
        ratios, axes = self.ratios(frame)
        return FrameStretch(
            axes, ratios, self._base.stretch.read_taken(self.stretch(frame, "tensor"))
        )

    def stretch(self, frame: Frame, model: str, alone: Place | None = None) -> StretchBuffers:
        """Clamped log stretch, less what folds of the mesh take, and its axes, of each triangle.

        alone: a tile, of whose triangles it is wanted; None: of all.
        """
        base, response = self._base, self._base.settings.response
        limit, soft, folds = response.log_stretch_limit, response.soft_limits, response.folds
        positions, angles = frame.positions, base.settings.angles
        found: StretchBuffers = base.cache.keep_of(
            frame, "stretch", model,
            make=lambda: base.stretch.unfilled(positions, model, angles, folds),
        )  # fmt: skip
        if positions is None or model != "tensor":
            alone = None

        def fill(near: NearbyTriangles | None) -> None:
            base.stretch.fill(found, positions, limit, soft, folds, near)

        fill_missing(found.filled, alone, self._triangles, fill)
        return found

    def _triangles(self, place: Place) -> NearbyTriangles:
        """The triangles whose stretch a tile needs."""
        base = self._base

        def make() -> NearbyTriangles:
            every = united([_shown(base, place.udim, place.square), *_answering(base, place)])
            return base.stretch.nearby(every, base.settings.response.folds)

        found: NearbyTriangles = base.cache.keep("nearby triangles", *place, make=make)
        return found

    def fields(self, frame: Frame, model: str) -> SmoothFields:
        """Log stretch interpolated over the surface, for `smooth` sampling."""
        base, response = self._base, self._base.settings.response
        limit, soft = response.log_stretch_limit, response.soft_limits
        return base.cache.keep_of(
            frame, "fields", model,
            make=lambda: base.smooth.run(self.stretch(frame, model), limit, soft),
        )  # fmt: skip

    def scales(
        self, frame: Frame, query: MapQuery, udim: int, square: Square | None = None
    ) -> ScaleBuffers:
        """Width and depth scales of wrinkles and pores.  square: of level 0, of whose elements they
        are wanted; None: of all."""
        base, model, sampling = self._base, query.stretch, query.sampling
        device, elements, settings = base.device, base.elements[udim], base.settings

        def make() -> ScaleBuffers:
            if sampling == "smooth":
                fields = self.fields(frame, model)
                return respond_smooth(device, elements, base.located[udim], settings, fields)
            return ScaleBuffers.allocate(device, elements)

        found: ScaleBuffers = base.cache.keep_of(frame, "scales", udim, model, sampling, make=make)

        if sampling == "smooth":
            return found
        place = self.alone(frame, ("scales", udim, model), udim, square)

        def fill(near: NearbyGroups | None) -> StretchBuffers:
            stretch = self.stretch(frame, model, place)
            respond_nearby(device, elements, settings, found, stretch, near)
            return stretch

        fill_missing(found.filled, place, self._nearby, fill)
        return found

    def line_stretches(self, frame: Frame, query: MapQuery, udim: int) -> Buffer | None:
        """Log stretch at the ends of wrinkles, by which the fast method blends their broad layer;
        None where there is none. It is that of this frame until others are asked for, as many as
        _LINE_FRAMES."""
        base, key = self._base, (udim, query.stretch, query.sampling)
        device, elements, settings = base.device, base.elements[udim], base.settings
        if elements.cushion is None:
            return None
        place = self._place_of(frame, key)
        found: LineStretches = base.cache.keep(
            "lines", *key, place, make=partial(LineStretches.allocate, device, elements)
        )
        if found.frame != frame.digest:
            found.frame = ""  # should only some of the kernels run
            found.fill(device, elements, settings, self._line_responder(frame, query, udim))
            found.frame = frame.digest
        return found.ends

    def owner_lines(
        self, frame: Frame, query: MapQuery, at: TileAddress, cushion: CushionTile
    ) -> OwnerLines | None:
        """The lines by which the fast method blends the broad layer of a tile, with their log
        stretch, until other frames are asked for. None where all lines are to answer at once."""
        base, key = self._base, ("lines", at.udim, query.stretch, query.sampling)
        if query.sampling == "smooth":
            return None
        place = self.alone(frame, key, at.udim, base.square(at), blended=True)
        if place is None:
            return None
        device, elements = base.device, base.elements[at.udim]
        make = partial(OwnerLines.of, device, elements, cushion)
        found: OwnerLines = base.cache.keep("owner lines", at, make=make)
        found.fill(device, base.settings, self._line_responder(frame, query, at.udim, place))
        return found

    def _nearby(self, place: Place) -> NearbyGroups:
        """The groups that a tile needs."""
        of_square = self._base.elements[place.udim].nearby.of
        make = partial(of_square, self._base.device, place.square)
        found: NearbyGroups = self._base.cache.keep("nearby", *place, make=make)
        return found

    def alone(
        self,
        frame: Frame,
        what: tuple[Any, ...],
        udim: int,
        square: Square | None,
        blended: bool = False,
    ) -> Place | None:
        """The tile that a square lies in, where what is found for a frame is found for it alone,
        so that it need not wait for the rest: where few tiles of this frame, and of the one before,
        were asked for. Else None, for all elements at once.  blended: as of Place."""
        base, side = self._base, self._base.tile_side
        if square is None or side == base.settings.resolution:
            return None
        row, column = (at // side * side for at in square[:2])
        if max(square[0] - row, square[1] - column) + square[2] > side:
            return None
        square = (row, column, side)
        asked = self._asked.setdefault(what, {})
        if frame.digest not in asked:
            last, _ = next(reversed(asked.values()), (set(), 0))
            asked[frame.digest] = set(), len(last)
            if len(asked) > _LINE_FRAMES:
                del asked[next(iter(asked))]
        squares, before = asked[frame.digest]
        squares.add(square)
        # Without wrinkles no tile is alone: kernels of some elements read the last of all.
        few = max(len(squares), before) <= base.elements[udim].wrinkles // _SQUARE
        return Place(udim, square, blended) if few else None

    def _place_of(self, frame: Frame, key: tuple[Any, ...]) -> int:
        """The number of the buffer that a frame has or takes over, for one key."""
        held = self._held.setdefault(key, {})
        place = held.pop(frame.digest, len(held))
        if place == _LINE_FRAMES:
            place = held.pop(next(iter(held)))
        held[frame.digest] = place
        return place

    def _line_responder(
        self, frame: Frame, query: MapQuery, udim: int, place: Place | None = None
    ) -> Responder:
        """Launches Alg. 1 for r of wrinkles.  place: a tile, of whose wrinkles it is wanted."""
        base, model = self._base, query.stretch
        device, settings = base.device, base.settings
        if query.sampling == "smooth":
            fields, located = self.fields(frame, model), base.located[udim]
            return smooth_wrinkle_responder(device, located, settings, fields, R_ALONE)
        stretch = self.stretch(frame, model, place)
        return wrinkle_responder(device, settings, stretch, R_ALONE)

    def coefficients(
        self, frame: Frame, model: str, alone: tuple[TileAddress, BinTile] | None = None
    ) -> Coefficients:
        """Coefficients of each triangle by which the fast method blends.  alone: a tile, of whose
        triangles they are wanted; None: of all."""
        base, blend = self._base, self._base.blend
        found: Coefficients = base.cache.keep_of(frame, "coefficients", model, make=blend.unfilled)
        place: Place | None = None
        if alone is not None:
            at, tile = alone
            what = ("coefficients", at.udim, model)
            place = self.alone(frame, what, at.udim, base.square(at), blended=True)

        def groups(at: Place) -> Groups:
            make = partial(Groups.of_triangles, base.device, tile.triangles)
            found: Groups = base.cache.keep("tile triangles", *at, make=make)
            return found

        def fill(wanted: Groups | None) -> StretchBuffers:
            stretch = self.stretch(frame, model, place)
            blend.fill(found, stretch, wanted)
            return stretch

        fill_missing(found.filled, place, groups, fill)
        return found

    def gains(self, frame: Frame, model: str, alone: Place | None) -> Buffer:
        """Gains of the grain of each triangle.  alone: as of `stretch`."""
        base = self._base
        make = partial(FrameValues.allocate, base.device, base.stretch.triangles + 1)
        found: FrameValues = base.cache.keep_of(frame, "gains", model, make=make)

        def fill(near: NearbyTriangles | None) -> StretchBuffers:
            stretch = self.stretch(frame, model, alone)
            groups = None if near is None else near.groups
            fill_gains(base.device, base.settings, stretch, found.values, groups)
            return stretch

        fill_missing(found.filled, alone, self._triangles, fill)
        return found.values

    def bin_stretches(self, frame: Frame, model: str) -> Buffer:
        """Stretch of each triangle across each bin, for texels with a stiffness of their own."""
        blend = self._base.blend
        return self._base.cache.keep_of(
            frame, "stretches", model, make=lambda: blend.stretches(self.stretch(frame, model))
        )

    def kernels(self, frame: Frame, model: str) -> Buffer:
        """Kernels of each triangle by which `convolved` convolves."""
        base = self._base
        return base.cache.keep_of(
            frame, "kernels", model,
            make=lambda: base.convolve.kernels(self.stretch(frame, model), base.settings),
        )  # fmt: skip


def fill_missing(
    filled: set[Place | None],
    place: Place | None,
    groups_of: Callable[[Place], G],
    fill: Callable[[G | None], StretchBuffers | None],
) -> None:
    """Fill what a place needs of values of a frame, or all of them, unless it is there.

    filled: the places that have it; None: all.  groups_of: what a place needs.  fill: launches the
    kernels for that, and returns the stretch that the values follow from. Kernels write more than a
    place needs: places whose stretch is not there any more lose what they had.
    """
    if not filled.isdisjoint((None, place)):
        return
    wanted, known = None if place is None else groups_of(place), set(filled)
    filled.clear()  # should only some of the kernels run
    stretch = fill(wanted)
    if stretch is not None and None not in stretch.filled:
        known &= stretch.filled
    filled.update(known, [place])


def _shown(base: DeviceMesh, udim: int, tile: Square) -> Numbers:
    """The triangles that texels of a tile show. To locate texels takes longer than all else that is
    found once for a tile, so they are those of its maps or of its grain, where it has any."""
    row, column, side = tile
    bins: BinTile | None = base.cache.find(
        "bins", TileAddress(udim, 0, row // side, column // side)
    )
    if bins is not None:
        return bins.triangles.numbers(base.device)
    if relief(base.settings) > 0.0:
        return grain_place_of(base, udim, row, column).triangles.numbers(base.device)
    texels = base.located[udim].texels(base.settings.resolution, row, column, side)
    shown: Numbers = base.device.read(texels, (side * side,), np.int32)
    texels.release()
    return shown


def _answering(base: DeviceMesh, place: Place) -> list[Numbers]:
    """The triangles whose stretch the elements of a tile answer to."""
    device, elements, square = base.device, base.elements[place.udim], place.square
    events = elements.event_triangles(device, square)
    if not place.blended:
        return [elements.triangles(device, square), events]
    if elements.cushion is None:
        return [events]
    at = TileAddress(place.udim, 0, square[0] // square[2], square[1] // square[2])
    owners: OwnerLines | None = base.cache.find("owner lines", at)
    if owners is None:  # all lines have answered, or are to
        return [elements.triangles(device, square), events]
    return [owners.triangles(device), events]


def grain_place_of(base: DeviceMesh, udim: int, row: int, column: int) -> GrainPlace:
    """That of the tile of level 0 with this first texel."""
    square, located = (row, column, base.tile_side), base.located[udim]
    make = partial(grain_place, base.device, located, base.settings, base.stiffness, square)
    return base.cache.keep("grain place", udim, row, column, make=make)
