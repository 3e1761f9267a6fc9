"""Asks a server for an asset and tiles by every method: run by `docker/check` in the image."""

from __future__ import annotations

import sys
import time

import numpy as np

from rhytid_client import Client, ConnectionFailed, ServerError

SIDE = 5


def patch() -> bytes:
    """A small curved patch as OBJ text."""
    v, u = np.mgrid[0:SIDE, 0:SIDE] / (SIDE - 1)
    z = 0.1 * np.sin(3 * u) * np.cos(2 * v)
    lines = [f"v {x} {y} {h}" for x, y, h in np.stack([u, v, z], -1).reshape(-1, 3)]
    lines += [f"vt {0.1 + 0.8 * x} {0.1 + 0.8 * y}" for x, y in np.stack([u, v], -1).reshape(-1, 2)]
    for corner in (SIDE * j + i + 1 for j in range(SIDE - 1) for i in range(SIDE - 1)):
        quad = (corner, corner + 1, corner + SIDE + 1, corner + SIDE)
        lines.append("f " + " ".join(f"{n}/{n}" for n in quad))
    return "\n".join(lines).encode()


def main(url: str, key: str) -> None:
    """Print what was drawn."""
    settings = {"resolution": 512, "tile_size": 256, "graph": {"wrinkles": 2000}}
    with Client(url, key=key) as rhytid:
        for _ in range(600):
            try:
                print("devices:", [device.name for device in rhytid.devices()])
                break
            except (ConnectionFailed, ServerError):
                time.sleep(0.1)
        made = rhytid.create_asset(patch(), name="patch.obj", settings=settings)
        asset = rhytid.wait(made)
        for method in ("neutral", "redraw", "binned", "convolved"):
            tile = rhytid.tile(asset, "neutral", 1001, 0, 0, 0, method=method).array
            assert tile.shape == (256, 256), tile.shape
            assert np.abs(tile).max() > 0
        print("drawn by neutral, redraw, binned and convolved")


main(*sys.argv[1:])
