"""A process that pushes an asset: `python shared_writer.py STORE PLACE ID WHAT NUMBER`.

WHAT: `times`, pushes that often, with other settings each time; `until`, ends itself by SIGKILL
before the file of that number; `within`, in the middle of writing it.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from rhytid.errors import SharedStoreError
from rhytid.storage.shared import folder_backend
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.storage.store import AssetStore

_copy = folder_backend.copy_file


def main() -> None:
    folder, place, id, what, number = sys.argv[1:]
    with AssetStore(Path(folder)) as store:
        shared, left = SharedStore.at(place), int(number)
        if what == "times":
            # moto answers 500 where an object is replaced while it reads it.
            passing = SharedStoreError if place.startswith("s3:") else ()
            for turn in range(left):
                with suppress(passing):
                    push(store, shared, id, 0.1 + turn % 2 / 10)
            return

        def report(share: float, file: str) -> None:
            nonlocal left
            left -= 1
            if left < 0 and what == "until":
                die()
            folder_backend.copy_file = half if left < 0 else _copy  # type: ignore[assignment]

        with store.snapshots.of(id) as made:
            shared.push(made, report)


def push(store: AssetStore, shared: SharedStore, id: str, r_max: float) -> None:
    settings = store.overlay(id)
    assert settings is not None
    store.put_overlay(id, settings.with_r_max(r_max))
    with store.snapshots.of(id) as made:
        shared.push(made, lambda share, file: None)


def half(source: Path, to: Path) -> Any:
    data = source.read_bytes()
    to.write_bytes(data[: len(data) // 2])
    die()


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    main()
