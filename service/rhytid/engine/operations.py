"""What an engine can be asked for: one method per operation, declared once.

A method of a protocol below is the signature and the documentation of an operation; the decorator
above it is its row (`engine/operation.py`): what it addresses and what it does. A new operation
takes three places: its row here, the method of the engine, and the route that asks for it, whose
scope stands in `api/access.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, Protocol, cast

from numpy import float32, integer
from numpy.typing import ArrayLike, NDArray

from rhytid.device.figures import Figures
from rhytid.domain.bin_manifest import BinManifest
from rhytid.domain.expressions import Expressions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.graph_geometry import Curves
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import MapAddress, TileAddress
from rhytid.domain.warnings import InputWarning
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.changes import Mark
from rhytid.engine.frames import Frame
from rhytid.engine.messages import (
    AssetContent,
    AssetDimensions,
    AssetInfo,
    DeviceInfo,
    DrawnTile,
    FollowedAsset,
    FrameInfo,
    FrameStretch,
    HalfTile,
    JobInfo,
    MapQuery,
    NewAsset,
    Package,
    TileDescription,
)
from rhytid.engine.operation import Operations
from rhytid.storage.snapshots import Readable, Snapshot

OPERATIONS = Operations()
operation = OPERATIONS.operation


class Assets(Protocol):
    """Creates assets; answers what they are; changes, calibrates and removes them."""

    @operation("content", "create")
    def create(
        self,
        new: NewAsset,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
        hold: Hold | None = None,
    ) -> AssetInfo:
        """Take a mesh in; the build runs as a job. The same content again: the same asset.

        Named shapes are kept beside it, in place of those that came before.

        The answer warns of the mesh, of the frames that came with it, of settings of a known asset
        that were changed since, and of those without effect. strict: raise StrictError instead,
        before anything is kept, of warnings whose codes are not in `allow`.  hold: counts the bytes
        of the frames already, as far as it has any; the job that stores them takes these over.

        Raises GraphError where a given graph does not fit the mesh or was made for another, unless
        `force`; SettingsError where its lengths are of a unit that cannot be converted, or a graph
        is to be grown in one that is not known; LimitError where it covers too many texels or its
        maps take too long to draw, QueryError for a code of `allow` that there is not, MeshError
        where the mesh has no UV inside the range of UDIMs, InputError where a painted map is of a
        UDIM without mesh or `graph.lines` asks for expressions and none came, what `check_amount`
        does.
        """

    @operation("assets")
    def all(self) -> list[AssetInfo]:
        """Describes every asset."""

    @operation("asset")
    def info(self, asset: str) -> AssetInfo:
        """Describes one asset."""

    @operation("asset", constant=True)
    def dimensions(self, asset: str) -> AssetDimensions:
        """The sizes of an asset, in whatever state it is."""

    @operation("asset", "change")
    def change(self, asset: str, changes: Mapping[str, Any]) -> AssetInfo:
        """Change response, shape, depth, angles, preset, bins or convolve, with which tiles and
        keys change, or the name, on which nothing depends.

        A `preset` sets the bins but for `r_max`; keys of `bins` beside it override it. None for
        `depth`, `convolve.sigma` or `shape.wave_frequency` means the default again: the value in
        the file of a given graph, else a value in proportion to the spacing. Raises SettingsError
        for settings that cannot be changed.
        """

    @operation("asset", "remove")
    def delete(self, asset: str, *, shared: bool = False) -> None:
        """Remove an asset from memory, device and disk, and cancel its jobs.

        shared: remove it from the shared store, too, even if it is there alone; otherwise it stays
        there. Raises QueryError where there is no shared store.
        """

    @operation("asset", "drop")
    def follow(self, asset: str, *, replace: bool) -> FollowedAsset | None:
        """Have an asset as the shared store has it, where another machine has changed it there; one
        that builds, or was changed here and not pushed since, stays as it is.

        None, and nothing is done, where more than its settings differs, unless `replace`: then it
        is fetched anew, without its frames. Raises NotFoundError where it was removed there, and
        here it is removed then, too; what the shared store raises.
        """

    @operation("asset", "drop")
    def leave(self, asset: str) -> bool:
        """Drop an asset and its frames from this machine, where the shared store has it whole and
        nobody uses it; whether it is not here now."""

    @operation("asset")
    def content(self, asset: str) -> AssetContent:
        """The key and the size of what `graph`, `mesh` and `curves` of a ready asset return now;
        reads none of these."""

    @operation("asset")
    def graph(self, asset: str) -> WrinkleGraph:
        """The wrinkle graph of a ready asset, with the seed and the lengths that it is drawn with
        now."""

    @operation("asset")
    def mesh(self, asset: str) -> Mesh:
        """The neutral mesh of a ready asset, out of the store."""

    @operation("asset")
    def shapes(self, asset: str) -> Expressions:
        """The named shapes that came with the mesh of a ready asset, out of the store.

        Raises NotFoundError where none came.
        """

    @operation("asset")
    def shapes_nbytes(self, asset: str) -> int:
        """Bytes of the shapes that `shapes` returns, which are not read; raises what it raises."""

    @operation("asset")
    def curves(self, asset: str) -> Curves:
        """The wrinkles of a ready asset as lines in space; wrinkles with an end off the mesh are
        left out."""

    @operation("asset")
    def calibrate(
        self,
        asset: str,
        positions: ArrayLike,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> JobInfo:
        """Set r_max from a frame (section 2.4) and make the bins anew, as a job.

        The job warns of the frame; strict: raise StrictError instead, unless the code of every
        warning is in `allow`.
        """


class Frames(Protocol):
    """Stores, lists, reads and deletes frames, and measures their stretch."""

    @operation("frame", "change")
    def put(
        self,
        asset: str,
        frame: str,
        positions: ArrayLike | Frame,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> FrameInfo:
        """Store positions (V, 3) under a name, in place of the frame that had it.

        The answer warns of what is probably wrong with them; strict: raise StrictError instead, and
        store nothing, unless the code of every warning is in `allow`.

        Raises QueryError for a code that does not exist, FrameError naming the count or the vertex,
        ReadOnlyError for `neutral`, FrameMemoryError where the memory for frames is full.
        """

    @operation("asset")
    def warnings(
        self,
        asset: str,
        positions: ArrayLike | Frame,
        *,
        strict: bool = False,
        allow: Collection[str] = (),
    ) -> tuple[InputWarning, ...]:
        """Warnings of what is probably wrong with positions (V, 3) that are not stored.

        strict: raise StrictError where the code of one is not in `allow`.
        """

    @operation("frames")
    def all(self, asset: str) -> list[FrameInfo]:
        """Every frame of an asset, `neutral` first."""

    @operation("frame")
    def info(self, asset: str, frame: str) -> FrameInfo:
        """The stretch and the warnings of a frame."""

    @operation("frame")
    def positions(self, asset: str, frame: str) -> NDArray[float32]:
        """(V, 3) positions of a frame; those of the neutral mesh for `neutral`."""

    @operation("frame", "remove")
    def delete(self, asset: str, frame: str) -> None:
        """Delete a frame; raises ReadOnlyError for `neutral`."""

    @operation("frame")
    def stretch(self, asset: str, frame: str) -> FrameStretch:
        """Axes and unclamped ratios of every triangle in a frame (section 2.2)."""


class Tiles(Protocol):
    """Names and draws displacement: tiles, whole maps and precomputed maps.

    frame: the name of a stored frame, or a `Frame` that is not stored. Every method raises
    NotFoundError for what does not exist.
    """

    @operation("frame")
    def describe(
        self, asset: str, frame: str | Frame, query: MapQuery, place: TileAddress | MapAddress
    ) -> TileDescription:
        """What would be drawn; nothing is."""

    @operation("frame", spread=True)
    def draw(
        self, asset: str, frame: str | Frame, query: MapQuery, place: TileAddress | MapAddress
    ) -> DrawnTile:
        """The displacement of a tile or of a whole level of a UDIM; raises BusyError where too many
        wait for the device."""

    @operation("frame", spread=True)
    def draw_half(
        self, asset: str, frame: str | Frame, query: MapQuery, address: TileAddress
    ) -> HalfTile:
        """The displacement of a tile as half floats; raises what `draw` does, and QueryError where
        half floats cannot hold it."""

    @operation("asset")
    def bins(self, asset: str) -> BinManifest:
        """Describes the precomputed maps of an asset (section 2.4)."""

    @operation("asset")
    def bin_tile(
        self,
        asset: str,
        address: TileAddress,
        layer: str,
        bin: int | None = None,
        sample: int | None = None,
    ) -> NDArray[integer]:
        """(n, n) int8 or int16 codes of one precomputed map tile; displacement = code * step.

        bin, sample: needed where the layer has more than one. Of the cushions, n is the number of
        samples under the tile, with the apron around them; their owners are int32, rows of the
        graph.

        Raises NotFoundError above level 0, since precomputed maps have no coarser levels, only
        tiles blended from them; QueryError where bin or sample is missing.
        """


class Jobs(Protocol):
    """Long work in the background."""

    @operation("job")
    def info(self, id: str) -> JobInfo:
        """How far a job is; raises NotFoundError. Where the process that ran it has ended, a build
        is started again under the same id, and its detail says so; other jobs have failed."""

    @operation("job", "change")
    def cancel(self, id: str) -> JobInfo:
        """End a job that waits; ask a job at work to stop, which it does within a second. Raises
        NotFoundError."""


class Snapshots(Protocol):
    """Ready assets as files for other servers."""

    @operation("asset")
    def of(self, asset: str) -> Snapshot:
        """A ready asset as a file, which is the caller's to close."""

    @operation("content", "create")
    def restore(self, stream: Readable, nbytes: int) -> tuple[AssetInfo, bool]:
        """The asset of a snapshot of `nbytes` bytes, and whether it is new here.

        An asset that is known and did not fail stays as it is, its present settings too. Raises
        SnapshotError before anything is changed; StoreFormatError where another version stored it.
        """


class Packages(Protocol):
    """Skin packages of ready assets."""

    @operation("asset")
    def of(
        self, asset: str, levels: int = 1, key: str | None = None, begin: bool = True
    ) -> Package | JobInfo | None:
        """The package of an asset with `levels` levels of its maps; the job that makes it, where
        that takes longer than a second.

        key: of the package that the caller has begun to read.  begin: start that job; otherwise
        None where there is neither a package nor a job.

        Raises ChangedError where the package has another key now, ConflictError where packages
        cannot hold a setting of the asset, LimitError where it is larger than all packages together
        may be, HostMemoryError and HostBusyError for lack of memory, and the error that the job
        fails with meanwhile.
        """


class Engine(Protocol):
    """An engine, wherever it runs: in this process, in a supervised one, on a fleet.

    Blocking; safe from any thread. Every operation raises NotFoundError for an unknown id,
    NotReadyError while the asset builds, ConflictError where it failed to build, and BusyError
    where too many calls wait already. With a shared store it raises FetchingError while the asset
    is fetched, SharedDamageError and SharedStoreError; where the engine is in another process,
    DeviceLostError if that ended and no other answers in time, and FatalRequestError if it ended
    twice at the same call.

    memory: bytes that requests and jobs hold on this host.  figures: what each device does, by its
    number.
    """

    memory: ByteBudget

    @property
    def assets(self) -> Assets:
        """Operations on assets."""

    @property
    def frames(self) -> Frames:
        """Operations on frames."""

    @property
    def tiles(self) -> Tiles:
        """Operations on tiles and maps."""

    @property
    def jobs(self) -> Jobs:
        """Operations on jobs."""

    @property
    def snapshots(self) -> Snapshots:
        """Operations on snapshots."""

    @property
    def packages(self) -> Packages:
        """Operations on packages."""

    @property
    def figures(self) -> Mapping[str, Figures]:
        """What each device does, by its number."""

    @property
    def waiting(self) -> int:
        """Calls that are not answered yet."""

    @property
    def restarts(self) -> Mapping[str, int]:
        """How often the process of a device was started again, by what had ended it."""

    @operation("engine")
    def ready(self) -> bool:
        """Whether a kernel computes on the device, or on one of several. It goes before whatever
        waits; where a task takes long, true if one ends within five seconds."""

    @operation("engine")
    def devices(self) -> list[DeviceInfo]:
        """Every OpenCL device; budget and use are those of the selected ones, else 0."""

    def mark(self, asset: str, frame: str) -> Mark | None:
        """Counts of what was changed of an asset and a frame, whether they exist or not; None where
        the engine cannot tell now. Does not block."""

    def well(self) -> bool:
        """Whether the engine can still answer. Does not block."""

    def close(self) -> None:
        """End the engine, in bounded time; calls that wait raise DeviceLostError or BusyError."""


# Makes a call: an operation, then its arguments.
Call = Callable[..., Any]


class Proxy:
    """The operations of every part of an engine, each made by `call`, with the operation before its
    arguments."""

    def __init__(self, call: Call) -> None:
        self.assets = cast(Assets, _Part("assets", call))
        self.frames = cast(Frames, _Part("frames", call))
        self.tiles = cast(Tiles, _Part("tiles", call))
        self.jobs = cast(Jobs, _Part("jobs", call))
        self.snapshots = cast(Snapshots, _Part("snapshots", call))
        self.packages = cast(Packages, _Part("packages", call))


class _Part:
    def __init__(self, part: str, call: Call) -> None:
        for row in OPERATIONS.values():
            if row.part == part:
                setattr(self, row.method, partial(call, row))
