"""What the commands' options have in common."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rhytid.cli.argument_types import readable
from rhytid.cli.parser import Parser
from rhytid.domain.warnings import CODES
from rhytid.engine.messages import SAMPLINGS, STRETCH_MODELS
from rhytid.exports.textures import PROFILE_NAMES

STDOUT = Path("-")
Commands = Any  # argparse._SubParsersAction has no public name
# A parser, or a group of its options in --help.
Arguments = argparse._ActionsContainer


def new_command(commands: Commands, name: str, summary: str, example: str) -> Parser:
    """A parser for one command, with its help and an example."""
    parser: Parser = commands.add_parser(
        name,
        help=summary,
        description=summary,
        epilog=f"example: {example}",
        # Else --set would be --settings where there is no --set.
        allow_abbrev=False,
        formatter_class=HelpFormatter,
    )
    voice = parser.add_mutually_exclusive_group()
    quiet = "say nothing but results, warnings and errors"
    voice.add_argument("-q", "--quiet", action="store_true", help=quiet)
    verbose = "also say which step begins, which file is written, and where an error came from"
    voice.add_argument("-v", "--verbose", action="store_true", help=verbose)
    return parser


class HelpFormatter(argparse.HelpFormatter):
    """Ends the help of every option that takes a value with its default."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        optional = action.option_strings and not action.required and action.nargs != 0
        if not action.help or not optional or "(default: " in action.help:
            return action.help
        known = action.default not in (None, []) and action.default is not argparse.SUPPRESS
        return f"{action.help} (default: {'%(default)s' if known else 'none'})"


def add_json(parser: Arguments) -> None:
    """`--json [FILE]`: figures for machines."""
    parser.add_argument(
        "--json",
        nargs="?",
        const=STDOUT,
        type=Path,
        metavar="FILE",
        help="write the figures as JSON to FILE, or to stdout in place of the table",
    )


def add_progress(parser: Arguments) -> None:
    """`--progress`: whom progress is reported to."""
    who = "report to a person, or in the lines that workers of Open Job Description read"
    parser.add_argument("--progress", choices=("person", "openjd"), default="person", help=who)


def add_several(parser: Arguments, option: str, **named: Any) -> None:
    """An option of one value or more, that may be given more than once."""
    parser.add_argument(option, nargs="+", action="extend", default=[], **named)


def add_force(parser: Arguments) -> None:
    """`--force`."""
    force = "take a graph that was made for another mesh"
    parser.add_argument("--force", action="store_true", help=force)


def add_shared_store(parser: Arguments) -> None:
    """`--shared-store PLACE`."""
    told = (
        "where assets are that several machines share: a folder that all mount, or "
        "s3://BUCKET/PREFIX with the extra s3 (default: of RHYTID_SHARED_STORE, else none)"
    )
    parser.add_argument("--shared-store", metavar="PLACE", help=told)


def add_device(parser: Arguments, more: str = "") -> None:
    """`--device D`."""
    device = f"number or part of the name of a device{more} (default: RHYTID_DEVICE, or chosen)"
    parser.add_argument("--device", metavar="D", help=device)


def add_stiffness(parser: Arguments) -> None:
    """`--stiffness FILE ...`."""
    stiffness = "grey PNG or EXR, one per UDIM, named ANY.<UDIM>.png: white moves, black is rigid"
    add_several(parser, "--stiffness", type=readable, metavar="FILE", help=stiffness)


def add_profiles(parser: Arguments) -> None:
    """`--profile NAME ...`, and `--half` for one of them."""
    kinds = f"kinds of files to write, one or several: {', '.join(PROFILE_NAMES)} (default: float)"
    add_several(parser, "--profile", choices=PROFILE_NAMES, metavar="NAME", help=kinds)
    parser.add_argument("--half", action="store_true", help="the same as --profile half")


def add_strict(parser: Arguments) -> None:
    """`--strict`, and `--allow CODE` for what it shall not refuse."""
    strict = "end with an error, before anything is made, where there would be warnings"
    parser.add_argument("--strict", action="store_true", help=strict)
    allow = f"a warning that --strict does not refuse, repeated for several: {', '.join(CODES)}"
    parser.add_argument(
        "--allow", action="append", default=[], choices=CODES, metavar="CODE", help=allow
    )


def add_query(parser: Arguments) -> None:
    """`--stretch` and `--sampling`, as a tile's query has them."""
    stretch = "how stretch is measured"
    parser.add_argument("--stretch", choices=STRETCH_MODELS, default="tensor", help=stretch)
    sampling = "where stretch is taken: of whole triangles, or interpolated"
    parser.add_argument("--sampling", choices=SAMPLINGS, default="nearest", help=sampling)
