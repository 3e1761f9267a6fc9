"""A live loop: positions in, tiles out, frame after frame, with nothing stored.

python examples/live_loop.py rhytid-demo/face.npz --frames 60
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

from rhytid_client import Client


def main() -> None:
    """Play the frames of a .npz and ask for a few tiles of each, as a viewport would."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("mesh", help="npz with a mesh and its 'frames'")
    parser.add_argument("--url", default="http://127.0.0.1:8717", help="address of the service")
    key = os.environ.get("RHYTID_KEY")
    parser.add_argument("--key", default=key, help="its API key (default: RHYTID_KEY, if any)")
    parser.add_argument("--frames", type=int, default=60, help="how many frames to play")
    parser.add_argument("--resolution", type=int, default=2048, help="texels per side of a map")
    parser.add_argument("--wrinkles", type=int, help="how many to grow, instead of by the unit")
    options = parser.parse_args()

    settings: dict[str, object] = {"resolution": options.resolution}
    if options.wrinkles:
        settings["graph"] = {"wrinkles": options.wrinkles}
    with np.load(options.mesh) as file:
        arrays = {name: file[name] for name in ("positions", "faces", "uv", "face_uv")}
        animation = file["frames"]
    with Client(options.url, key=options.key) as rhytid:
        asset = rhytid.wait(rhytid.create_asset(arrays, settings=settings))
        # The maps of `binned` are made for stretch up to that of this frame.
        rhytid.wait(rhytid.calibrate(asset, animation[len(animation) // 2]))
        # A viewport asks for the tiles that it shows: udim, level, row, column.
        shown = [(udim, 1, 0, 0) for udim in asset.udims]
        for number in range(options.frames):
            start = time.perf_counter()
            positions = animation[number % len(animation)]
            tiles = rhytid.tiles(asset, positions, shown, method="binned", format="f16")
            deepest = min(float(tile.array.min()) for tile in tiles)
            seconds = time.perf_counter() - start
            print(f"frame {number}: {1000 * seconds:.1f} ms, deepest furrow {deepest:.4g}")


if __name__ == "__main__":
    main()
