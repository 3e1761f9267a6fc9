"""Chunks on a Dask cluster of two processes, with a session that draws nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import dask
import pytest

from baking.fake_session import FakeJob, fake
from rhytid.baking.farm.chunks import (
    Chunk,
    ChunkDone,
    Event,
    FrameDone,
    WorkerLost,
    WorkerUnable,
    of_worker,
)
from rhytid.baking.farm.dask_cluster import Cluster, local_cluster, running_cluster
from rhytid.baking.farm.dask_run import DaskRun, Workers
from rhytid.errors import FarmError, FrameError, InputError, StorageError


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Seen by a client of its own, as one that runs already: an error ends none of its workers.

    A process that Dask would give up at once has a successor all the same.
    """
    folder = tmp_path_factory.mktemp("workers")
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1ms"}),
        local_cluster([None, None], folder, True) as own,
        running_cluster(own.where) as seen,
    ):
        seen.client.scheduler_of_test = cast("Any", own.own).scheduler
        yield seen


@pytest.fixture
def allowed(cluster: Cluster) -> Iterator[Any]:
    """The scheduler, for a test that says how many deaths of workers Dask lets a task have."""
    scheduler = cluster.client.scheduler_of_test
    before = scheduler.allowed_failures
    yield scheduler
    scheduler.allowed_failures = before


def both(cluster: Cluster) -> None:
    """Wait until the successors of workers that were killed are there."""
    by = time.monotonic() + 30
    while len(cluster.slots()) < 2:
        assert time.monotonic() < by
        time.sleep(0.05)


def chunks(frames: int, each: int) -> list[Chunk]:
    starts = range(1, frames + 1, each)
    numbers = [tuple(range(start, min(start + each, frames + 1))) for start in starts]
    return [Chunk(one, f"{one[0]}-{one[-1]}") for one in numbers]


def run(cluster: Cluster, job: FakeJob, frames: int = 8, each: int = 2) -> list[Event]:
    with DaskRun(cluster, fake(job)) as running:
        return [*running.bake(chunks(frames, each))]


def told(events: list[Event]) -> list[str]:
    return sorted(event.label for event in events if isinstance(event, FrameDone))


ALL = [f"{number:04d}" for number in range(1, 9)]


def test_every_frame_is_baked_and_told_once(cluster: Cluster, tmp_path: Path) -> None:
    job = FakeJob(tmp_path)

    events = run(cluster, job)

    assert told(events) == ALL
    assert sum(event.report for event in events if isinstance(event, ChunkDone)) == 8
    assert [len(job.begun(number)) for number in range(1, 9)] == [1] * 8
    made = [file.name for file in tmp_path.glob("made-*")]
    assert 1 <= len(made) <= 2, "one session per worker"
    assert len(list(tmp_path.glob("closed-*"))) == len(made), "and none is left"


def test_nothing_is_registered_at_the_scheduler(cluster: Cluster, tmp_path: Path) -> None:
    """A client that is killed would leave it there, for every worker that comes."""
    before = set(cluster.client.scheduler_of_test.worker_plugins)

    with DaskRun(cluster, fake(FakeJob(tmp_path))) as running:
        assert [*running.bake(chunks(2, 1))]
        assert set(cluster.client.scheduler_of_test.worker_plugins) == before


def test_an_error_ends_the_sessions_of_workers(cluster: Cluster, tmp_path: Path) -> None:
    with pytest.raises(FrameError):
        run(cluster, FakeJob(tmp_path, bad=(3,)), 40)

    by = time.monotonic() + 5
    while len([*tmp_path.glob("closed-*")]) < len([*tmp_path.glob("made-*")]):
        assert time.monotonic() < by, "as soon as the frame at work is there"
        time.sleep(0.01)


def test_a_killed_worker_repeats_its_chunk_alone(cluster: Cluster, tmp_path: Path) -> None:
    job = FakeJob(tmp_path, deaths=((4, 1),))

    events = run(cluster, job)

    assert told(events) == ALL
    assert [number for number in range(1, 9) if len(job.begun(number)) > 1] == [3, 4]
    assert len(set(job.begun(4))) == 2
    assert len([event for event in events if isinstance(event, WorkerLost)]) == 1


@pytest.mark.slow
def test_a_chunk_goes_on_while_frames_are_added(
    cluster: Cluster, allowed: Any, tmp_path: Path
) -> None:
    """A worker that is taken away often is no reason to give up."""
    allowed.allowed_failures = 0

    events = run(cluster, FakeJob(tmp_path, deaths=((2, 1), (3, 1), (4, 1))), 4, 4)

    assert told(events) == ALL[:4]


@pytest.mark.slow
def test_a_frame_that_ends_workers_is_named(cluster: Cluster, allowed: Any, tmp_path: Path) -> None:
    allowed.allowed_failures = 0

    with pytest.raises(FarmError, match=r"^frames 1-1: several workers ended at them, the last"):
        run(cluster, FakeJob(tmp_path, deaths=((1, 9),)), 2, 1)


def test_what_cannot_be_read_is_not_tried_again(cluster: Cluster, tmp_path: Path) -> None:
    job = FakeJob(tmp_path, bad=(3,))

    with pytest.raises(FrameError, match=r"^frame 3 has 3 vertices$"):
        run(cluster, job, 40)

    assert len(job.begun(3)) == 1
    assert not job.begun(40), "the rest is cancelled"


def test_what_may_pass_is_tried_again(cluster: Cluster, tmp_path: Path) -> None:
    job = FakeJob(tmp_path, stale=(3,))

    assert told(run(cluster, job)) == ALL
    assert len(job.begun(3)) == 2


def test_an_error_of_a_worker_names_it(cluster: Cluster, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^worker tcp://127.0.0.1:\d+: no such file: /nowhere"):
        run(cluster, FakeJob(tmp_path, missing=True))


@pytest.mark.slow
def test_a_worker_that_cannot_bake_is_put_aside(cluster: Cluster, tmp_path: Path) -> None:
    both(cluster)
    job = FakeJob(tmp_path, apart=True)

    with DaskRun(cluster, fake(job)) as running:
        events = [*running.bake(chunks(40, 1))]

    assert len(told(events)) == 40
    [unable] = [event for event in events if isinstance(event, WorkerUnable)]
    assert str(unable.error) == f"worker {unable.worker}: no OpenCL device matches 'gpu'"
    assert unable.worker not in {e.worker for e in events if isinstance(e, FrameDone)}
    assert len(running.used) == 1 < len(running.workers.seen)
    assert len([*tmp_path.glob("tried-*")]) == 2, "each has tried, and once"


@pytest.mark.slow
def test_the_successor_of_the_only_worker_that_can_bake_goes_on(
    cluster: Cluster, tmp_path: Path
) -> None:
    """Chunks that only the worker that is killed might take are given anew."""
    both(cluster)

    events = run(cluster, FakeJob(tmp_path, apart=True, deaths=((20, 1),)), 40, 2)

    assert len(told(events)) == 40
    assert len({event.worker for event in events if isinstance(event, FrameDone)}) == 2


def test_an_error_that_is_none_of_ours_names_the_worker(cluster: Cluster, tmp_path: Path) -> None:
    job = FakeJob(tmp_path, full=(1, 2, 3))

    assert told(run(cluster, job)) == ALL
    worker = r"^worker tcp://farm:1: MemoryError: $"
    with pytest.raises(StorageError, match=worker):
        raise of_worker(MemoryError(), "tcp://farm:1")


def test_two_clusters_run_side_by_side(cluster: Cluster, tmp_path: Path) -> None:
    with local_cluster([], tmp_path, True) as other:
        assert other.where != cluster.where
        assert other.where.startswith("tcp://127.0.0.1:")
        assert other.slots() == {}


class Without:
    """A cluster with `workers` that announce nothing."""

    where = "tcp://farm:8786"

    def __init__(self, workers: int) -> None:
        self._workers = workers

    def slots(self) -> dict[str, int]:
        return dict.fromkeys(map(str, range(self._workers)), 0)


@pytest.mark.parametrize(
    ("workers", "reason"),
    [(3, "of its 3 none announces the resource opencl"), (0, "it has none")],
)
def test_a_cluster_that_cannot_bake_is_told(workers: int, reason: str) -> None:
    waiting = Workers(cast("Any", Without(workers)), patience=0.2)
    start = time.monotonic()

    with pytest.raises(FarmError, match=f"^no worker of tcp://farm:8786 can bake, {reason}"):
        waiting.slots()
    assert time.monotonic() - start < 2
