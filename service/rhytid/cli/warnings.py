"""`rhytid warnings`: the meanings of the codes of warnings and notices, and remedies."""

from __future__ import annotations

import argparse
import textwrap

from rhytid.cli.parser import Commands, new_command
from rhytid.cli.summaries import SUMMARIES
from rhytid.domain.notices import NOTICES
from rhytid.domain.warnings import WARNINGS, Meaning

_KNOWN = {**WARNINGS, **NOTICES}
_WIDTH = 96


def add_command(commands: Commands) -> None:
    """Add `warnings` to the parser."""
    parser = new_command(
        commands,
        "warnings",
        SUMMARIES["warnings"],
        "rhytid warnings texel-size",
    )
    parser.add_argument(
        "codes", nargs="*", metavar="CODE", help=f"all of them, or some of: {', '.join(_KNOWN)}"
    )
    parser.set_defaults(run=run, usage_error=parser.error)


def run(arguments: argparse.Namespace) -> None:
    """Print the meanings of some codes, or of all."""
    for code in arguments.codes:
        if code not in _KNOWN:
            arguments.usage_error(f"{code!r}: one of {', '.join(_KNOWN)}")
    chosen = arguments.codes or list(_KNOWN)
    print("\n\n".join(_text(code, _KNOWN[code]) for code in chosen))


def _text(code: str, meaning: Meaning) -> str:
    kind = "notice" if code in NOTICES else "warning"
    parts = (f"about: {meaning.of}", f"when: {meaning.when}", f"what to do: {meaning.remedy}")
    lines = [line for text in parts for line in _wrapped(text)]
    return "\n".join([f"{code} ({kind})", *lines])


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")
