"""The command line: one module for each command, and what commands share."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

from rhytid.cli.termination import INTERRUPTED, TERMINATED, end_now, interruptible


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status.

    0: done.  1: an error, printed as one line on stderr.  130: interrupted. Raises SystemExit, with
    2 where the arguments cannot be understood, and with 143 where SIGTERM came, which ends a server
    that is ready with 0; where both signals came, the first counts.
    """
    with interruptible() as interruption:
        try:
            # Imported here: an interruption is heard while the modules are loaded, too.
            from rhytid.cli.program import run

            return run(argv, interruption)
        except KeyboardInterrupt:
            interruption.say()
            return interruption.status


def console() -> NoReturn:
    """The program `rhytid`: run `main`, and end the process."""
    status = main()
    if status in (INTERRUPTED, TERMINATED):  # threads may be at work: nobody waits for them
        end_now(status)
    sys.exit(status)
