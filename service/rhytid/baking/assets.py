"""Assets that commands use: built, from the store, or from a store that several machines share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from rhytid.baking.run_warnings import RunWarnings
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.notices import LARGE_BUILD
from rhytid.engine.job import Job
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset
from rhytid.errors import (
    ConflictError,
    InputError,
    NotFoundError,
    SharedDamageError,
    SharedStoreError,
)
from rhytid.support.console import Stopwatch, note, share_bar, working
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.build_size import BuildSize

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.storage.shared.mirror import StoreMirror

# Seconds between two looks at how far a job is.
_SHOWN_SECONDS = 0.2


def build(engine: Engine, new: NewAsset, warnings: RunWarnings) -> AssetInfo:
    """Build an asset, and return it when it is ready.

    Prints its warnings and notices. Raises ConflictError with the reason where the build fails, and
    StrictError where warnings are errors.
    """
    with working("checking the skin"):
        asset = engine.assets.create(new)
    warnings.settings(asset.warnings)
    grown = new.graph is None and new.scan is None
    wrinkles = engine.assets.expected_wrinkles(asset.id)
    if asset.state == "building" and grown and wrinkles is not None:
        warnings.note(str(BuildSize.of(new.mesh, wrinkles)))
        warnings.add_notices(notice for notice in asset.notices if notice.code == LARGE_BUILD)
    job = None
    if asset.job is not None:
        job = _wait(engine.jobs.get(asset.job), "building")
        asset = engine.assets.info(asset.id)
        warnings.settings(asset.warnings)
    if asset.state == "failed":
        reason = asset.reason if job is None else _reason(job)
        raise ConflictError(f"the asset could not be built: {reason}")
    # Maps that are made ahead would be for a range that is not calibrated yet.
    engine.jobs.cancel_all(asset.id)
    engine.shared.push(asset.id)
    if grown and asset.statistics is not None:
        settings = AssetSettings.parse(asset.settings)
        warnings.lengths(settings, asset.statistics["spacing"], asset.wrinkles)
    warnings.add_notices(asset.notices)
    return asset


def stored(engine: Engine, id: str, mesh: Mesh, resolution: int | None = None) -> AssetInfo:
    """Return a built asset of the store, resized to `resolution` texels per side if given.

    Raises NotFoundError where the store lacks it, ConflictError where it is not ready, and
    InputError where it is of another mesh.
    """
    asset = engine.assets.info(id)
    if asset.state != "ready":
        raise ConflictError(f"asset {id} is not built: {asset.reason or asset.state}")
    if not engine.assets.mesh(id).same(mesh):
        raise InputError(f"asset {id} is of another mesh than --mesh")
    if resolution in (None, asset.settings["resolution"]):
        return asset
    resized = engine.assets.resized(id, resolution)
    if resized.job is not None:
        finish(engine, engine.jobs.get(resized.job).info, "resizing")
    engine.jobs.cancel_all(resized.id)
    return engine.assets.info(resized.id)


@contextmanager
def naming_store(store: Path) -> Iterator[None]:
    """Within the block, a NotFoundError names the folder of the store, too."""
    try:
        yield
    except NotFoundError as error:
        raise NotFoundError(f"{error}; the store is {store}") from error


def fetch(settings: ServiceSettings, asset: str, watch: Stopwatch) -> None:
    """Fetch an asset from the shared store of the settings into the store.

    No engine may have the store open. Does nothing where there is no shared store, or where it
    lacks the asset. The time is a step of `watch`.
    """
    from rhytid.storage.shared.mirror import StoreMirror
    from rhytid.storage.shared.shared_store import SharedStore
    from rhytid.storage.store import AssetStore

    if settings.shared_store is None:
        return
    shared, start = SharedStore.at(settings.shared_store), perf_counter()
    # That it is in neither is an error where the asset is used.
    with AssetStore(settings.store) as store, suppress(NotFoundError):
        if bring(StoreMirror(store, shared), asset):
            watch.add("fetch", perf_counter() - start)


def bring(mirror: StoreMirror, asset: str) -> bool:
    """Fetch an asset that the store lacks or has in another version; return whether it was fetched.

    Where the shared store cannot be used but the store has the asset, that one is kept, and a note
    says so. Else raises SharedStoreError or SharedDamageError.
    """
    try:
        with working(f"fetching asset {asset}"):
            return mirror.bring(asset, lambda share, file: None)
    except (SharedStoreError, SharedDamageError) as error:
        if not mirror.has(asset):
            raise
        note(f"rhytid: asset {asset} is taken as it is here: {error}")
        return False


def share(engine: Engine, asset: str) -> None:
    """Push an asset to the shared store, if there is one, and wait until it is there.

    A failure is only noted: the asset itself is good.
    """
    job = engine.shared.push(asset)
    if job is None:
        return
    _wait(job, "pushing")
    if job.info.state != "done":
        note(f"rhytid: asset {asset} is not in the shared store: {job.reason or job.info.detail}")


def finish(engine: Engine, job: JobInfo, what: str) -> None:
    """Wait until a job is done. Raises ConflictError with the reason where it fails."""
    ended = _wait(engine.jobs.get(job.id), what)
    if ended.info.state != "done":
        raise ConflictError(f"{what}: {_reason(ended)}")


def _reason(job: Job) -> str:
    """Why a job was not done, in full: the user of a command may read what a server only logs."""
    return job.reason or job.info.detail or job.info.state


def _wait(job: Job, what: str) -> Job:
    """Show the progress of a job until it has ended, and return it."""
    with share_bar(what) as show:
        while not job.wait(_SHOWN_SECONDS):
            show(job.info.progress, _shown_stage(job.info))
    return job


def _shown_stage(info: JobInfo) -> str:
    """The stage of a job, and what it waits for while nothing of it is done."""
    waiting = info.detail if info.progress == 0.0 else ""
    return f"{info.stage} ({waiting})" if waiting else info.stage
