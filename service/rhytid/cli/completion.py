"""`rhytid completion`: a script by which a shell completes commands, options and file names."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES

SHELLS = ("bash", "zsh", "fish")


def add_command(commands: Commands) -> None:
    """Add `completion` to the parser."""
    parser = new_command(
        commands,
        "completion",
        SUMMARIES["completion"],
        "rhytid completion bash > ~/.local/share/bash-completion/completions/rhytid",
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell that reads the script")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Print the script."""
    import shtab

    parser: argparse.ArgumentParser = arguments.program
    for action in _actions(parser):
        if _takes_files(action):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, arguments.shell))


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """The actions of a parser and of its commands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
        yield action


def _takes_files(action: argparse.Action) -> bool:
    """Whether an argument is the name of a file."""
    made = getattr(action.type, "__annotations__", {}).get("return")
    return action.type is Path or made in (Path, "Path")
