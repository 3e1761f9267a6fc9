"""Skin packages of assets: made once, as jobs, and kept on disk."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial

from rhytid import __version__
from rhytid.engine.asset_registry import AssetRegistry
from rhytid.engine.asset_service import AssetService
from rhytid.engine.assets import Asset
from rhytid.engine.jobs import Job, Jobs
from rhytid.engine.keys import package_key
from rhytid.engine.messages import JobInfo, Package
from rhytid.engine.tile_service import TileService
from rhytid.errors import CancelledError, ConflictError, LimitError, NotFoundError, SettingsError
from rhytid.skin_package.maps import SkinMaps, check_settings
from rhytid.skin_package.package import PackageWriter
from rhytid.storage.packages import files
from rhytid.storage.store import AssetStore

# Seconds that a caller waits for a package before it is told of the job.
PATIENCE = 1.0


@dataclass
class _Making:
    """A job, and what it failed with."""

    job: Job
    error: BaseException | None = None


@dataclass(frozen=True)
class _Source:
    """What packages are made from."""

    assets: AssetService
    tiles: TileService


class PackageService:
    """Gives the packages of ready assets; makes them where they are not there."""

    def __init__(
        self,
        registry: AssetRegistry,
        assets: AssetService,
        tiles: TileService,
        store: AssetStore,
        jobs: Jobs,
    ) -> None:
        self._assets, self._store, self._jobs = registry, store, jobs
        self._source = _Source(assets, tiles)
        self._lock = threading.Lock()
        self._making: dict[tuple[str, str], _Making] = {}

    def of(self, asset: str, levels: int = 1) -> Package | JobInfo:
        """The package of an asset with so many levels of its maps; the job that makes it, where
        that takes longer than a second.

        Raises ConflictError where packages do not know a setting of the asset, LimitError where it
        is larger than the packages that are kept may be, and what the job fails with meanwhile.
        """
        found = self._assets.get(asset)
        while True:
            found.check_ready()
            key = self._key(found, levels)
            if (kept := self._kept(asset, key)) is not None:
                return kept
            making = self._made(found, key, levels)
            if not making.job.wait(PATIENCE):
                return making.job.info
            if (state := making.job.info.state) != "done":
                raise making.error or CancelledError(f"the job of the package was {state}")

    def _key(self, asset: Asset, levels: int) -> str:
        shapes = self._store.shapes_digests(asset.id)
        drawn_by = self._source.tiles.drawn_by
        return package_key(asset.id, asset.settings, shapes, levels, drawn_by, __version__)

    def _kept(self, asset: str, key: str) -> Package | None:
        folder = self._store.packages.find(asset, key)
        if folder is None:
            return None
        found = dict(files(folder))
        # Without its manifest it is being removed.
        return Package(key, folder, found) if "manifest.json" in found else None

    def _made(self, asset: Asset, key: str, levels: int) -> _Making:
        """The job that makes a package: the one that does already, or a new one."""
        name = asset.id, key
        with self._lock:
            making = self._making.get(name)
            if making is not None and not making.job.ended:
                return making
            with _refused(asset):
                check_settings(asset.settings)
            begun = threading.Event()
            work = partial(self._work, name, begun, asset, levels)
            job = self._jobs.start("package", asset.id, work, small=asset.small)
            made = self._making[name] = _Making(job)
            begun.set()
            job.when_ended(partial(self._ended, name, made))
            return made

    def _ended(self, name: tuple[str, str], made: _Making) -> None:
        if self._making.get(name) is made:
            del self._making[name]

    def _work(
        self, name: tuple[str, str], begun: threading.Event, asset: Asset, levels: int, job: Job
    ) -> None:
        begun.wait()
        making = self._making[name]
        try:
            self._write(job, name[1], asset, levels)
        except BaseException as error:
            making.error = error
            raise

    def _write(self, job: Job, key: str, asset: Asset, levels: int) -> None:
        job.progress(0.0, "reading the asset")
        with _refused(asset):
            maps = SkinMaps.of(self._source, asset.id)
        shapes = None
        with suppress(NotFoundError):  # none came
            shapes = self._store.shapes(asset.id)
        mesh, packages = self._store.mesh(asset.id), self._store.packages
        with packages.making(asset.id) as folder:
            writer = PackageWriter(maps, mesh, shapes, folder, levels)
            packages.make_room(writer.texture_bytes)
            steps = writer.steps()
            for done, step in enumerate(steps):
                part = f"part {done + 1} of {len(steps)}"
                job.progress(done / len(steps), "writing the package", part)
                self._check(asset, key, levels)
                step()
            job.progress(1.0, "writing the package")  # raises where it was cancelled
            with asset.kept():
                self._check(asset, key, levels)
                packages.keep(asset.id, key, folder)

    def _check(self, asset: Asset, key: str, levels: int) -> None:
        """Raise CancelledError where the asset has changed since its package was begun."""
        if self._key(asset, levels) != key:
            raise CancelledError(f"asset {asset.id} was changed: ask for its package again")


@contextmanager
def _refused(asset: Asset) -> Iterator[None]:
    """What a package cannot hold is not possible in the present state of the asset."""
    try:
        yield
    except (SettingsError, LimitError) as error:
        raise ConflictError(f"asset {asset.id} cannot be packaged: {error}") from error
