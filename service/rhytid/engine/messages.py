"""Arguments and results of the engine: settings, ids and arrays, nothing on a device.

Because these are plain values, an engine can live in another process or on another machine
without its callers noticing. A `TilePlan` alone holds a function, the one that draws.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions, Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.methods import DISPLACEMENT, LAYERS, METHODS, SAMPLINGS, STRETCH_MODELS
from rhytid.domain.notices import Notice
from rhytid.domain.painted_maps import Controls, Stiffness
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.domain.tiles import TileAddress, TileGrid
from rhytid.domain.warnings import InputWarning
from rhytid.errors import NotFoundError, QueryError
from rhytid.formats.tile_header import TileHeader

# Displacement (n, n), mesh units, row 0 at the top.
Tile = NDArray[np.float32]
Halves = NDArray[np.float16]
# The states of a job in which nothing more will happen.
ENDED_STATES = ("done", "failed", "cancelled")
# What the detail of a job says whose work began anew.
STARTED_AGAIN = "started again, since the device's process ended"


@dataclass(frozen=True)
class Refusal:
    """Why a request or a build is not tried again.  until: when it may be, in seconds of the
    monotonic clock, which the processes of a machine share."""

    reason: str
    until: float

    @property
    def holds(self) -> bool:
        """Whether it is still in force."""
        return time.monotonic() < self.until


@dataclass(frozen=True, eq=False)
class NewAsset:
    """A neutral mesh to build an asset from.

    graph: its wrinkles; None: they are synthesised. One that was made for another mesh is refused
    unless `force`.  stiffness: None: 1 everywhere.  frames: (N, V, 3) float32, stored as frames
    0001, 0002, … once the asset exists; less the centre of the mesh, as positions are throughout
    the engine.  shapes: expressions that lines grow by, unless `graph.lines` of the settings says
    otherwise; without a graph only.  folds: what `measured_folds` gives of them with these
    settings, where the caller has that; None has it measured.  residual: of a traced graph.  scan:
    traced to a graph and a residual, in place of both.  noted: warnings of the scan.  unused,
    notices: of what was sent and is not read.
    """

    mesh: Mesh
    settings: AssetSettings = field(default_factory=AssetSettings)
    graph: WrinkleGraph | None = None
    frames: NDArray[np.float32] | None = None
    stiffness: Stiffness | None = None
    controls: Controls | None = None
    force: bool = False
    shapes: Expressions | None = None
    folds: Folds | None = None
    residual: Residual | None = None
    scan: ScanRelief | None = None
    noted: tuple[InputWarning, ...] = ()
    unused: tuple[InputWarning, ...] = ()
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class AssetDimensions:
    """Sizes of an asset, which its id stands for: they never change.

    vertices, triangles: of its mesh; 0 of an asset of which only the failure is known.  udims:
    those of its mesh.  grid: how its maps are cut.  centre: what was subtracted from its positions
    as they were sent.
    """

    id: str
    vertices: int
    triangles: int
    udims: tuple[int, ...]
    grid: TileGrid
    centre: tuple[float, ...]

    def check(self, address: TileAddress) -> None:
        """Raise NotFoundError where there is no such tile."""
        if address.udim not in self.udims:
            have = ", ".join(str(udim) for udim in self.udims) or "none"
            raise NotFoundError(f"UDIM {address.udim} has no mesh; asset {self.id} has {have}")
        self.grid.check(address)


@dataclass(frozen=True)
class TileDescription:
    """A tile or a map, not drawn.

    key: names its content; two with the same key have the same bytes.  header: what a file of it
    says of itself.  side: texels per side.
    """

    key: str
    header: TileHeader
    side: int


@dataclass(frozen=True, eq=False)
class TilePlan:
    """A tile or a map that is named and not drawn yet.

    draw: draws its displacement (n, n) float32, mesh units, row 0 at the top, or its moments
    (n, n, 5); raises BusyError where too many calls wait for the device.
    """

    description: TileDescription
    draw: Callable[[], Tile]

    @property
    def key(self) -> str:
        """The key of its content."""
        return self.description.key

    @property
    def header(self) -> TileHeader:
        """The header of a file of it."""
        return self.description.header


@dataclass(frozen=True, eq=False)
class MapPlan(TilePlan):
    """A whole level that is named and not drawn yet.

    draw_halves: as `draw`, as half floats, rounded to even, infinite where they cannot hold a
    number: half as much to read from the device.
    """

    draw_halves: Callable[[], Halves]


@dataclass(frozen=True, eq=False)
class HalfTile:
    """A tile of displacement (n, n) as half floats, rounded to even, and its header."""

    tile: Halves
    header: TileHeader


@dataclass(frozen=True, eq=False)
class DrawnTile:
    """A tile or a map.

    tile: displacement (n, n) float32, mesh units, row 0 at the top, or moments of slopes (n, n, 5)
    in the order of `pipeline/slopes.py`.  description: what it was planned as.  key: the key that
    the same place had once it was drawn: where it is another, the asset or the frame was changed
    meanwhile, and the tile may be of either.
    """

    tile: NDArray[np.float32]
    description: TileDescription
    key: str


@dataclass(frozen=True)
class AssetContent:
    """Names what is stored of an asset: two with the same `key` have the same graph and mesh.
    nbytes: bytes of its files."""

    key: str
    nbytes: int


@dataclass(frozen=True)
class AssetInfo:
    """An asset as a caller sees it.

    state: building, ready or failed (with `reason`).  levels: how many levels its maps have.
    pores, wrinkles: how many there are, copies at UV seams not counted; 0 until the graph exists.
    statistics: None until then; "spacing" of pores where density is 1, in mesh units, as the
    metadata of the graph have it; "distance", the mean distance of pores on the surface as it came
    out; "degree", the mean number of wrinkles at a pore; "strengths", wrinkles by weight, in tenths
    from 0 to 1; "events", single features by kind, which are no pores.  warnings: of what is
    probably wrong with the mesh.  notices: facts about its present settings that are worth knowing
    and no mistake.  centre: the point that was subtracted from its positions as they were sent, and
    is subtracted from those of its frames.
    """

    id: str
    state: str
    job: str | None
    reason: str | None
    settings: dict[str, Any]
    udims: tuple[int, ...]
    levels: int
    vertices: int
    triangles: int
    pores: int
    wrinkles: int
    statistics: dict[str, Any] | None = None
    warnings: tuple[InputWarning, ...] = ()
    notices: tuple[Notice, ...] = ()
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class FollowedAsset:
    """An asset that is as the shared store has it, or builds.

    manifest: SHA-256 of the manifest that says the same of it; empty where it is not ready.
    replaced: whether it was fetched anew: it has no frames then.
    """

    info: AssetInfo
    manifest: str
    replaced: bool


@dataclass(frozen=True)
class JobInfo:
    """Long work.

    state: queued, running, done, failed or cancelled.  progress: from 0 to 1.  warnings: of a
    calibration, about its frame.
    """

    id: str
    asset: str
    kind: str
    state: str
    progress: float
    stage: str
    detail: str
    warnings: tuple[InputWarning, ...] = ()


@dataclass(frozen=True)
class FrameInfo:
    """A stored frame and the percentiles of its clamped log stretch, over triangles and axes.

    log_stretch: maps "p1", "p10", "p50", "p90", "p99" and "abs_p90" to values.  warnings: of what
    is probably wrong with it.
    """

    name: str
    log_stretch: dict[str, float]
    warnings: tuple[InputWarning, ...] = ()


@dataclass(frozen=True)
class MapQuery:
    """Chooses a displacement by the method, the stretch model and the sampling (sections 3 and 7),
    and what of it is asked for."""

    method: str = "redraw"
    stretch: str = "tensor"
    sampling: str = "nearest"
    layer: str = DISPLACEMENT

    def __post_init__(self) -> None:
        for name, known in _QUERY.items():
            value = getattr(self, name)
            if value not in known:
                raise QueryError(f"{name} {value!r}: one of {', '.join(known)}")


_QUERY = {
    "method": METHODS, "stretch": STRETCH_MODELS, "sampling": SAMPLINGS, "layer": LAYERS,
}  # fmt: skip


@dataclass(frozen=True)
class DeviceInfo:
    """An OpenCL device; memory in bytes. `used` and `budget` are ours, not the driver's.

    restarts: of the process that computes on it, where it has one of its own.
    """

    name: str
    platform: str
    kind: str
    version: str
    compute_units: int
    memory: int
    budget: int
    used: int
    selected: bool
    restarts: int = 0


@dataclass(frozen=True, eq=False)
class FrameStretch:
    """axes (F, 2, 2) float32 with axes[f, i] = ŝᵢ; ratios (F, 2) float32, unclamped; folds (F,)
    float32, the share that folds of the mesh take of negative log stretch before lines answer."""

    axes: NDArray[np.float32]
    ratios: NDArray[np.float32]
    folds: NDArray[np.float32]


@dataclass(frozen=True)
class Package:
    """A skin package on disk, as one zip.

    key: two packages with the same key have the same bytes.  file: the zip, on the machine of the
    engine.  files: the ranges of their bytes in the zip, by path in the package.
    """

    key: str
    file: Path
    nbytes: int
    files: dict[str, range]
