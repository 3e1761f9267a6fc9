"""The cluster that `rhytid bake --dask` names."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from rhytid.cli.dask_options import LOCAL
from rhytid.cli.serve import chosen
from rhytid.cli.voice import voice
from rhytid.device.select import candidates
from rhytid.farm.dask_cluster import Cluster, check_installed, local_cluster, running_cluster
from rhytid.support.temporary_folders import temporary_folder

# Processes on one device: while one writes, the other draws.
_ON_ONE = 2


def check_cluster(address: str) -> None:
    """Raise InputError where Dask is not installed and FarmError where no scheduler answers: before
    an asset is built."""
    check_installed()
    if address != LOCAL:
        with running_cluster(address):
            pass


@contextmanager
def bake_cluster(arguments: argparse.Namespace) -> Iterator[Cluster]:
    """The cluster that runs, or one of processes here, which end with the block. Raises FarmError
    where no scheduler answers."""
    if arguments.dask != LOCAL:
        with running_cluster(arguments.dask) as cluster:
            yield cluster
        return
    quiet = not voice().verbose
    with (
        temporary_folder("rhytid-dask-") as folder,
        local_cluster(worker_devices(arguments), folder, quiet) as cluster,
    ):
        yield cluster


def worker_devices(arguments: argparse.Namespace) -> list[str | None]:
    """What RHYTID_DEVICE is in each process of a cluster here."""
    count = arguments.dask_workers
    wanted = chosen(None, arguments.device).device
    gpus = [str(one.index) for one in candidates() if one.kind == "gpu"]
    devices: list[str | None] = [*gpus] if gpus and wanted is None else [wanted]
    each = len(gpus) if wanted is None else 0
    return [devices[i % len(devices)] for i in range(count or each or _ON_ONE)]
