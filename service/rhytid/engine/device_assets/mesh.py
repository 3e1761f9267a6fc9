"""The mesh and the wrinkles of an asset on the device, from their upload to their release, and the
cache of what is made of them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid.device.budget import MemoryBudget, Releasable
from rhytid.device.runtime import Device, OnFirstUse
from rhytid.domain.asset_settings import AssetSettings, ShapeSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress, mesh_udims
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid.errors import NotFoundError
from rhytid.pipeline.bins import EVEN, ShareRange
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.convolve import Convolve, SmoothConvolve
from rhytid.pipeline.element_arrays import PoreArrays, WrinkleArrays, pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import LineSources, UdimElements
from rhytid.pipeline.event_elements import EventArrays, event_arrays
from rhytid.pipeline.grain import relief_shares
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.residual import ResidualMap
from rhytid.pipeline.smooth import SmoothStage
from rhytid.pipeline.stiffness import stiffness_of_elements
from rhytid.pipeline.stretch import StretchStage
from rhytid.pipeline.waves import wrinkle_waves
from rhytid.pipeline.work import Square

Prepared = dict[int, tuple[WrinkleArrays, PoreArrays, EventArrays | None]]
T = TypeVar("T", bound=Releasable)
# Frames of an asset whose stretch, and what follows from it, stay on the device. A task uses two at
# most, its frame and the neutral, so none is dropped in the task that uses it.
RECENT_FRAMES = 8
# Texels per side whose triangles are found at once.
_PIECE = 2048


class DeviceMesh:
    """A mesh, its wrinkles by UDIM, and the stages that work on them, which stay until `release`.

    tile_side: texels per side of a tile of level 0.  residuals: by UDIM, of scanned skin.  cache:
    what is computed from them.  bounded: whether a task defers work that takes long, by
    DeferredWork.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        settings: AssetSettings,
        stiffness: Stiffness | None = None,
        residual: Residual | None = None,
    ) -> None:
        self.device, self.mesh, self.stiffness = device, mesh, stiffness
        self.settings, self.tile_side = settings, settings.grid.texels(0)
        self.stretch = StretchStage(device, mesh, settings.length_unit)
        self.located = {
            udim: UdimTriangles(device, mesh, udim, settings.resolution, settings.padding)
            for udim in mesh_udims(mesh)
        }
        codes = {} if residual is None else residual.codes
        self.residuals = {u: ResidualMap.upload(device, residual, u) for u in codes if residual}
        self.elements: dict[int, UdimElements] = {}
        self.pore_triangle = self._wrinkle_triangle = np.zeros(0, np.int32)
        self._blend: Blend | None = None
        self.shares = EVEN
        self._pore_stiffness: NDArray[np.float32] | None = None
        self._wrinkle_stiffness: NDArray[np.float32] | None = None
        self.relief_shares: NDArray[np.float32] | None = None
        self.patch_size: float | None = None
        self._smooth = OnFirstUse(device, partial(SmoothStage, device, mesh))
        self._convolve = OnFirstUse(device, partial(Convolve, device, mesh, stiffness))
        self.cache = DeviceCache(device.budget)
        self.bounded = False

    @property
    def smooth(self) -> SmoothStage:
        """What smooth sampling needs of the mesh; on a thread that uses the device in steps, too,
        as the next two."""
        return self._smooth.get()

    @property
    def convolve(self) -> Convolve:
        """The stage of `convolved`."""
        return self._convolve.get()

    @cached_property
    def smooth_convolve(self) -> SmoothConvolve:
        """The stage of `convolved` with smooth sampling."""
        return SmoothConvolve(self.device, self.mesh, self.smooth, self.stiffness)

    @property
    def neutral(self) -> NDArray[np.float32]:
        """(V, 3) positions of the neutral mesh."""
        return self.mesh.positions

    @property
    def udims(self) -> tuple[int, ...]:
        """The UDIMs that the mesh lies in."""
        return tuple(self.located)

    def square(self, address: TileAddress) -> Square:
        """The square that a tile of level 0 covers."""
        side = self.tile_side
        return address.row * side, address.column * side, side

    @property
    def blend(self) -> Blend:
        """The blend of `binned` with the present settings."""
        assert self._blend is not None
        return self._blend

    @property
    def cushion_factor(self) -> int | None:
        """Texels to a sample of the cushions, the same in every UDIM; None where there are none."""
        cushions = (elements.cushion for elements in self.elements.values())
        return next((cushion.factor for cushion in cushions if cushion is not None), None)

    def locate(self, graph: WrinkleGraph) -> None:
        """Find the triangle that each pore and each wrinkle samples."""
        self.shares = ShareRange.of(graph)
        pores, wrinkles = graph.node_uv, graph.centres()
        self.pore_triangle = self._find(pores, graph.node_triangle)
        self._wrinkle_triangle = self._find(wrinkles, graph.edge_triangle)
        self.relief_shares = relief_shares(self.mesh, graph, self.pore_triangle)
        if graph.origin is not None:
            self.patch_size = graph.origin.patch_size_in(self.settings.length_unit)
        of = partial(stiffness_of_elements, self.stiffness, self.mesh)
        self._pore_stiffness = of(pores, self.pore_triangle)
        self._wrinkle_stiffness = of(wrinkles, self._wrinkle_triangle)

    def texel_triangles(self, udim: int) -> NDArray[np.int32]:
        """(R, R) triangle of each texel of level 0; the number of triangles for none. In steps,
        where the thread uses the device so."""
        side = self.settings.resolution
        piece, out = min(side, _PIECE), np.empty((side, side), np.int32)
        for row, column in product(range(0, side, piece), repeat=2):
            found = self.located[udim].texels(side, row, column, piece)
            read = self.device.read(found, (piece, piece), np.int32)
            out[row : row + piece, column : column + piece] = read
            found.release()
        return out

    def cushion_lines(self, udim: int) -> LineSources:
        """What the wrinkles of a UDIM answer to stretch by, for the owners of cushions. Raises
        NotFoundError where there are no cushions."""
        if self.cushion_factor is None:
            raise NotFoundError("the asset has no cushions")
        return LineSources.read(self.device, self.elements[udim])

    def prepare(self, graph: WrinkleGraph, settings: AssetSettings) -> Prepared:
        """The elements of each UDIM as arrays for the device. Work of the host, for any thread."""
        wrinkle = self._wrinkle_triangle
        waves = wrinkle_waves(self.mesh, graph, wrinkle, settings.shape)
        return {
            udim: (
                wrinkle_arrays(graph, wrinkle, settings, udim, self._wrinkle_stiffness, waves),
                pore_arrays(graph, self.pore_triangle, settings, udim, self._pore_stiffness),
                event_arrays(graph, self.pore_triangle, settings, udim, self._pore_stiffness),
            )
            for udim in self.located
        }

    def prepares(self, settings: AssetSettings) -> bool:
        """Whether these settings change the elements, so that `use` is not enough. What folds of
        the mesh take is of each frame."""
        old = self.settings
        one, other = (replace(s.response, folds=0.0) for s in (old, settings))
        changed = one != other or settings.bins.count != old.bins.count
        return changed or _laid_out(settings.shape) != _laid_out(old.shape)

    def install(self, prepared: Prepared, settings: AssetSettings) -> None:
        """Replace elements and settings in one step."""
        self.take(self.upload(prepared, settings), settings)

    def upload(self, prepared: Prepared, settings: AssetSettings) -> dict[int, UdimElements]:
        """Upload elements beside those that are drawn now; `take` makes them those that are
        drawn."""
        count = settings.bins.count
        return {u: UdimElements(self.device, w, p, count, e) for u, (w, p, e) in prepared.items()}

    def take(self, elements: dict[int, UdimElements], settings: AssetSettings) -> None:
        """Draw these elements with these settings from now on. On failure they are freed, and the
        present elements stay."""
        try:
            self.use(settings)
        except BaseException:
            _release(elements)
            raise
        old, self.elements = self.elements, elements
        _release(old)

    def use(self, settings: AssetSettings) -> None:
        """Take settings that leave the elements as they are, and drop all that was computed with
        the old ones."""
        self.cache.clear()
        blend = Blend(self.device, settings, self.stretch.triangles, self.shares)
        if self._blend is not None:
            self._blend.release()
        self.settings, self._blend = settings, blend

    def release(self) -> None:
        """Free everything; later calls raise NotFoundError."""
        self.cache.release()
        held = (self.stretch, self._smooth, self._blend, self._convolve)
        by_udim = self.located, self.residuals, self.elements
        for part in (*held, *(part for parts in by_udim for part in parts.values())):
            if part is not None:
                part.release()

    def _find(self, uv: NDArray[np.float32], given: NDArray[np.int32] | None) -> NDArray[np.int32]:
        settings = self.settings
        if given is not None and (given >= 0).all():
            return given
        found = locate_points(self.device, self.mesh, uv, settings.resolution, settings.padding)
        return found if given is None else np.where(given >= 0, given, found)


class DeviceCache:
    """Arrays computed from one asset on the device, which can be computed again: entries of the
    memory budget. Entries of a frame are kept for the frames used last, other entries until memory
    is short."""

    def __init__(self, budget: MemoryBudget) -> None:
        self._budget = budget
        self._recent: OrderedDict[str, None] = OrderedDict()
        self.released = False

    def keep(self, *key: Hashable, make: Callable[[], T]) -> T:
        """The entry of a key, made where there is none. Raises NotFoundError after `release`."""
        if self.released:
            raise NotFoundError("the asset was removed")
        return self._budget.keep((id(self), *key), make)

    def keep_of(self, frame: Frame, *key: Hashable, make: Callable[[], T]) -> T:
        """The entry of a frame and a key, as `keep`, for one of the frames used last. A new frame
        reuses the memory of the least recently used one: fresh memory costs more time than
        drawing."""
        self._recent[frame.digest] = None
        self._recent.move_to_end(frame.digest)
        if len(self._recent) > RECENT_FRAMES:
            old, _ = self._recent.popitem(last=False)
            self._drop(lambda kept: kept[-1] == old)
        return self.keep(*key, frame.digest, make=make)

    def find(self, *key: Hashable) -> Any | None:
        """The entry of a key, or None."""
        return self._budget.find((id(self), *key))

    def find_of(self, frame: Frame, *key: Hashable) -> Any | None:
        """The entry of a frame and a key, or None."""
        if frame.digest in self._recent:
            self._recent.move_to_end(frame.digest)
        return self.find(*key, frame.digest)

    def discard(self, *key: Hashable) -> None:
        """Release the entry of a key."""
        self._budget.discard((id(self), *key))

    def clear(self) -> None:
        """Release all entries."""
        self._recent.clear()
        self._drop(lambda kept: True)

    def release(self) -> None:
        """Release all entries, and keep none from then on."""
        self.clear()
        self.released = True

    def _drop(self, belongs: Callable[[tuple[Hashable, ...]], bool]) -> None:
        def of_this(key: Hashable) -> bool:
            return isinstance(key, tuple) and key[0] == id(self) and belongs(key)

        self._budget.drop(of_this)


class DeferredWork(Exception):
    """A task stopped, because it lacks a part of the asset that takes longer to make than one task
    may. `DeviceAsset.make` makes it in steps, between which other tasks run.

    bins: tiles whose precomputed maps are missing.  neutral: the query, the UDIM and the square of
    a neutral square of `convolved` that is missing.
    """

    def __init__(
        self,
        bins: Sequence[TileAddress] = (),
        neutral: tuple[MapQuery, int, Square] | None = None,
    ) -> None:
        super().__init__()
        self.bins, self.neutral = bins, neutral


def _release(elements: dict[int, UdimElements]) -> None:
    for of_udim in elements.values():
        of_udim.release()


def _laid_out(shape: ShapeSettings) -> tuple[float | None, ...]:
    """The fields of a shape that the elements, or the boxes around them, depend on."""
    waves = (shape.wave_amplitude, shape.wave_frequency)
    cushion = (shape.cushion, shape.cushion_width)
    return (*waves, *cushion, shape.curvature, shape.taper, shape.least_half_width)
