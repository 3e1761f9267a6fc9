"""A fleet of two replicas on this machine, one Ray for all tests of a session."""

from __future__ import annotations

import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rhytid.fleet.app import local_fleet
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.ray_engine import RayEngine
from rhytid.support.settings import ServiceSettings

REPLICAS = 2


@contextmanager
def running_fleet(folder: Path) -> Iterator[RayEngine]:
    """An engine over two replicas.  folder: of the store, and of what replicas keep."""
    settings = replace(ServiceSettings.from_environment(), store=folder / "store")
    options = FleetOptions(
        store=folder / "store", least=REPLICAS, most=REPLICAS, local=folder / "local"
    )
    # Names of sockets have at most 107 bytes.
    sockets = tempfile.mkdtemp(prefix=f"ray_{os.getpid()}_")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with local_fleet(settings, options, None, num_cpus=REPLICAS, _temp_dir=sockets) as made:
                yield made
    finally:
        shutil.rmtree(sockets, ignore_errors=True)
