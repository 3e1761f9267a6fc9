"""What an asset has on the device, part by part."""

from __future__ import annotations

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_bins import DeviceBins
from rhytid.engine.device_drawing import DeviceDrawing
from rhytid.engine.device_finest import DeviceFinest
from rhytid.engine.device_frames import DeviceFrames
from rhytid.engine.device_grain import DeviceGrain
from rhytid.engine.device_levels import DeviceLevels
from rhytid.engine.device_mesh import DeviceMesh
from rhytid.engine.device_neutral import DeviceNeutral
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.work import BLOCK


class DeviceAsset:
    """The parts of an asset on the device; each uses those before it. Every method, and those of
    the parts, runs in a task of the device.

    mesh: the mesh and its wrinkles.  frames: stretch of frames.  bins: precomputed maps.  neutral:
    what `convolved` reads.  drawing: level 0 by every method.  finest: level 0, kept.  levels:
    squares of every level.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        settings: AssetSettings,
        stiffness: Stiffness | None = None,
    ) -> None:
        self.mesh = DeviceMesh(device, mesh, settings, stiffness)
        self.frames = DeviceFrames(self.mesh)
        grain = DeviceGrain(self.mesh, self.frames)
        self.bins = DeviceBins(self.mesh, self.frames, grain)
        self.neutral = DeviceNeutral(self.mesh, self.frames)
        self.drawing = DeviceDrawing(self.mesh, self.frames, grain, self.bins, self.neutral)
        self.finest = DeviceFinest(self.mesh, self.drawing)
        self.levels = DeviceLevels(self.mesh, self.finest)

    def warm_up(self) -> None:
        """Draw one block of level 1, so that no request waits for the kernels to compile."""
        for udim in self.mesh.udims[:1]:
            self.drawing.to_host(NEUTRAL_FRAME, MapQuery(), udim, 1, 0, 0, BLOCK // 2)
        self.mesh.kept.clear()

    def warm_up_stretch(self) -> None:
        """Compute and keep by what a frame is blended, so that no request waits for the kernels to
        compile."""
        if self.mesh.stiffness is None:  # else it has no use for that
            self.frames.coefficients(NEUTRAL_FRAME, MapQuery("binned").stretch)

    def warm_up_blend(self, address: TileAddress) -> None:
        """Blend one tile, for the same reason."""
        for buffer in self.bins.blended(NEUTRAL_FRAME, MapQuery("binned"), [address]):
            buffer.release()

    def release(self) -> None:
        """Free everything; later calls raise NotFoundError."""
        self.mesh.release()
