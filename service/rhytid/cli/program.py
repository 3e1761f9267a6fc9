"""The program `rhytid`: its parser, and how commands end."""

from __future__ import annotations

import argparse
import logging
import os
import select
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING

from rhytid import __version__
from rhytid.cli.parser import Commands, Parser, is_for_job
from rhytid.cli.summaries import SUMMARIES
from rhytid.cli.termination import Interruption, Terminated
from rhytid.errors import RhytidError
from rhytid.storage.lock import known_as
from rhytid.support.build_identity import drawing_version, revision
from rhytid.support.console import Verbosity, make_place, openjd_line, use_verbosity
from rhytid.support.settings import misspelt_variables

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

# Modules of this package, each with the command of its name, in the order of the help.
COMMANDS = tuple(SUMMARIES)
# Entry points of other packages: modules with `add_command(commands)`, as those above. Where the
# package that has the module has SUMMARIES, too, `rhytid --help` imports no more of it.
GROUP = "rhytid.commands"
# Describes all others.
_OF_ALL = "completion"
# What a shell says of a program that SIGPIPE ended.
_READER_LEFT = 141


def run(argv: Sequence[str] | None, interruption: Interruption) -> int:
    """Run one command and return its exit status, as `main` has it."""
    with use_verbosity(Verbosity(for_job=is_for_job(sys.argv[1:] if argv is None else argv))):
        arguments = _parser_for(argv).parse_args(argv)
    interruption.command = arguments.command
    for_job = getattr(arguments, "progress", None) == "openjd"
    level = Verbosity(arguments.quiet, arguments.verbose, for_job)
    try:
        with use_verbosity(level), _logging(level), known_as(f"rhytid {arguments.command}"):
            if arguments.command != "serve":  # which has a log
                _warn_of_variables(arguments.command)
            make_place(getattr(arguments, "json", None))
            arguments.run(arguments)
            print(end="", flush=True)  # here, where what fails is said
    except KeyboardInterrupt:
        interruption.say()
        return interruption.status
    except Terminated:
        interruption.say()
        raise
    except Exception as error:
        if interruption.came:  # it came of the interruption
            interruption.say()
            return interruption.status
        if interruption.terminated:
            interruption.say()
            raise Terminated(interruption.status) from error
        if isinstance(error, BrokenPipeError) and _reader_left():
            return _READER_LEFT
        if not isinstance(error, RhytidError | OSError):
            raise
        if level.verbose:
            traceback.print_exc()
        print(f"rhytid {arguments.command}: {_line(error)}", file=sys.stderr)
        if for_job:
            openjd_line("fail", f"rhytid {arguments.command}: {_line(error)}")
        return 1
    return 0


def _reader_left() -> bool:
    """Whether what reads the output of this program has ended, as `head` does; if so the rest goes
    nowhere."""
    if not hasattr(select, "poll"):  # Windows
        return False
    poll = select.poll()
    poll.register(sys.stdout.fileno(), 0)
    if not any(event & select.POLLERR for _, event in poll.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return True


def _parser_for(argv: Sequence[str] | None) -> Parser:
    """The parser of all that arguments may need: of the command that they begin with, else of
    names and summaries. What commands import takes longer than most of them."""
    words = sys.argv[1:] if argv is None else argv
    first = next(iter(words), "")
    if first in (_OF_ALL, "--"):  # after which some versions of argparse take a command
        return build_parser()
    return build_parser(first) if first in COMMANDS or first in _others() else _listing()


def build_parser(only: str | None = None) -> Parser:
    """The parser of all commands, or of one. Each command sets `run`, a function of the arguments,
    and `program` is this parser."""
    parser, commands = _program()
    for name in COMMANDS:
        if only in (None, name):
            import_module(f"rhytid.cli.{name}").add_command(commands)
    if only not in COMMANDS:
        for name, entry in _others().items():
            if only in (None, name):
                entry.load().add_command(commands)
    return parser


def _listing() -> Parser:
    """A parser of names and summaries alone: for --help, --version, and what is no command."""
    parser, commands = _program()
    for name, summary in SUMMARIES.items():
        commands.add_parser(name, help=summary)
    for name, entry in _others().items():
        package = import_module(entry.module.rpartition(".")[0] or entry.module)
        if told := getattr(package, "SUMMARIES", {}).get(name):
            commands.add_parser(name, help=told)
        else:
            entry.load().add_command(commands)
    return parser


def _program() -> tuple[Parser, Commands]:
    """The parser of the program, and where commands are added to it."""
    parser = Parser(
        prog="rhytid",
        description="Dynamic facial wrinkles: an animated face in, displacement maps out.",
        epilog="example: rhytid demo --out rhytid-demo",
        allow_abbrev=False,
    )
    version = "print the version, the digest of the drawing and the revision"
    parser.add_argument("--version", action=_Version, help=version)
    parser.set_defaults(program=parser)  # which `completion` describes
    return parser, parser.add_subparsers(dest="command", metavar="COMMAND", required=True)


def _others() -> dict[str, EntryPoint]:
    """The commands of other packages. By name: an installed package beside one on PYTHONPATH lists
    each twice."""
    from importlib.metadata import entry_points  # which takes a tenth of a short command

    return {entry.name: entry for entry in entry_points(group=GROUP)}


class _Version(argparse.Action):
    """Prints the version as one line. The action of argparse would break it."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *rest: object) -> None:
        print(f"rhytid {__version__} (drawing {drawing_version()}, revision {revision()})")
        parser.exit()


def _warn_of_variables(command: str) -> None:
    for line in misspelt_variables():
        print(f"rhytid {command}: warning: {line}", file=sys.stderr)


@contextmanager
def _logging(level: Verbosity) -> Iterator[None]:
    """Write the log of this package on stderr within the block, where verbose."""
    if not level.verbose:
        yield
        return
    logger, handler = logging.getLogger("rhytid"), logging.StreamHandler()
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)


def _line(error: Exception) -> str:
    """The line that is printed for an error. That of a file has its name and the reason, without
    the number of the error."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)
