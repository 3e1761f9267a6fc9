"""Assets that commands use: built, of the store, or of a store that several machines share."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from rhytid.baking.run_warnings import RunWarnings
from rhytid.console import Stopwatch, note, share_bar, working
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
from rhytid.settings import ServiceSettings
from rhytid.synthesis.fields.build_size import BuildSize
from rhytid.synthesis.fields.capacity_check import check_amount

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.storage.shared.mirror import StoreMirror

# Seconds between two looks at how far a job is.
_SHOWN_SECONDS = 0.2


def build(engine: Engine, new: NewAsset, warned: RunWarnings) -> AssetInfo:
    """Have an asset built and return it ready; raises ConflictError with the reason if it fails."""
    asset = engine.assets.create(new)
    warned.settings(asset.warnings)
    if asset.state == "building" and new.graph is None:
        graph = new.settings.for_synthesis().graph
        wrinkles = check_amount(new.mesh, graph, new.controls, sys.maxsize)
        warned.note(str(BuildSize.of(new.mesh, wrinkles)))
        warned.notice(notice for notice in asset.notices if notice.code == LARGE_BUILD)
    job = None
    if asset.job is not None:
        job = _wait(engine.jobs.get(asset.job), "building")
        asset = engine.assets.info(asset.id)
    if asset.state == "failed":
        reason = asset.reason if job is None else _reason(job)
        raise ConflictError(f"the asset could not be built: {reason}")
    # Maps that are made ahead would be for a range that is not calibrated yet.
    engine.jobs.cancel_all(asset.id)
    engine.shared.push(asset.id)
    if new.graph is None and asset.statistics is not None:
        settings = AssetSettings.parse(asset.settings)
        warned.lengths(settings, asset.statistics["distance"])
    warned.notice(asset.notices)
    return asset


def stored(engine: Engine, id: str, mesh: Mesh, resolution: int | None = None) -> AssetInfo:
    """A built asset of the store, or the same skin at another resolution.

    Raises InputError where it is of another mesh, NotFoundError where it is not there, and
    ConflictError where it is not ready.
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
    """Fetch an asset from the shared store of the settings, before an engine opens the store; a
    step of its own. Does nothing where there is no shared store, or it lacks the asset."""
    from rhytid.storage.shared.mirror import StoreMirror
    from rhytid.storage.shared.shared_store import SharedStore
    from rhytid.storage.store import AssetStore

    if settings.shared_store is None:
        return
    shared, start = SharedStore.at(settings.shared_store), perf_counter()
    with (
        AssetStore(settings.store) as store,
        suppress(NotFoundError),
    ):  # told where the asset is used
        if bring(StoreMirror(store, shared), asset):
            watch.add("fetch", perf_counter() - start)


def bring(mirror: StoreMirror, asset: str) -> bool:
    """Fetch an asset of the shared store that the store lacks, or has older; whether it was
    fetched. Where the shared store cannot be used and the asset is here, it stays as it is, and the
    user is told."""
    try:
        with working(f"fetching asset {asset}"):
            return mirror.bring(asset, lambda share, file: None)
    except (SharedStoreError, SharedDamageError) as error:
        if not mirror.has(asset):
            raise
        note(f"rhytid: asset {asset} is taken as it is here: {error}")
        return False


def share(engine: Engine, asset: str) -> None:
    """Wait until the shared store, if there is one, has an asset as it is now. Where that fails the
    user is told: what was made of the asset is good."""
    job = engine.shared.push(asset)
    if job is None:
        return
    _wait(job, "pushing")
    if job.info.state != "done":
        note(f"rhytid: asset {asset} is not in the shared store: {job.reason or job.info.detail}")


def finish(engine: Engine, job: JobInfo, what: str) -> None:
    """Wait until a job is done; raises ConflictError with the reason if it fails."""
    ended = _wait(engine.jobs.get(job.id), what)
    if ended.info.state != "done":
        raise ConflictError(f"{what}: {_reason(ended)}")


def _reason(job: Job) -> str:
    """Why a job was not done, in full: a command tells its user what a server keeps to its log."""
    return job.reason or job.info.detail or job.info.state


def _wait(job: Job, what: str) -> Job:
    """A job that has ended; shows how far it is until then."""
    with share_bar(what) as show:
        while not job.wait(_SHOWN_SECONDS):
            show(job.info.progress, job.info.stage)
    return job
