"""Assets that can be drawn, built or out of the store, and the jobs that a command waits for."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rhytid.cli.progress import share_bar
from rhytid.cli.warned import Warned
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.notices import LARGE_BUILD
from rhytid.engine.job import Job
from rhytid.engine.messages import AssetInfo, JobInfo, NewAsset
from rhytid.errors import ConflictError, InputError
from rhytid.synthesis.build_size import BuildSize
from rhytid.synthesis.capacity import check_amount

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine

# Between two looks at how far a job is.
_SHOWN_SECONDS = 0.2


def build(engine: Engine, new: NewAsset, warned: Warned) -> AssetInfo:
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
