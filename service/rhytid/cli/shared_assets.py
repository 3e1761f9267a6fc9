"""Assets of a shared store, for commands with an engine in this process."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from rhytid.cli.progress import share_bar
from rhytid.cli.timing import Stopwatch
from rhytid.cli.voice import note
from rhytid.errors import NotFoundError

if TYPE_CHECKING:
    from rhytid.engine.engine import Engine

# Between two looks at how far a job is.
_SHOWN_SECONDS = 0.2


def bring(engine: Engine, asset: str, watch: Stopwatch) -> None:
    """Fetch an asset that is not here, a step of its own, if there is a shared store that has it;
    raises what that does where it cannot be read."""
    if all(known.id != asset for known in engine.assets.all()):
        with suppress(NotFoundError), watch.step("fetch"):  # who asks for it is told
            engine.shared.bring(asset)


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
