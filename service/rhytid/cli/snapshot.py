"""`rhytid snapshot`: an asset of a store as a file, for other servers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rhytid.cli.options import add_json
from rhytid.cli.parser import Commands, new_command
from rhytid.cli.service_options import add_shared_store, add_store, local_settings, service_settings
from rhytid.cli.summaries import SUMMARIES
from rhytid.errors import InputError
from rhytid.support.console import make_place, report, working

if TYPE_CHECKING:
    from rhytid.storage.shared.mirror import StoreMirror
    from rhytid.storage.store import AssetStore

SUFFIX = ".rhytid.tar"
RUNNING = "A store that a server uses is asked over HTTP: docs/pipelines.md."


def add_command(commands: Commands) -> None:
    """Add `snapshot` to the parser."""
    summary = SUMMARIES["snapshot"]
    example = f"rhytid snapshot 0123456789abcdef --out face{SUFFIX}"
    parser = new_command(commands, "snapshot", summary, example)
    parser.description = (
        f"{summary} {RUNNING} Of a shared store an asset is fetched first that DIR lacks, or that "
        "another machine has changed since."
    )
    parser.add_argument("asset", metavar="ASSET", help="id of the asset")
    out = f"file, or a folder that is there (default: ASSET{SUFFIX})"
    parser.add_argument("--out", type=Path, metavar="FILE", help=out)
    add_store(parser)
    add_shared_store(parser)
    add_json(parser)
    parser.set_defaults(run=run)


@contextmanager
def opened(store: Path | None, *, new: bool) -> Iterator[AssetStore]:
    """Open the store in a folder. Raises InputError where there is none, unless `new` lets it be
    made."""
    from rhytid.storage.store import AssetStore

    folder = local_settings(store, None).store
    if not new and not (folder / "assets").is_dir():
        raise InputError(f"{folder} is no store of assets")
    with AssetStore(folder) as found:
        yield found


@contextmanager
def mirrored(
    store: Path | None, shared_store: str | None, *, new: bool
) -> Iterator[tuple[AssetStore, StoreMirror | None]]:
    """Open the store in a folder beside the shared one, if there is one. Raises what `opened` and
    `SharedStore.at` do."""
    from rhytid.storage.shared.mirror import StoreMirror
    from rhytid.storage.shared.shared_store import SharedStore

    place = service_settings(store, None, shared_store).shared_store
    shared = None if place is None else SharedStore.at(place)
    with opened(store, new=new or shared is not None) as found:
        yield found, None if shared is None else StoreMirror(found, shared)


def run(arguments: argparse.Namespace) -> None:
    """Check the asset, and write the file, which appears when it is complete."""
    from rhytid.baking.assets import bring, naming_store
    from rhytid.support.atomic_files import atomic_write, write_pieces

    out: Path = arguments.out or Path(f"{arguments.asset}{SUFFIX}")
    if out.is_dir():
        out /= f"{arguments.asset}{SUFFIX}"
    make_place(out)
    with mirrored(arguments.store, arguments.shared_store, new=False) as (store, mirror):
        if mirror is not None:
            bring(mirror, arguments.asset)
        with (
            naming_store(local_settings(arguments.store, None).store),
            working(f"writing {out}"),
            store.snapshots.of(arguments.asset) as made,
            atomic_write(out) as aside,
        ):
            write_pieces(aside, made.pieces())
    figures = {"asset": arguments.asset, "file": str(out), "bytes": made.nbytes}
    report(figures, f"{out}: {made.nbytes} bytes", arguments.json)
