"""`rhytid devices`: the OpenCL devices of this machine, and which one is used."""

from __future__ import annotations

import argparse

from rhytid.cli.options import add_json
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES
from rhytid.support.console import report, table, working
from rhytid.support.settings import ServiceSettings

HEADER = ("number", "kind", "units", "memory MiB", "version", "name", "platform", "used")


def add_command(commands: Commands) -> None:
    """Add `devices` to the parser."""
    parser = new_command(
        commands,
        "devices",
        SUMMARIES["devices"],
        "rhytid devices --json",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """List the devices. Raises NoDeviceError where none computes, naming the ways to get one."""
    # Imported here, because looking for OpenCL drivers takes time that --help should not.
    from rhytid.device.select import candidates, choose

    settings = ServiceSettings.from_environment()
    with working("trying the devices"):
        used = choose(settings.device, settings.cache)
    figures = [
        {
            "number": device.index,
            "kind": device.kind,
            "units": device.compute_units,
            "memory": device.memory,
            "version": device.version,
            "name": device.name,
            "platform": device.platform,
            "used": device.index == used.index,
        }
        for device in candidates()
    ]
    report(figures, table(HEADER, (_row(f) for f in figures)), arguments.json)


def _row(figures: dict[str, object]) -> list[object]:
    memory, used = figures["memory"], figures["used"]
    assert isinstance(memory, int)
    shown = {**figures, "memory": memory >> 20, "used": "yes" if used else "no"}
    return list(shown.values())
