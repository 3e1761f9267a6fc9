"""What an engine holds of memory after many assets were made, drawn and deleted.

`PYTHONPATH=tests:$PYTHONPATH python -m attack.measure_assets 1000` makes so many small assets, one
after the other, and writes a line every hundred: MiB that are resident, MiB that the device's
budget counts, and objects that Python's collector knows.
"""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from attack.served import resident
from engine.engines import BINNED, CONVOLVED, REDRAW, built, new_asset, running
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.tiles import TileAddress
from rhytid.engine.engine import Engine

MIB = 1 << 20
ADDRESS = TileAddress(1001, 0, 1, 1)
LINE = 100


def one(engine: Engine, seed: int) -> None:
    """Make an asset, draw some of it, and delete it."""
    asset = built(engine, new_asset(seed=seed))
    engine.frames.put(asset, "bent", deform(sheet().positions, seed, 0.15))
    for query in (REDRAW, BINNED, CONVOLVED):
        engine.tiles.plan(asset, "bent", query, ADDRESS).draw()
    engine.assets.delete(asset)


def main(count: int) -> None:
    """Make `count` assets and print a table."""
    with TemporaryDirectory() as folder, running(Path(folder) / "store") as engine:
        print(f"{'assets':>8}{'resident':>10}{'device':>8}{'objects':>9}")  # noqa: T201
        for number in range(1, count + 1):
            one(engine, number)
            if number % LINE == 0 or number == 1:
                gc.collect()
                held = resident(os.getpid()) / MIB
                used = engine._device.budget.used / MIB
                known = len(gc.get_objects())
                print(f"{number:8}{held:10.1f}{used:8.2f}{known:9}", flush=True)  # noqa: T201


if __name__ == "__main__":
    main(int(sys.argv[1]))
