"""The program `rhytid`: its parser, and how its commands end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points

from rhytid import __version__
from rhytid.cli import bake, check, devices, graph, serve, synthesize, transfer, warnings
from rhytid.cli.termination import INTERRUPTED, raising_terminated
from rhytid.errors import RhytidError

COMMANDS = (serve, devices, check, synthesize, graph, transfer, bake, warnings)
# Entry points of other packages: modules with `add_command(commands)`, as those above.
GROUP = "rhytid.commands"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status.

    0: all was done.  1: an error, told in one line on stderr.  130: interrupted. Raises
    SystemExit, with 2 over arguments that cannot be understood and with 143 when terminated.
    """
    arguments = build_parser().parse_args(argv)
    try:
        with raising_terminated():
            arguments.run(arguments)
    except (RhytidError, OSError) as error:
        print(f"rhytid {arguments.command}: {_line(error)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"rhytid {arguments.command}: interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0


def build_parser() -> argparse.ArgumentParser:
    """Every command with its options; a command sets `run` to a function of the arguments."""
    parser = argparse.ArgumentParser(
        prog="rhytid",
        description="Dynamic facial wrinkles: an animated face in, displacement maps out.",
        epilog="example: rhytid demo --out rhytid-demo",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"rhytid {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    # By name: an installed package beside one on PYTHONPATH lists each twice.
    others = {entry.name: entry for entry in entry_points(group=GROUP)}
    for command in (*COMMANDS, *(entry.load() for entry in others.values())):
        command.add_command(commands)
    return parser


def _line(error: Exception) -> str:
    """What to tell of an error; a file's name and reason, without Python's error numbers."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)
