"""The mesh and the wrinkles of an asset on the device, from their upload to their release."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings, ShapeSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import mesh_udims
from rhytid.engine.kept_entries import KeptEntries
from rhytid.errors import NotFoundError
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.convolve import Convolve
from rhytid.pipeline.convolve_smooth import SmoothConvolve
from rhytid.pipeline.cushion_elements import APRON
from rhytid.pipeline.element_arrays import PoreArrays, WrinkleArrays, pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.grain_shares import grain_shares
from rhytid.pipeline.locate import UdimTriangles, locate_points
from rhytid.pipeline.smooth import SmoothStage
from rhytid.pipeline.stiffness import stiffness_of_elements
from rhytid.pipeline.stretch import StretchStage
from rhytid.pipeline.waves import wrinkle_waves

Prepared = dict[int, tuple[WrinkleArrays, PoreArrays]]


class DeviceMesh:
    """A mesh, its wrinkles by UDIM, and the stages that work on them, which stay until `release`.

    kept: what is made of them and can be made again.  bounded: whether a task that would take long
    to make it raises Unmade instead.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        settings: AssetSettings,
        stiffness: Stiffness | None = None,
    ) -> None:
        self.device, self.mesh, self.stiffness = device, mesh, stiffness
        self.settings = settings
        self.stretch = StretchStage(device, mesh)
        self.smooth = SmoothStage(device, mesh)
        self.located = {
            udim: UdimTriangles(device, mesh, udim, settings.resolution, settings.padding)
            for udim in mesh_udims(mesh)
        }
        self.elements: dict[int, UdimElements] = {}
        self.pore_triangle = self._wrinkle_triangle = np.zeros(0, np.int32)
        self._blend: Blend | None = None
        self._pore_stiffness: NDArray[np.float32] | None = None
        self._wrinkle_stiffness: NDArray[np.float32] | None = None
        self.grain_shares: NDArray[np.float32] | None = None
        self.convolve = Convolve(device, mesh, stiffness)
        self.smooth_convolve = SmoothConvolve(device, mesh, self.smooth, stiffness)
        self.kept = KeptEntries(device.budget)
        self.bounded = False

    @property
    def neutral(self) -> NDArray[np.float32]:
        """(V, 3) positions of the neutral mesh."""
        return self.mesh.positions

    @property
    def udims(self) -> tuple[int, ...]:
        """The UDIMs with mesh."""
        return tuple(self.located)

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
        pores, wrinkles = graph.node_uv, graph.centres()
        self.pore_triangle = self._find(pores, graph.node_triangle)
        self._wrinkle_triangle = self._find(wrinkles, graph.edge_triangle)
        self.grain_shares = grain_shares(self.mesh, graph, self.pore_triangle)
        of = partial(stiffness_of_elements, self.stiffness, self.mesh)
        self._pore_stiffness = of(pores, self.pore_triangle)
        self._wrinkle_stiffness = of(wrinkles, self._wrinkle_triangle)

    def texel_triangles(self, udim: int) -> NDArray[np.int32]:
        """(R, R) triangle of each texel of level 0; the number of triangles for none."""
        side = self.settings.resolution
        return self._triangles(udim, side, 0)

    def cushion_triangles(self, udim: int) -> NDArray[np.int32]:
        """(n, n) the same of the samples of the cushions, APRON more on every side of the UDIM."""
        factor = self.cushion_factor
        if factor is None:
            raise NotFoundError("the asset has no cushions")
        return self._triangles(udim, self.settings.resolution // factor, APRON)

    def _triangles(self, udim: int, side: int, apron: int) -> NDArray[np.int32]:
        count = side + 2 * apron
        found = self.located[udim].texels(side, -apron, -apron, count)
        result: NDArray[np.int32] = self.device.read(found, (count, count), np.int32)
        found.release()
        return result

    def prepare(self, graph: WrinkleGraph, settings: AssetSettings) -> Prepared:
        """The elements of each UDIM as arrays for the device; work of the host, on any thread."""
        wrinkle = self._wrinkle_triangle
        waves = wrinkle_waves(self.mesh, graph, wrinkle, settings.shape)
        return {
            udim: (
                wrinkle_arrays(graph, wrinkle, settings, udim, self._wrinkle_stiffness, waves),
                pore_arrays(graph, self.pore_triangle, settings, udim, self._pore_stiffness),
            )
            for udim in self.located
        }

    def prepares(self, settings: AssetSettings) -> bool:
        """Whether elements are other ones with these settings, so that `use` is not enough."""
        old = self.settings
        other = settings.response != old.response or settings.bins.count != old.bins.count
        return other or _laid_out(settings.shape) != _laid_out(old.shape)

    def install(self, prepared: Prepared, settings: AssetSettings) -> None:
        """Replace elements and settings in one step."""
        self.take(self.upload(prepared, settings), settings)

    def upload(self, prepared: Prepared, settings: AssetSettings) -> dict[int, UdimElements]:
        """Upload elements beside those that are drawn now; `take` uses them."""
        count = settings.bins.count
        return {u: UdimElements(self.device, w, p, count) for u, (w, p) in prepared.items()}

    def take(self, elements: dict[int, UdimElements], settings: AssetSettings) -> None:
        """Draw these elements with these settings from now on; on failure they are freed and those
        before stay."""
        try:
            self.use(settings)
        except BaseException:
            _release(elements)
            raise
        old, self.elements = self.elements, elements
        _release(old)

    def use(self, settings: AssetSettings) -> None:
        """Take settings that leave the elements as they are, and drop what depends on the old
        ones."""
        self.kept.clear()
        blend = Blend(self.device, settings, self.stretch.triangles)
        if self._blend is not None:
            self._blend.release()
        self.settings, self._blend = settings, blend

    def release(self) -> None:
        """Free everything; later calls raise NotFoundError."""
        self.kept.release()
        held = (self.stretch, self.smooth, self._blend, self.convolve)
        for part in (*held, *self.located.values(), *self.elements.values()):
            if part is not None:
                part.release()

    def _find(self, uv: NDArray[np.float32], given: NDArray[np.int32] | None) -> NDArray[np.int32]:
        settings = self.settings
        if given is not None and (given >= 0).all():
            return given
        found = locate_points(self.device, self.mesh, uv, settings.resolution, settings.padding)
        return found if given is None else np.where(given >= 0, given, found)


def _release(elements: dict[int, UdimElements]) -> None:
    for of_udim in elements.values():
        of_udim.release()


def _laid_out(shape: ShapeSettings) -> tuple[float | None, ...]:
    """The fields of a shape that the elements, or the boxes around them, depend on."""
    waves = (shape.wave_amplitude, shape.wave_frequency)
    cushion = (shape.cushion, shape.cushion_width)
    return (*waves, *cushion, shape.curvature, shape.taper, shape.least_half_width)
