"""What an asset has on the device, from its upload to its release, and what is kept beside it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rhytid.device.budget import Releasable
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings, ShapeSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.stiffness import Stiffness
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.frames import Frame
from rhytid.errors import NotFoundError
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.convolve import Convolve
from rhytid.pipeline.convolve_smooth import SmoothConvolve
from rhytid.pipeline.elements import (
    PoreArrays,
    UdimElements,
    WrinkleArrays,
    pore_arrays,
    wrinkle_arrays,
)
from rhytid.pipeline.grain_shares import grain_shares
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.smooth import SmoothStage
from rhytid.pipeline.stiffness import stiffness_of_elements
from rhytid.pipeline.stretch import StretchStage
from rhytid.pipeline.waves import wrinkle_waves

_Kept = TypeVar("_Kept", bound=Releasable)
Prepared = dict[int, tuple[WrinkleArrays, PoreArrays]]
# Frames of an asset whose stretch, and what follows from it, stay on the device. A task uses two at
# most, its frame and the neutral, so none is dropped in the task that uses it.
RECENT_FRAMES = 8


class DeviceMesh:
    """A mesh and its wrinkles by UDIM. What can be made of them again is kept under the memory
    budget: what belongs to a frame for the frames used last, what belongs to a tile until memory is
    short. The rest stays until `release`.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        settings: AssetSettings,
        stiffness: Stiffness | None = None,
    ) -> None:
        self._device, self._mesh, self._stiffness = device, mesh, stiffness
        self.settings = settings
        self._stretch = StretchStage(device, mesh)
        self._smooth = SmoothStage(device, mesh)
        self._located = {
            udim: UdimTriangles(device, mesh, udim, settings.resolution, settings.padding)
            for udim in mesh_udims(mesh)
        }
        self._elements: dict[int, UdimElements] = {}
        self.pore_triangle = self._wrinkle_triangle = np.zeros(0, np.int32)
        self._blend: Blend | None = None
        self._pore_stiffness: NDArray[np.float32] | None = None
        self._wrinkle_stiffness: NDArray[np.float32] | None = None
        self._grain_shares: NDArray[np.float32] | None = None
        self._convolve = Convolve(device, mesh, stiffness)
        self._smooth_convolve = SmoothConvolve(device, mesh, self._smooth, stiffness)
        self._recent: OrderedDict[str, None] = OrderedDict()
        self.released = False

    @property
    def neutral(self) -> NDArray[np.float32]:
        """(V, 3) positions of the neutral mesh."""
        return self._mesh.positions

    @property
    def udims(self) -> tuple[int, ...]:
        """The UDIMs with mesh."""
        return tuple(self._located)

    @property
    def cushion_factor(self) -> int | None:
        """Texels to a sample of the cushions, the same in every UDIM; None where there are none."""
        cushions = (elements.cushion for elements in self._elements.values())
        return next((cushion.factor for cushion in cushions if cushion is not None), None)

    def locate(self, graph: WrinkleGraph) -> None:
        """Find the triangle that each pore and each wrinkle samples."""
        pores, wrinkles = graph.node_uv, graph.centres()
        self.pore_triangle = self._find(pores, graph.node_triangle)
        self._wrinkle_triangle = self._find(wrinkles, graph.edge_triangle)
        self._grain_shares = grain_shares(self._mesh, graph, self.pore_triangle)
        of = partial(stiffness_of_elements, self._stiffness, self._mesh)
        self._pore_stiffness = of(pores, self.pore_triangle)
        self._wrinkle_stiffness = of(wrinkles, self._wrinkle_triangle)

    def prepare(self, graph: WrinkleGraph, settings: AssetSettings) -> Prepared:
        """The elements of each UDIM as they go to the device; host work, on any thread."""
        wrinkle = self._wrinkle_triangle
        waves = wrinkle_waves(self._mesh, graph, wrinkle, settings.shape)
        return {
            udim: (
                wrinkle_arrays(graph, wrinkle, settings, udim, self._wrinkle_stiffness, waves),
                pore_arrays(graph, self.pore_triangle, settings, udim, self._pore_stiffness),
            )
            for udim in self._located
        }

    def prepares(self, settings: AssetSettings) -> bool:
        """Whether elements are other ones with these settings, so that `use` is not enough."""
        old = self.settings
        other = settings.response != old.response or settings.bins.count != old.bins.count
        return other or _laid_out(settings.shape) != _laid_out(old.shape)

    def install(self, prepared: Prepared, settings: AssetSettings) -> None:
        """Take elements and settings in place of those before, in one step."""
        self.take(self.upload(prepared, settings), settings)

    def upload(self, prepared: Prepared, settings: AssetSettings) -> dict[int, UdimElements]:
        """The elements on the device, beside those that are drawn now; `take` them."""
        count = settings.bins.count
        return {u: UdimElements(self._device, w, p, count) for u, (w, p) in prepared.items()}

    def take(self, elements: dict[int, UdimElements], settings: AssetSettings) -> None:
        """Draw these elements with these settings from now on."""
        old, self._elements = self._elements, elements
        self.use(settings)
        for before in old.values():
            before.release()

    def use(self, settings: AssetSettings) -> None:
        """Take settings that leave the elements as they are; forget what the old ones made."""
        self._forget_made()
        blend = Blend(self._device, settings, self._stretch.triangles)
        if self._blend is not None:
            self._blend.release()
        self.settings, self._blend = settings, blend

    def release(self) -> None:
        """Give everything back; every later call raises NotFoundError."""
        self._forget_made()
        self.released = True
        held = (self._stretch, self._smooth, self._blend, self._convolve)
        for part in (*held, *self._located.values(), *self._elements.values()):
            if part is not None:
                part.release()

    def _find(self, uv: NDArray[np.float32], given: NDArray[np.int32] | None) -> NDArray[np.int32]:
        settings = self.settings
        if given is not None and (given >= 0).all():
            return given
        found = locate_points(self._device, self._mesh, uv, settings.resolution, settings.padding)
        return found if given is None else np.where(given >= 0, given, found)

    def _keep_of(self, frame: Frame, *key: Hashable, make: Callable[[], _Kept]) -> _Kept:
        """What is made for a frame, of the few used last: the next takes the memory of the one that
        was used longest ago, for fresh memory costs more than what is drawn in it."""
        self._recent[frame.digest] = None
        self._recent.move_to_end(frame.digest)
        if len(self._recent) > RECENT_FRAMES:
            old, _ = self._recent.popitem(last=False)
            self._drop(lambda kept: kept[-1] == old)
        return self._keep(*key, frame.digest, make=make)

    def _find_of(self, frame: Frame, *key: Hashable) -> Any | None:
        """What is kept of a frame under a key, or None."""
        if frame.digest in self._recent:
            self._recent.move_to_end(frame.digest)
        return self._lookup(*key, frame.digest)

    def _lookup(self, *key: Hashable) -> Any | None:
        return self._device.budget.find((id(self), *key))

    def _discard(self, *key: Hashable) -> None:
        self._device.budget.discard((id(self), *key))

    def _keep(self, *key: Hashable, make: Callable[[], _Kept]) -> _Kept:
        if self.released:
            raise NotFoundError("the asset was removed")
        return self._device.budget.keep((id(self), *key), make)

    def _forget_made(self) -> None:
        self._recent.clear()
        self._drop(lambda kept: True)

    def _drop(self, belongs: Callable[[tuple[Hashable, ...]], bool]) -> None:
        """Release what is kept for this asset under such keys."""

        def of_this(key: Hashable) -> bool:
            return isinstance(key, tuple) and key[0] == id(self) and belongs(key)

        self._device.budget.drop(of_this)


def _laid_out(shape: ShapeSettings) -> tuple[float | None, ...]:
    """What of a shape is in the elements, or in the boxes around them."""
    waves = (shape.wave_amplitude, shape.wave_frequency)
    cushion = (shape.cushion, shape.cushion_width)
    return (*waves, *cushion, shape.curvature, shape.taper, shape.least_half_width)
