"""`rhytid restore`: assets from files of `rhytid snapshot`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.options import add_json, add_progress, readable
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_shared_store, add_store
from rhytid.cli.snapshot import RUNNING, SUFFIX, mirrored
from rhytid.cli.summaries import SUMMARIES
from rhytid.errors import SnapshotError
from rhytid.support.console import report, working

if TYPE_CHECKING:
    from rhytid.storage.shared.mirror import StoreMirror
    from rhytid.storage.store import AssetStore


def add_command(commands: Commands) -> None:
    """Add `restore` to the parser."""
    summary = SUMMARIES["restore"]
    example = f"rhytid restore face{SUFFIX} --store assets"
    parser = new_command(commands, "restore", summary, example)
    parser.description = (
        f"{summary} Every byte is checked first. What is there already stays as it is; what is "
        f"damaged there is replaced. {RUNNING} With a shared store they are put there, too."
    )
    what = "files of `rhytid snapshot`, or of a server"
    parser.add_argument("files", nargs="+", type=readable, metavar="FILE", help=what)
    add_store(parser)
    add_shared_store(parser)
    add_progress(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Restore every file. Ends at the first that cannot be used."""
    with mirrored(arguments.store, arguments.shared_store, new=True) as (store, mirror):
        found = [_restored(store, mirror, file) for file in arguments.files]
    report({"restored": found}, "\n".join(map(_line, found)), arguments.json)


def _line(one: dict[str, object]) -> str:
    line = f"{one['asset']}: {'restored' if one['new'] else 'there already'}"
    if "shared" not in one:
        return line
    return f"{line}; {'pushed to' if one['shared'] else 'there already in'} the shared store"


def _restored(store: AssetStore, mirror: StoreMirror | None, path: Path) -> dict[str, object]:
    try:
        with working(f"reading {path}"):
            asset, new = store.snapshots.restore(path)
            found = {"file": str(path), "asset": asset, "new": new}
            if mirror is not None:
                found["shared"] = mirror.push(asset, lambda share, file: None)
            return found
    except SnapshotError as error:
        raise SnapshotError(f"{path}: {error}") from error
