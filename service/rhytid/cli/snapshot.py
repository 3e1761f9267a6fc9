"""`rhytid snapshot`: assets of a store as files, for other servers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.options import Commands, add_json, new_command
from rhytid.cli.progress import working
from rhytid.cli.reporting import report
from rhytid.cli.serve import chosen
from rhytid.errors import InputError

if TYPE_CHECKING:
    from rhytid.storage.store import AssetStore

SUFFIX = ".rhytid.tar"
RUNNING = "A store that a server uses is asked over HTTP: docs/pipelines.md."


def add_command(commands: Commands) -> None:
    """Add `snapshot` to the parser."""
    summary = "Write a built asset into one file, which `rhytid restore` and servers take."
    example = f"rhytid snapshot 0123456789abcdef --out face{SUFFIX}"
    parser = new_command(commands, "snapshot", summary, example)
    parser.description = f"{summary} {RUNNING}"
    parser.add_argument("asset", metavar="ASSET", help="id of the asset")
    out = f"file, or a folder that is there (default: ASSET{SUFFIX})"
    parser.add_argument("--out", type=Path, metavar="FILE", help=out)
    add_store(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def add_store(parser: argparse.ArgumentParser) -> None:
    """`--store DIR`."""
    store = "folder of the assets (default: of RHYTID_STORE, else rhytid-store)"
    parser.add_argument("--store", type=Path, metavar="DIR", help=store)


@contextmanager
def opened(store: Path | None, *, new: bool) -> Iterator[AssetStore]:
    """The store of the arguments; raises InputError where there is none, unless it may be new."""
    from rhytid.storage.store import AssetStore

    folder = chosen(store, None).store
    if not new and not (folder / "assets").is_dir():
        raise InputError(f"{folder} is no store of assets")
    with AssetStore(folder) as found:
        yield found


def run(arguments: argparse.Namespace) -> None:
    """Check the asset and write the file, which is there when it is whole."""
    from rhytid.durable import whole, write_pieces

    out: Path = arguments.out or Path(f"{arguments.asset}{SUFFIX}")
    if out.is_dir():
        out /= f"{arguments.asset}{SUFFIX}"
    with (
        opened(arguments.store, new=False) as store,
        working(f"writing {out}"),
        store.snapshot(arguments.asset) as made,
        whole(out) as aside,
    ):
        write_pieces(aside, made.pieces())
    figures = {"asset": arguments.asset, "file": str(out), "bytes": made.nbytes}
    report(figures, f"{out}: {made.nbytes} bytes", arguments.json)
