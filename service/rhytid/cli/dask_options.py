"""The options of `rhytid bake` for a cluster."""

from __future__ import annotations

import argparse

from rhytid.cli.argument_types import positive

LOCAL = "local"


def add_dask(parser: argparse._ActionsContainer) -> None:
    """`--dask` and `--dask-workers`."""
    add = parser.add_argument
    where = (
        f"bake on the workers of the Dask scheduler at this address, or of processes here: {LOCAL}"
    )
    add("--dask", metavar="ADDRESS", help=where)
    workers = (
        f"processes of --dask {LOCAL} (default: one for each GPU; 2 without, or on a named device)"
    )
    add("--dask-workers", type=positive, metavar="N", help=workers)


def refuse_dask_conflicts(arguments: argparse.Namespace) -> None:
    """End with a usage error where an option of these has no effect, or where one has none on a
    cluster that runs already."""
    error, address = arguments.usage_error, arguments.dask
    if address is not None and arguments.openjd is not None:
        error("--openjd and --dask are two ways to many machines: use one")
    if arguments.dask_workers and address != LOCAL:
        error(f"--dask-workers says how many processes --dask {LOCAL} starts: give that, too")
    if address is not None and address != LOCAL and "://" not in address:
        error(f"--dask {address}: {LOCAL}, or an address as tcp://HOST:8786")
