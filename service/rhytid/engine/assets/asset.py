"""One asset, with its data on the host and its state, and the registry of assets by id."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid.domain.asset_settings import MOST_WRINKLES, AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import ORIGIN, Centre, Mesh
from rhytid.domain.mesh_warnings import FrameCheck
from rhytid.domain.notices import Notice, build_notice, grain_notice, texel_notice
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress, mesh_udims
from rhytid.domain.uv_layout import usual_uv_length
from rhytid.domain.warnings import InputWarning
from rhytid.engine.changes import counted
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import LEFT, Frame, FrameMemory, Frames
from rhytid.engine.job import Job
from rhytid.engine.messages import AssetDimensions, AssetInfo
from rhytid.errors import (
    CancelledError,
    ConflictError,
    FetchingError,
    NotFoundError,
    NotReadyError,
    StorageError,
)

_SMALL_WRINKLES, _SMALL_RESOLUTION = 50_000, 2048
# Attributes that tiles, and whether there are any, hang on.
_SHOWN = frozenset({"settings", "state"})


@dataclass(eq=False)
class Asset:
    """One asset.

    state: building, then ready or failed; at last removed, or left: the asset is in the shared
    store alone, and will be another object here. A failed asset that is sent again is another
    object, too. Its parts on the device may be dropped and loaded again while it is ready.
    """

    id: str
    settings: AssetSettings
    vertices: int
    triangles: int
    udims: tuple[int, ...]
    frames: Frames
    job: Job | None = None
    state: str = "building"
    reason: str | None = None
    pores: int = 0
    wrinkles: int = 0
    # The lengths that settings are resolved with.
    lengths: Lengths = field(default_factory=lambda: Lengths.of(1.0))
    statistics: dict[str, Any] | None = None
    # The largest residual of a scanned skin, mesh units; None of another skin.
    residual: float | None = None
    # None until first loaded; used through DeviceAssets only.
    on_device: DeviceAsset | None = None
    warnings: tuple[InputWarning, ...] = ()
    centre: Centre = field(default_factory=lambda: ORIGIN)
    # Reads its mesh; None for an asset of which only the failure is known.
    mesh: Callable[[], Mesh] | None = None
    # The value of `uv_length`, once it was measured.
    measured_uv: float | None = None
    # The number of wrinkles it will have.
    expected_wrinkles: int = MOST_WRINKLES
    # When it was last asked for by a call, in seconds of time.monotonic.
    called: float = field(default_factory=time.monotonic)
    # Held while its state, its settings or its files change, or it is brought to the device.
    lock: threading.RLock = field(default_factory=threading.RLock)
    # Held while work that its tasks deferred is done in steps.
    making: threading.Lock = field(default_factory=threading.Lock)

    def __setattr__(self, name: str, value: Any) -> None:
        with counted().changing(self.id) if name in _SHOWN else nullcontext():
            super().__setattr__(name, value)

    @classmethod
    def of(
        cls,
        id: str,
        mesh: Mesh,
        settings: AssetSettings,
        warnings: tuple[InputWarning, ...],
        memory: FrameMemory,
        read: Callable[[], Mesh],
    ) -> Asset:
        """An asset of a mesh that is not built yet.  read: reads the mesh again."""
        return cls(
            id=id,
            settings=settings,
            vertices=len(mesh.positions),
            triangles=len(mesh.faces),
            udims=mesh_udims(mesh),
            frames=Frames(memory, id),
            warnings=warnings,
            centre=mesh.centre,
            mesh=read,
        )

    @classmethod
    def failed(cls, id: str, reason: str, memory: FrameMemory) -> Asset:
        """A failed asset of which only the id is known.  reason: why it failed."""
        asset = cls(id, AssetSettings(), 0, 0, (), Frames(memory, id))
        asset.fail(reason)
        return asset

    def fail(self, reason: str) -> None:
        """Mark it as failed; `reason` is shown to callers."""
        self.state, self.reason = "failed", reason

    def built(
        self,
        graph: WrinkleGraph,
        settings: AssetSettings,
        distance: float,
        residual: Residual | None = None,
    ) -> None:
        """Mark it as ready, with resolved settings; `lengths` are set before.

        distance: measured mean distance of neighbouring pores on the surface, in mesh units.
        """
        self.settings = settings
        self.pores, self.wrinkles = graph.counts()
        self.residual = None if residual is None else residual.largest
        self.statistics = {
            "spacing": self.lengths.spacing,
            "distance": distance,
            **graph.figures(),
        }
        self.state = "ready"

    @property
    def used(self) -> float:
        """When it was last asked for, by a call or of who keeps its tiles, in seconds of
        time.monotonic."""
        return max(self.called, counted().used(self.id))

    @property
    def small(self) -> bool:
        """Whether its jobs are short enough to run beside those of larger assets."""
        wrinkles = self.wrinkles if self.state == "ready" else self.expected_wrinkles
        return wrinkles <= _SMALL_WRINKLES and self.settings.resolution <= _SMALL_RESOLUTION

    @property
    def dimensions(self) -> AssetDimensions:
        """Its sizes."""
        centre = tuple(self.centre.tolist())
        grid = self.settings.grid
        return AssetDimensions(self.id, self.vertices, self.triangles, self.udims, grid, centre)

    def checked(self, positions: ArrayLike | Frame) -> Frame:
        """Positions (V, 3) as a frame that has them; those of a frame were checked before. Raises
        FrameError, and UnknownFrameError for a frame without positions that are not here."""
        if not isinstance(positions, Frame):
            return Frame.checked(positions, self.vertices)
        found = self.frames.recent(positions) if positions.positions is None else positions
        assert found.positions is not None
        if len(found.positions) != self.vertices:
            return Frame.checked(found.positions, self.vertices)  # which raises
        return found

    def info(self) -> AssetInfo:
        """The asset as a caller sees it."""
        return AssetInfo(
            id=self.id,
            state=self.state,
            job=self.job.info.id if self.job else None,
            reason=self.reason,
            settings=self.settings.as_json(),
            udims=self.udims,
            levels=self.settings.grid.levels,
            vertices=self.vertices,
            triangles=self.triangles,
            pores=self.pores,
            wrinkles=self.wrinkles,
            statistics=self.statistics,
            warnings=self.warnings,
            notices=self._notices(),
            centre=tuple(self.centre.tolist()),
        )

    def _notices(self) -> tuple[Notice, ...]:
        """Facts about its present settings that are worth knowing."""
        spacing = self.lengths.spacing if self.state == "ready" else None
        building = self.state == "building" and self.expected_wrinkles != MOST_WRINKLES
        large = build_notice(self.expected_wrinkles) if building else ()
        # Pores of a scanned skin are where the scan has them, not at a spacing.
        scanned = self.residual is not None
        texels = () if scanned else texel_notice(self.settings, self.uv_length, spacing)
        return (
            *grain_notice(self.settings, self.uv_length),
            *texels,
            *large,
        )

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Hold the lock, so that the asset is not removed within the block. Raises CancelledError
        where it was removed before, FetchingError where it has left."""
        with self.lock:
            self._check_here()
            if self.state == "removed":
                raise CancelledError(f"asset {self.id} was removed")
            yield

    def check_known(self) -> None:
        """Raise NotFoundError where the asset was removed, FetchingError where it has left."""
        self._check_here()
        if self.state == "removed":
            raise NotFoundError(f"asset {self.id} was removed")

    def _check_here(self) -> None:
        if self.state == "left":
            raise FetchingError(LEFT)

    def check_ready(self) -> None:
        """Raise NotReadyError while the asset builds, ConflictError where it failed, and what
        `check_known` raises."""
        self.check_known()
        if self.state == "building":
            raise NotReadyError(f"asset {self.id} is still building")
        if self.state == "failed":
            raise ConflictError(f"asset {self.id} failed to build: {self.reason}")

    def check_grown(self) -> None:
        """Raise ConflictError for a scanned skin, and what `check_ready` raises."""
        self.check_ready()
        if self.residual is not None:
            raise ConflictError(
                f"asset {self.id} is a scanned skin: precomputed maps do not hold its residual, "
                "and would not be the scan at rest; ask for tiles or maps of frames, or a package"
            )

    @property
    def resident(self) -> DeviceAsset | None:
        """Its parts on the device, or None where they are not loaded."""
        resident = self.on_device
        return None if resident is None or resident.mesh.cache.released else resident

    def frame(self, frame: str | Frame) -> Frame:
        """A stored frame by its name, or one that is not stored, with its positions. Raises
        NotFoundError, UnknownFrameError, FrameError and what `check_ready` raises."""
        self.check_ready()
        if isinstance(frame, str):
            return self.frames.get(frame)
        return self.frames.recent(self.checked(frame))

    @property
    def uv_length(self) -> float:
        """Mesh units that a step of 1 in UV is long, found on first use; 0 while its mesh cannot be
        read."""
        if self.measured_uv is None and self.mesh is not None:
            with suppress(StorageError, NotFoundError):
                self.measured_uv = usual_uv_length(self.mesh())
        return self.measured_uv or 0.0

    @cached_property
    def frame_check(self) -> FrameCheck | None:
        """The check of its frames, made on first use; None where it has no mesh. Raises
        StorageError where its mesh cannot be read."""
        return None if self.mesh is None else FrameCheck(self.mesh(), self.settings.length_unit)

    def frame_warnings(self, positions: NDArray[np.float32], name: str) -> tuple[InputWarning, ...]:
        """Warnings of what is probably wrong with positions (V, 3) that are called `name`."""
        if self.frame_check is None:
            return ()
        return self.frame_check.warnings(positions, name)

    def calibration_warnings(
        self, positions: NDArray[np.float32], name: str
    ) -> tuple[InputWarning, ...]:
        """Likewise, of a frame to calibrate by, beside those."""
        if self.frame_check is None:
            return ()
        return self.frame_check.calibration_warnings(positions, name)

    def check_address(self, address: TileAddress) -> int:
        """The texels per side of a tile. Raises NotFoundError where the tile does not exist, and
        what `check_ready` raises."""
        self.check_ready()
        self.dimensions.check(address)
        return self.settings.grid.texels(address.level)


class AssetRegistry:
    """Assets by id. Looking one up never waits for a device or a disk.

    elsewhere: brings the asset of an id that is not registered, or raises NotFoundError.
    """

    def __init__(self, frame_memory: int) -> None:
        self.frame_memory = FrameMemory(frame_memory)
        self.elsewhere: Callable[[str], Asset] = _nowhere
        self._lock = threading.Lock()
        self._assets: dict[str, Asset] = {}

    def find(self, id: str) -> Asset | None:
        """The asset of an id, or None where it is not registered."""
        with self._lock:
            return self._assets.get(id)

    def get(self, id: str) -> Asset:
        """The asset of an id, brought from elsewhere where it is not registered; raises
        NotFoundError, and FetchingError while it is brought."""
        found = self.find(id) or self.elsewhere(id)
        found.called = time.monotonic()
        return found

    def all(self) -> list[Asset]:
        """Every asset, in the order of registration."""
        with self._lock:
            return list(self._assets.values())

    def replace(self, old: Asset | None, new: Asset | None) -> bool:
        """Register `new` in place of `old`, each of which may be None. Returns False, and changes
        nothing, where `old` is not what is registered now."""
        id = (new or old).id  # type: ignore[union-attr]
        with counted().changing(id), self._lock:
            if self._assets.get(id) is not old:
                return False
            if new is None:
                self._assets.pop(id, None)
            else:
                self._assets[id] = new
        return True


def _nowhere(id: str) -> Asset:
    raise NotFoundError(f"no asset {id!r}")
