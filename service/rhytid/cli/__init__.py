"""The command line: thin, one module per command."""

from rhytid.cli.program import main

__all__ = ["main"]
