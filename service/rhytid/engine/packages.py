"""Skin packages of assets: made once, as jobs, and kept on disk.

What writes them is imported when one is asked for: a process of a device need not wait for it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from typing_extensions import override

from rhytid.engine.assets.asset import Asset, AssetRegistry
from rhytid.engine.assets.service import AssetService
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.job import Job
from rhytid.engine.jobs import Jobs
from rhytid.engine.keys import package_key
from rhytid.engine.messages import JobInfo, Package
from rhytid.engine.operations import Packages
from rhytid.engine.tiles.service import TileService
from rhytid.errors import (
    CancelledError,
    ChangedError,
    ConflictError,
    LimitError,
    NotFoundError,
    SettingsError,
)
from rhytid.storage.store import AssetStore

if TYPE_CHECKING:
    from rhytid.exports.skin_package.package import PackageWriter

# Seconds that a caller waits for a package before it is told of the job.
PATIENCE = 1.0


@dataclass(frozen=True)
class _Request:
    """A package that is to be made."""

    asset: Asset
    levels: int
    key: str


@dataclass
class _PackageJob:
    """The job that makes a package, and the error that it failed with."""

    job: Job
    error: BaseException | None = None


@dataclass(frozen=True)
class _Source:
    """The calls that packages are made from."""

    assets: AssetService
    tiles: TileService


class PackageService(Packages):
    """Gives the packages of ready assets; makes those that do not exist yet.

    memory: the budget that holds what making a package takes.
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

    @override
    def of(
        self, asset: str, levels: int = 1, key: str | None = None, begin: bool = True
    ) -> Package | JobInfo | None:
        found = self._assets.get(asset)
        while True:
            found.check_ready()
            request = self._request(found, levels)
            if key is not None and key != request.key:
                raise ChangedError(
                    f"the asset has changed: begin again (its package is {request.key}, not {key})"
                )
            if (kept := self._store.packages.find(asset, request.key)) is not None:
                return Package(request.key, kept.file, kept.nbytes, kept.files)
            making = self._job_of(request, begin)
            if making is None:
                return None
            if not making.job.wait(PATIENCE):
                return making.job.info
            if (state := making.job.info.state) != "done":
                found.check_known()  # the asset may have been removed, which explains the error
                raise making.error or CancelledError(f"the job of the package was {state}")

    def _request(self, asset: Asset, levels: int) -> _Request:
        """The package that is to be made. Levels beyond one texel are none, and change no key."""
        from rhytid.exports.skin_package.package import package_version
        from rhytid.exports.skin_package.texture_arrays import MOST_SIDE

        levels = min(levels, min(asset.settings.resolution, MOST_SIDE).bit_length())
        shapes = self._store.shapes_digests(asset.id)
        written_by = f"{self._source.tiles.drawn_by} {package_version()}"
        key = package_key(asset.id, asset.settings, shapes, levels, written_by)
        return _Request(asset, levels, key)

    def _job_of(self, request: _Request, begin: bool) -> _PackageJob | None:
        """The job that makes a package: one that does already, or a new one where `begin`."""
        from rhytid.exports.skin_package.maps import check_settings

        with self._lock:
            if (making := self._unfinished.get(request.key)) is not None or not begin:
                return making
            with _refused(request.asset):
                check_settings(request.asset.settings)
            # Never small: the thread of small jobs gives builds and frames their turn at once.
            begun = threading.Event()
            work = partial(self._work, request, begun)
            job = self._jobs.start("package", request.asset.id, work)
            making = self._unfinished[request.key] = _PackageJob(job)
            begun.set()
        job.when_ended(partial(self._ended, request.key))
        return making

    def _ended(self, key: str) -> None:
        del self._unfinished[key]

    def _work(self, request: _Request, begun: threading.Event, job: Job) -> None:
        from rhytid.exports.skin_package.maps import SkinMaps
        from rhytid.exports.skin_package.package import PackageWriter

        begun.wait()
        making = self._unfinished[request.key]
        hold = self._memory.hold("jobs")
        try:
            job.progress(0.0, "reading the asset")
            with _refused(request.asset):
                maps = SkinMaps.of(self._source, request.asset.id)  # it may have to be loaded
            shapes = None
            with suppress(NotFoundError):  # none came
                shapes = self._store.shapes(request.asset.id)
            mesh = self._store.mesh(request.asset.id)
            with self._store.packages.making(request.asset.id) as folder:
                writer = PackageWriter(maps, mesh, shapes, folder, request.levels)
                hold.grow(writer.host_bytes)
                self._write(job, request, writer)
                self._keep(job, request, folder)
        except BaseException as error:
            making.error = error
            raise
        finally:
            hold.release()

    def _write(self, job: Job, request: _Request, writer: PackageWriter) -> None:
        self._store.packages.make_room(writer.texture_bytes)
        steps = writer.steps()
        for done, step in enumerate(steps):
            part = f"part {done + 1} of {len(steps)}"
            job.progress(done / len(steps), "writing the package", part)
            self._check(request)
            step()

    def _keep(self, job: Job, request: _Request, folder: Path) -> None:
        packages = self._store.packages
        # Both raise where the job was cancelled.
        packages.seal(folder, partial(job.progress, 1.0, "writing the package"))
        job.progress(1.0, "writing the package")
        with request.asset.kept():
            self._check(request)
            packages.keep(request.asset.id, request.key, folder)

    def _check(self, request: _Request) -> None:
        """Raise CancelledError where the asset has changed since its package was begun."""
        if self._request(request.asset, request.levels).key != request.key:
            asset = request.asset.id
            raise CancelledError(f"asset {asset} was changed: ask for its package again")


@contextmanager
def _refused(asset: Asset) -> Iterator[None]:
    """Raise ConflictError for settings of an asset that a package cannot hold."""
    try:
        yield
    except (SettingsError, LimitError) as error:
        raise ConflictError(f"asset {asset.id} cannot be packaged: {error}") from error
