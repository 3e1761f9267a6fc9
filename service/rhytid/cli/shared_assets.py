"""Assets of a shared store, for commands."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from rhytid.cli.progress import share_bar, working
from rhytid.cli.timing import Stopwatch
from rhytid.cli.voice import note
from rhytid.errors import NotFoundError, SharedDamageError, SharedStoreError
from rhytid.support.settings import ServiceSettings

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine
    from rhytid.storage.shared.mirror import StoreMirror

# Between two looks at how far a job is.
_SHOWN_SECONDS = 0.2


def bring(mirror: StoreMirror, asset: str) -> bool:
    """As `StoreMirror.bring`; where the shared store cannot be used and the asset is here, it stays
    as it is, and the user is told."""
    try:
        with working(f"fetching asset {asset}"):
            return mirror.bring(asset, lambda share, file: None)
    except (SharedStoreError, SharedDamageError) as error:
        if not mirror.has(asset):
            raise
        note(f"rhytid: asset {asset} is taken as it is here: {error}")
        return False


@contextmanager
def searching(store: Path) -> Iterator[None]:
    """Within the block, a NotFoundError names the folder of the store, too."""
    try:
        yield
    except NotFoundError as error:
        raise NotFoundError(f"{error}; the store is {store}") from error


def fetch(settings: ServiceSettings, asset: str, watch: Stopwatch) -> None:
    """As `bring`, for an engine that is not there yet, a step of its own; nothing where no shared
    store has the asset, or there is none."""
    from rhytid.storage.shared.mirror import StoreMirror
    from rhytid.storage.shared.shared_store import SharedStore
    from rhytid.storage.store import AssetStore

    if settings.shared_store is None:
        return
    shared, start = SharedStore.at(settings.shared_store), perf_counter()
    with AssetStore(settings.store) as store, suppress(NotFoundError):  # who needs it is told
        if bring(StoreMirror(store, shared), asset):
            watch.add("fetch", perf_counter() - start)


def share(engine: Engine, asset: str) -> None:
    """Wait until the shared store, if there is one, has an asset as it is now. Where that fails the
    user is told: what was made of the asset is good."""
    job = engine.shared.push(asset)
    if job is None:
        return
    with share_bar("pushing") as show:
        while not job.wait(_SHOWN_SECONDS):
            show(job.info.progress, job.info.stage)
    if job.info.state != "done":
        note(f"rhytid: asset {asset} is not in the shared store: {job.reason or job.info.detail}")
