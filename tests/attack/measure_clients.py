"""What clients that stall take: `PYTHONPATH=tests:$PYTHONPATH python -m attack.measure_clients`.

12 clients that read nothing of maps of 256 MiB, 700 connections that send one letter each (of which
one address may have 512), and 4 that send 150 MiB of an upload and stop.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from api.asking import built
from api.patch import upload
from attack.bombs import MIB
from attack.clients import connected, is_open, not_reading, sending
from attack.served import Attacked, Peak, serving

SECONDS = 75


def readers(server: Attacked) -> str:
    """Clients that do not read."""
    asset = built(server.client, upload(resolution=8192, tile_size=512))
    path = f"/v1/assets/{asset}/frames/neutral/maps/1001"
    with Peak(server) as peak:
        held = [not_reading(server, path) for _ in range(12)]
        began, back = time.monotonic(), None
        while back is None and time.monotonic() < began + 4 * SECONDS:
            time.sleep(1)
            used = server.client.get("/v1/memory").json()["host"]["used"]
            if time.monotonic() > began + 20 and used == 0:
                back = time.monotonic() - began
    for one in held:
        one.close()
    late = "never" if back is None else f"{back:.0f} s"
    return f"peak {peak.more / MIB:,.0f} MiB more, all given back after {late}"


def letters(server: Attacked) -> str:
    """Connections that send one letter."""
    held = []
    for _ in range(700):
        held.append(connected(server))
        held[-1].sendall(b"G")
    time.sleep(SECONDS)
    left = sum(is_open(one) for one in held)
    for one in held:
        one.close()
    return f"{left} of {len(held)} open after {SECONDS} s"


def bodies(server: Attacked) -> str:
    """Uploads that stop."""
    with Peak(server) as peak, ThreadPoolExecutor(4) as pool:
        held = list(pool.map(lambda _: sending(server, 150 * MIB, 200 * MIB), range(4)))
        before = server.client.get("/v1/memory").json()["spool"]["used"]
        time.sleep(SECONDS)
        after = server.client.get("/v1/memory").json()["spool"]["used"]
    left = sum(is_open(one) for one in held)
    disk = f"{before / MIB:,.0f} MiB of disk, {after / MIB:,.0f} after {SECONDS} s"
    return f"{left} of 4 open, {disk}, peak of memory {peak.more / MIB:,.0f} MiB more"


def main() -> None:
    """Measure those that are named, or all."""
    for one in (letters, bodies, readers):
        if not sys.argv[1:] or one.__name__ in sys.argv[1:]:
            with TemporaryDirectory() as folder, serving(Path(folder)) as server:
                sys.stdout.write(f"{one.__name__}: {one(server)}\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
