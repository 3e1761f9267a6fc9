"""The parsers of the program and of its commands: help, and what is wrong with arguments."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise, takewhile
from typing import Any, NoReturn

from rhytid.support.console import openjd_line, verbosity

Commands = Any  # argparse._SubParsersAction has no public name
# Options that are named to somebody who has written only their beginning.
_MOST_NAMED = 3


def new_command(commands: Commands, name: str, summary: str, example: str) -> Parser:
    """Add the parser of a command, with its help and an example."""
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
    """Adds the default to the help of every option that takes a value."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        optional = action.option_strings and not action.required and action.nargs != 0
        if not action.help or not optional or "(default" in action.help:
            return action.help
        known = action.default not in (None, []) and action.default is not argparse.SUPPRESS
        return f"{action.help} (default: {'%(default)s' if known else 'none'})"


class Parser(argparse.ArgumentParser):
    """A parser that ends with status 2 and one line: the error, and either a suggestion or where
    help is.

    A worker agent of Open Job Description gets the error in its own form, too. Parsers of commands
    are of the same class.

    settings: how settings that are no options are given, by their names.
    """

    settings: Mapping[str, str] = {}

    def error(self, message: str) -> NoReturn:
        """End with the error, and say how to get help."""
        self.refuse(message, f"; {self.prog} --help says more")

    def refuse(self, message: str, more: str = "") -> NoReturn:
        """End with the error and `more` alone: for arguments that are valid but do not go
        together."""
        if verbosity().for_job:
            openjd_line("fail", f"{self.prog}: {message}")
        self.exit(2, f"{self.prog}: error: {message}{more}\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, but refuse unknown arguments here: by the parser of the command,
        and before missing ones."""
        words = list(sys.argv[1:] if args is None else args)
        for option in self._options_of(words):
            if option not in self._option_string_actions:
                self._refuse_unknown([option])
        found, unknown = super().parse_known_args(words, namespace)
        if unknown:
            self._refuse_unknown(unknown)
        return found, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Check as argparse does, but suggest the choice or command that a wrong value
        resembles."""
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            choices = [str(choice) for choice in action.choices or ()]
            if meant := suggestion(str(value), choices):
                self.refuse(str(error), meant)
            raise

    def _options_of(self, words: Sequence[str]) -> Iterator[str]:
        """The options among words that are not those of a command. Of `--name=value`, `--name`."""
        mine: Iterable[str] = takewhile(lambda word: word != "--", words)
        if self._subparsers is not None:
            mine = takewhile(lambda word: word.startswith("-"), mine)
        # A word with a space is a value to argparse, whatever it begins with.
        return (w.partition("=")[0] for w in mine if w.startswith("--") and " " not in w)

    def _refuse_unknown(self, words: Sequence[str]) -> NoReturn:
        message = f"unrecognized arguments: {' '.join(words)}"
        option = words[0].partition("=")[0]
        if option.startswith("--") and (form := self.settings.get(option[2:])):
            self.refuse(message, f"; it is a setting: {form}")
        near = self._near(option)
        if not near:
            self.error(message)
        self.refuse(message, f"; did you mean {' or '.join(near)}?")

    def _near(self, word: str) -> list[str]:
        """Options that a word may mean: those that begin with it, else one that is spelt alike."""
        name = word.lstrip("-")
        if word == name or len(name) < 2:
            return []
        known = [option[2:] for option in self._option_string_actions if option.startswith("--")]
        near = [option for option in known if option.startswith(name)]
        if not 0 < len(near) <= _MOST_NAMED:
            near = difflib.get_close_matches(name, known, n=1)
        return [f"--{option}" for option in near]


def suggestion(word: str, known: Sequence[str]) -> str:
    """`; did you mean NAME?`, with the known name that is spelt alike; empty without one."""
    near = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean {near[0]}?" if near else ""


def is_for_job(words: Sequence[str]) -> bool:
    """Whether a command line has `--progress openjd`. It may be wrong otherwise."""
    pairs = pairwise(words)
    return "--progress=openjd" in words or ("--progress", "openjd") in pairs
