"""Skin packages of assets: made once, as jobs, and kept on disk."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.asset_service import AssetService
from rhytid.engine.assets import Asset
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.engine.keys import package_key
from rhytid.engine.messages import JobInfo, Package
from rhytid.engine.tile_service import TileService
from rhytid.errors import (
    CancelledError,
    ChangedError,
    ConflictError,
    LimitError,
    NotFoundError,
    SettingsError,
)
from rhytid.exports.skin_package.maps import SkinMaps, check_settings
from rhytid.exports.skin_package.package import PackageWriter, package_version
from rhytid.exports.skin_package.texture_arrays import MOST_SIDE
from rhytid.storage.store import AssetStore

# Seconds that a caller waits for a package before it is told of the job.
PATIENCE = 1.0


@dataclass(frozen=True)
class _Wanted:
    """A package that is to be made."""

    asset: Asset
    levels: int
    key: str


@dataclass
class _PackageJob:
    """The job that makes a package, and what it failed with."""

    job: Job
    error: BaseException | None = None


@dataclass(frozen=True)
class _Source:
    """What packages are made from."""

    assets: AssetService
    tiles: TileService


class PackageService:
    """Gives the packages of ready assets; makes them where they are not there.

    memory: what making one takes is held of it.
    """

    def __init__(
        self,
        registry: AssetRegistry,
        assets: AssetService,
        tiles: TileService,
        store: AssetStore,
        jobs: Jobs,
        memory: ByteBudget,
    ) -> None:
        self._assets, self._store, self._jobs, self._memory = registry, store, jobs, memory
        self._source = _Source(assets, tiles)
        self._lock = threading.Lock()
        self._unfinished: dict[str, _PackageJob] = {}

    def of(
        self, asset: str, levels: int = 1, key: str | None = None, begin: bool = True
    ) -> Package | JobInfo | None:
        """The package of an asset with so many levels of its maps; the job that makes it, where
        that takes longer than a second.  key: that of the package that the caller has begun to
        read.  begin: start that job; otherwise None where there is neither.

        Raises ChangedError where the package has another key now, ConflictError where packages do
        not know a setting of the asset, LimitError where it is larger than the packages that are
        kept may be, HostMemoryError and HostBusyError for lack of memory, and what the job fails
        with meanwhile.
        """
        found = self._assets.get(asset)
        while True:
            found.check_ready()
            wanted = self._wanted(found, levels)
            if key is not None and key != wanted.key:
                raise ChangedError(
                    f"the asset has changed: begin again (its package is {wanted.key}, not {key})"
                )
            if (kept := self._store.packages.find(asset, wanted.key)) is not None:
                return Package(wanted.key, kept.file, kept.nbytes, kept.files)
            making = self._job_of(wanted, begin)
            if making is None:
                return None
            if not making.job.wait(PATIENCE):
                return making.job.info
            if (state := making.job.info.state) != "done":
                found.check_known()  # what it failed with may follow from that
                raise making.error or CancelledError(f"the job of the package was {state}")

    def _wanted(self, asset: Asset, levels: int) -> _Wanted:
        """Levels beyond one texel are none, and change no key."""
        levels = min(levels, min(asset.settings.resolution, MOST_SIDE).bit_length())
        shapes = self._store.shapes_digests(asset.id)
        written_by = f"{self._source.tiles.drawn_by} {package_version()}"
        key = package_key(asset.id, asset.settings, shapes, levels, written_by)
        return _Wanted(asset, levels, key)

    def _job_of(self, wanted: _Wanted, begin: bool) -> _PackageJob | None:
        """The job that makes a package: the one that does already, or a new one where `begin`."""
        with self._lock:
            if (making := self._unfinished.get(wanted.key)) is not None or not begin:
                return making
            with _refused(wanted.asset):
                check_settings(wanted.asset.settings)
            # Never small: the thread of small jobs gives builds and frames their turn at once.
            begun = threading.Event()
            work = partial(self._work, wanted, begun)
            job = self._jobs.start("package", wanted.asset.id, work)
            making = self._unfinished[wanted.key] = _PackageJob(job)
            begun.set()
        job.when_ended(partial(self._ended, wanted.key))
        return making

    def _ended(self, key: str) -> None:
        del self._unfinished[key]

    def _work(self, wanted: _Wanted, begun: threading.Event, job: Job) -> None:
        begun.wait()
        making = self._unfinished[wanted.key]
        hold = self._memory.hold("jobs")
        try:
            job.progress(0.0, "reading the asset")
            with _refused(wanted.asset):
                maps = SkinMaps.of(self._source, wanted.asset.id)  # it may have to be loaded
            shapes = None
            with suppress(NotFoundError):  # none came
                shapes = self._store.shapes(wanted.asset.id)
            mesh = self._store.mesh(wanted.asset.id)
            with self._store.packages.making(wanted.asset.id) as folder:
                writer = PackageWriter(maps, mesh, shapes, folder, wanted.levels)
                hold.grow(writer.host_bytes)
                self._write(job, wanted, writer)
                self._keep(job, wanted, folder)
        except BaseException as error:
            making.error = error
            raise
        finally:
            hold.release()

    def _write(self, job: Job, wanted: _Wanted, writer: PackageWriter) -> None:
        self._store.packages.make_room(writer.texture_bytes)
        steps = writer.steps()
        for done, step in enumerate(steps):
            part = f"part {done + 1} of {len(steps)}"
            job.progress(done / len(steps), "writing the package", part)
            self._check(wanted)
            step()

    def _keep(self, job: Job, wanted: _Wanted, folder: Path) -> None:
        packages = self._store.packages
        # Both raise where the job was cancelled.
        packages.seal(folder, partial(job.progress, 1.0, "writing the package"))
        job.progress(1.0, "writing the package")
        with wanted.asset.kept():
            self._check(wanted)
            packages.keep(wanted.asset.id, wanted.key, folder)

    def _check(self, wanted: _Wanted) -> None:
        """Raise CancelledError where the asset has changed since its package was begun."""
        if self._wanted(wanted.asset, wanted.levels).key != wanted.key:
            asset = wanted.asset.id
            raise CancelledError(f"asset {asset} was changed: ask for its package again")


@contextmanager
def _refused(asset: Asset) -> Iterator[None]:
    """What a package cannot hold is not possible in the present state of the asset."""
    try:
        yield
    except (SettingsError, LimitError) as error:
        raise ConflictError(f"asset {asset.id} cannot be packaged: {error}") from error
