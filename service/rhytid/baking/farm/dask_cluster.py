"""A Dask cluster: one that runs already, or one of processes on this machine."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.device.driver import without_sigint
from rhytid.domain.wording import install_hint
from rhytid.errors import FarmError, InputError

if TYPE_CHECKING:
    from distributed import Client, Nanny, SpecCluster

# What workers announce for each OpenCL device that they may use.
RESOURCE = "opencl"
# Seconds in which a scheduler has to answer.
ANSWER = 10.0
_START = f"dask worker ADDRESS --nthreads 1 --resources {RESOURCE}=1"
# Dask gives a process up for good where no worker of its name is there so long after one has ended:
# also where that was not the last one to end, or where a machine with much to do starts slowly.
_KEPT = {"distributed.deploy.lost-worker-timeout": "1000 days"}
# Dask would have the C library give maps back to the system, which then clears them anew. And its
# profiler looks at the frames of all threads: where Python 3.11 collects garbage meanwhile, the
# process hangs for good (gh-106883).
_WORKERS = {"distributed.nanny.pre-spawn-environ": {}, "distributed.worker.profile.enabled": False}
# Where Ctrl-C ends the client at once, `multiprocessing` removes semaphores of Dask, and would warn
# of them after the last line of the command.
_QUIET = "ignore:resource_tracker"
# Dask serves health and metrics even so: at any port, where else all would want the same.
_NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}


@dataclass(frozen=True)
class Cluster:
    """A Dask cluster.

    where: address of the scheduler.  own: its processes, where this process has started them.
    """

    client: Client
    where: str
    own: SpecCluster | None = None

    def slots(self) -> dict[str, int]:
        """How many chunks each worker takes at once, by its address: as many as it announces."""
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        return {address: int(one["resources"].get(RESOURCE, 0)) for address, one in workers.items()}

    def kill(self) -> bool:
        """Kill the workers, if this process has started them; return whether it has. Other workers
        go on until their frame is done."""
        nannies: list[Nanny] = [] if self.own is None else [*self.own.workers.values()]
        for nanny in nannies:
            nanny.close_gracefully()  # or it starts another
            if nanny.pid:
                with suppress(ProcessLookupError):
                    os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
        return bool(nannies)


@contextmanager
def running_cluster(address: str) -> Iterator[Cluster]:
    """Connect to the scheduler at `address`. Raises FarmError where none answers."""
    check_installed()
    from distributed import Client

    try:
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except (OSError, ValueError) as error:
        raise FarmError(f"no Dask scheduler answers at {address}: {error}") from error
    with client:
        yield Cluster(client, address)


@contextmanager
def local_cluster(devices: Sequence[str | None], folder: Path, quiet: bool) -> Iterator[Cluster]:
    """Start a scheduler in this process, and processes that bake, on the loopback interface. A
    process that ends is started again.

    devices: RHYTID_DEVICE of each process; None leaves it as it is.  folder: for temporary files of
    the processes.  quiet: whether Dask logs no warnings.
    """
    check_installed()
    import dask
    from distributed import Client, SpecCluster

    level = logging.CRITICAL if quiet else logging.WARNING
    workers = {
        number: {"cls": "distributed.Nanny", "options": _options(device, folder, level)}
        for number, device in enumerate(devices)
    }
    options = {"host": "127.0.0.1", "port": 0, **_NO_DASHBOARD}
    scheduler = {"cls": "distributed.Scheduler", "options": options}
    config = {"temporary-directory": str(folder), **_WORKERS}
    with dask.config.set(_KEPT):
        # Ctrl-C at a terminal reaches the whole group: the workers are ended from here.
        with without_sigint(), dask.config.set(config), _warnings_off(_QUIET):
            cluster = SpecCluster(workers, scheduler, silence_logs=level, name="rhytid")
            client = Client(cluster, set_as_default=False)
        with cluster, client:
            yield Cluster(client, cluster.scheduler_address, cluster)


@contextmanager
def _warnings_off(these: str) -> Iterator[None]:
    """Have processes that start in the block ignore warnings.  these: as in PYTHONWARNINGS."""
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = these if before is None else f"{before},{these}"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _options(device: str | None, folder: Path, level: int) -> dict[str, object]:
    return {
        "nthreads": 1,
        "resources": {RESOURCE: 1},
        "host": "127.0.0.1",
        **_NO_DASHBOARD,
        "local_directory": str(folder),
        # The memory of a device that is the processor would count, too.
        "memory_limit": 0,
        "silence_logs": level,
        "env": {} if device is None else {"RHYTID_DEVICE": device},
    }


def check_installed() -> None:
    """Raise InputError where Dask is not installed."""
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise InputError(f"--dask needs Dask; {install_hint('dask')}") from error


def no_worker_error(where: str, workers: int) -> FarmError:
    """The error that no worker of a cluster takes chunks.  workers: how many workers there are."""
    those = f"of its {workers} none announces the resource {RESOURCE}" if workers else "it has none"
    return FarmError(f"no worker of {where} can bake, {those}: start some by `{_START}`")
