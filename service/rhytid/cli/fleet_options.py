"""`rhytid serve --ray`: its options, and the replicas that they stand for."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from rhytid.domain.wording import install_hint
from rhytid.errors import InputError
from rhytid.settings import ServiceSettings

LOCAL = "local"


def add_fleet(parser: argparse.ArgumentParser) -> None:
    """Add the options to a parser."""
    ray = (
        "compute in replicas of Ray Serve, one a device, behind this server: of the cluster at "
        "ADDRESS, or of this machine alone where none is given (extra ray)"
    )
    parser.add_argument("--ray", nargs="?", const=LOCAL, metavar="ADDRESS", help=ray)
    replicas = "of --ray, how many there are: a number, or two such as 2-8 (default: 1)"
    parser.add_argument("--replicas", metavar="N", help=replicas)


def fleet_of(
    arguments: argparse.Namespace, settings: ServiceSettings
) -> Callable[[ServiceSettings], AbstractContextManager[Any]] | None:
    """What makes the engine of a fleet for settings; None where no fleet is asked for.

    Raises InputError for options that do not go together or without the extra, SettingsError for a
    count that is none.
    """
    if arguments.ray is None:
        if arguments.replicas is not None:
            raise InputError("--replicas is for --ray")
        return None
    if arguments.in_process:
        raise InputError("--ray and --in-process cannot be given together")
    # Beside the packages of the extra, Ray takes a while to import.
    from rhytid.fleet.options import FleetOptions

    options = FleetOptions.read({"store": settings.store, "replicas": arguments.replicas or "1"})
    try:
        from rhytid.fleet.app import local_fleet
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] == "rhytid":
            raise
        raise InputError(
            f"--ray needs the extra ray, and {error.name} is missing; {install_hint('ray')}"
        ) from error
    address = None if arguments.ray == LOCAL else arguments.ray
    return partial(local_fleet, options=options, address=address)
