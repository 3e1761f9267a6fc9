"""The documents of the repository."""

from __future__ import annotations

import argparse
from functools import cache

from house.markdown import Command
from house.syntax import ROOT
from rhytid.cli.program import build_parser

README = (ROOT / "README.md").read_text(encoding="utf-8")
# By their path in the repository; pictures and this list need no site.
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "SECURITY.md",
        *sorted((ROOT / "docs").rglob("*.md")),
    ]
}
SETTINGS = PAGES["docs/reference/settings.md"]
CLI = PAGES["docs/reference/cli.md"]
HTTP = PAGES["docs/reference/http.md"]


@cache
def subparsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each command."""
    actions = build_parser()._actions
    found = next(a for a in actions if isinstance(a, argparse._SubParsersAction))
    return dict(found.choices)


def options(name: str) -> set[str]:
    """The options of a command."""
    return {option for action in subparsers()[name]._actions for option in action.option_strings}


def understood(command: Command) -> bool:
    """Whether the command line has a command with those options."""
    return command.name in subparsers() and set(command.options) <= options(command.name)
