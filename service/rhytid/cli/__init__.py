"""The command line: thin, one module a command."""

from rhytid.cli.program import main

__all__ = ["main"]
