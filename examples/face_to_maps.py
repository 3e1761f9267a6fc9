"""A face mesh to displacement maps over HTTP: one EXR per UDIM and frame.

rhytid demo && rhytid serve --store rhytid-store
python examples/face_to_maps.py rhytid-demo/face.npz --out service-maps
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from rhytid_client import Client


def main() -> None:
    """Send the mesh, wait for its skin, and save a map of every frame that came with it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("mesh", type=Path, help="OBJ, PLY, glTF, GLB or npz")
    parser.add_argument("--out", type=Path, default=Path("service-maps"), help="folder of the maps")
    parser.add_argument("--url", default="http://127.0.0.1:8717", help="address of the service")
    key = os.environ.get("RHYTID_KEY")
    parser.add_argument("--key", default=key, help="its API key (default: RHYTID_KEY, if any)")
    parser.add_argument("--resolution", type=int, default=2048, help="texels per side of a map")
    parser.add_argument("--wrinkles", type=int, help="how many to grow, instead of by the unit")
    options = parser.parse_args()

    settings: dict[str, object] = {"resolution": options.resolution}
    if options.wrinkles:
        settings["graph"] = {"wrinkles": options.wrinkles}
    options.out.mkdir(parents=True, exist_ok=True)
    with Client(options.url, key=options.key) as rhytid:
        asset = rhytid.wait(rhytid.create_asset(options.mesh, settings=settings))
        # The frames of a mesh file are called 0001, 0002, …, as `rhytid bake` calls them.
        for frame in rhytid.frames(asset)[1:]:  # the first is "neutral"
            for udim in asset.udims:
                tile = rhytid.map(asset, frame.name, udim, method="redraw", format="exr")
                print(tile.save(options.out, name=options.mesh.stem))


if __name__ == "__main__":
    main()
