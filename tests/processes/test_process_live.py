"""A live connection to `rhytid serve`, whose engine runs in a process of its own."""

from __future__ import annotations

import io
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from api.asking import built
from api.patch import positions, smile, upload
from processes.served import await_value, children, serving
from rhytid_client import Client, ProblemError
from rhytid_client.live.blocking import Live

pytestmark = [pytest.mark.slow, pytest.mark.release]


def drawn(live: Live, weight: float) -> bool:
    """Whether a frame was drawn, and not refused because the device restarts."""
    live.send(weights=[weight])
    try:
        list(live.receive(60))
    except ProblemError as problem:
        return problem.status != 503
    return True


def test_a_connection_outlives_the_process_of_the_device(tmp_path: Path, faults: Path) -> None:
    file = io.BytesIO()
    np.savez(file, shapes=smile(0.5)[None], names=["jawOpen"])
    tiles = [(1001, 0, 1, 1), (1001, 0, 2, 2)]
    with serving(tmp_path, faults) as served, Client(str(served.client.base_url)) as client:
        asset = built(served.client, {**upload(), "shapes": ("s.npz", file.getvalue())})
        half = 0.5 * (smile(0.5) + positions())
        expected = [tile.array for tile in client.tiles(asset, half, tiles, method="binned")]
        with client.live(asset, tiles=tiles, method="binned", tolerance=0.0) as live:
            live.send(weights=[0.5])
            first = [tile.array for tile in live.receive()]
            os.kill(served.child, signal.SIGKILL)
            await_value(lambda: children(served.process.pid) and served.ready())
            for weight in (1.0, 0.5):  # a call that meets the restart may be refused
                await_value(lambda weight=weight: drawn(live, weight))
            live.look([(1001, 0, 3, 3)])
            list(live.receive())
            live.look(tiles)
            again = [tile.array for tile in live.receive()]
        for found in (first, again):
            assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
