"""The command line: thin, one module per command."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

from rhytid.cli.termination import INTERRUPTED, end_now, interruptible


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status.

    0: all was done.  1: an error, reported in one line on stderr.  130: interrupted. Raises
    SystemExit, with 2 over arguments that cannot be understood and with 143 when terminated.
    """
    with interruptible() as interruption:
        try:
            # Imported here: an interruption is heard while the modules are loaded, too.
            from rhytid.cli.program import run

            return run(argv, interruption)
        except KeyboardInterrupt:
            interruption.say()
            return INTERRUPTED


def console() -> NoReturn:
    """The program `rhytid`: `main`, and the end of the process."""
    status = main()
    if status == INTERRUPTED:  # threads may be at work: nobody waits for them
        end_now(status)
    sys.exit(status)
