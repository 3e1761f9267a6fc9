"""One asset on the device, put together from its parts."""

from __future__ import annotations

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.additions import DeviceEvents, DeviceGrain
from rhytid.engine.device_assets.bins import DeviceBins
from rhytid.engine.device_assets.drawing import DeviceDrawing, DeviceNeutral
from rhytid.engine.device_assets.frames import DeviceFrames
from rhytid.engine.device_assets.levels import DeviceFinest, DeviceLevels
from rhytid.engine.device_assets.mesh import DeferredWork, DeviceMesh
from rhytid.engine.device_assets.slopes import DeviceSlopes
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.work import BLOCK


class DeviceAsset:
    """The parts of an asset on the device; each part uses those before it. Every method, and those
    of the parts, runs in a task of the device unless it says otherwise.

    mesh: the mesh and its wrinkles.  frames: stretch of frames.  bins: precomputed maps.  neutral:
    neutral squares that `convolved` reads.  drawing: level 0 by every method.  finest: level 0,
    kept.  levels: squares of every level.  slopes: moments of slopes.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        settings: AssetSettings,
        stiffness: Stiffness | None = None,
        residual: Residual | None = None,
    ) -> None:
        self.mesh = DeviceMesh(device, mesh, settings, stiffness, residual)
        self.frames = DeviceFrames(self.mesh)
        grain = DeviceGrain(self.mesh, self.frames)
        events = DeviceEvents(self.mesh, self.frames)
        self.bins = DeviceBins(self.mesh, self.frames, grain, events)
        self.neutral = DeviceNeutral(self.mesh, self.frames)
        self.drawing = DeviceDrawing(self.mesh, self.frames, grain, self.bins, self.neutral, events)
        self.finest = DeviceFinest(self.mesh, self.drawing)
        self.levels = DeviceLevels(self.mesh, self.finest)
        self.slopes = DeviceSlopes(self.mesh, self.finest)

    def make(self, deferred: DeferredWork) -> None:
        """Do the work that a task deferred, unless it is done by now, and keep its result; on a
        thread that uses the device in steps, see `Device.in_steps`."""
        self.bins.make(*deferred.bins)
        if deferred.neutral is not None:
            self.neutral.make(*deferred.neutral)

    def warm_up(self) -> None:
        """Draw one block of level 1, so that no request waits for the kernels to compile."""
        for udim in self.mesh.udims[:1]:
            self.drawing.to_host(NEUTRAL_FRAME, MapQuery(), udim, 1, 0, 0, BLOCK // 2)
        self.mesh.cache.clear()

    def warm_up_stretch(self) -> None:
        """Compute and keep the coefficients that blend a frame, so that no request waits for the
        kernels to compile."""
        if self.mesh.stiffness is None:  # else it has no use for that
            self.frames.coefficients(NEUTRAL_FRAME, MapQuery("binned").stretch)

    def warm_up_blend(self, address: TileAddress) -> None:
        """Blend one tile, so that no request waits for the kernels to compile."""
        for buffer in self.bins.blended(NEUTRAL_FRAME, MapQuery("binned"), [address]):
            buffer.release()

    def release(self) -> None:
        """Free everything; later calls raise NotFoundError."""
        self.mesh.release()
