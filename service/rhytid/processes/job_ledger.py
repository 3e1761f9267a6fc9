"""Jobs whose ids callers have, kept by the server: they outlive the process that ran them."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace

from rhytid.engine.messages import ENDED_STATES, STARTED_AGAIN, AssetInfo, JobInfo
from rhytid.errors import NotFoundError
from rhytid.processes.wire import BuildChanged

_REMEMBERED = 1000
_LOST = "the process of the device was restarted"


@dataclass
class _Known:
    info: JobInfo
    # Whether the process that ran it has ended.
    lost: bool = False


class JobLedger:
    """Jobs by id, as they were when somebody asked last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._jobs: OrderedDict[str, _Known] = OrderedDict()
        # The jobs that build assets, by asset: they go on in the next process.
        self._builds: dict[str, str] = {}

    def keep(self, info: JobInfo) -> JobInfo:
        """Remember a job as it is; the job itself. A job that is lost stays as it was when its
        process ended: what became of it since has another id there."""
        with self._lock:
            known = self._jobs.get(info.id)
            if known is None or not known.lost:
                self._jobs[info.id] = _Known(info)
            self._jobs.move_to_end(info.id)
            while len(self._jobs) > _REMEMBERED:
                self._jobs.popitem(last=False)
        return info

    def note(self, id: str, asset: str) -> None:
        """Remember the build of an asset, where it is not known yet."""
        if self.find(id) is None:
            self.keep(JobInfo(id, asset, "build", "queued", 0.0, "", ""))

    def find(self, id: str) -> JobInfo | None:
        """A job as it was last; None where it is not remembered."""
        with self._lock:
            known = self._jobs.get(id)
        return None if known is None else known.info

    def asset(self, id: str) -> str:
        """The asset of a job; empty where the job is not remembered."""
        known = self.find(id)
        return "" if known is None else known.asset

    def lose(self, its: Callable[[str], bool] = lambda asset: True) -> None:
        """A process has ended.  its: whether an asset was. Builds are not lost: the next process
        starts them again, under the same ids."""
        with self._lock:
            builds = set(self._builds.values())
            for id, known in self._jobs.items():
                known.lost = known.lost or (id not in builds and its(known.info.asset))

    def note_build(self, told: BuildChanged) -> None:
        """A build has begun or ended, by its process."""
        with self._lock:
            if not told.ended:
                self._builds[told.asset] = told.job
            elif self._builds.get(told.asset) == told.job:  # else another has begun since
                del self._builds[told.asset]

    def builds(self) -> dict[str, str]:
        """The jobs that build assets, by asset."""
        with self._lock:
            return dict(self._builds)

    def lost(self, id: str) -> JobInfo | None:
        """A job of a process that has ended, as it was then."""
        with self._lock:
            known = self._jobs.get(id)
        return known.info if known is not None and known.lost else None


def resumed(
    job: JobInfo, asset: Callable[[str], AssetInfo], info: Callable[[str], JobInfo]
) -> JobInfo:
    """What has become of a job whose process has ended: a build goes on, under its old id; frames
    are sent again when they are asked for; others have failed.

    asset, info: of the engine, as it is now.
    """
    if job.state in ENDED_STATES:
        return job
    failed = replace(job, state="failed", detail=_LOST)
    try:
        now = asset(job.asset)
    except NotFoundError:
        return failed
    if now.state == "failed":
        return replace(failed, detail=now.reason or _LOST)
    if now.state == "building" and now.job is not None:
        return _gone_on(job, info(now.job))
    if job.kind in ("build", "frames"):
        return replace(job, state="done", progress=1.0, stage="done", detail="")
    return failed


def _gone_on(job: JobInfo, now: JobInfo) -> JobInfo:
    """A job of a process that has ended, while its asset is built.  now: the job of the asset,
    which may have added frames to it, and has ended before the build then."""
    if now.state in ENDED_STATES:
        return replace(job, state="running", detail=STARTED_AGAIN)
    told = now.detail.removeprefix(STARTED_AGAIN).removeprefix("; ")
    return replace(now, id=job.id, detail="; ".join(filter(None, (STARTED_AGAIN, told))))
