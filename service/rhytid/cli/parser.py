"""The parser of the command line: how it says what is wrong with arguments."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import pairwise
from typing import NoReturn

from rhytid.cli.voice import job_line, voice


class Parser(argparse.ArgumentParser):
    """Ends with status 2; tells a worker agent of Open Job Description the reason, too.

    The parsers of commands are of the same class.
    """

    def error(self, message: str) -> NoReturn:
        """End with the usage and the reason."""
        self._tell_job(message)
        super().error(message)

    def refuse(self, message: str) -> NoReturn:
        """End with the reason alone, in one line: for arguments that are understood, but do not go
        together."""
        self._tell_job(message)
        self.exit(2, f"{self.prog}: error: {message}\n")

    def _tell_job(self, message: str) -> None:
        if voice().for_job:
            job_line("fail", f"{self.prog}: {message}")


def is_for_job(words: Sequence[str]) -> bool:
    """Whether `--progress openjd` is among the words of a command line, which need not be right."""
    pairs = pairwise(words)
    return "--progress=openjd" in words or ("--progress", "openjd") in pairs
