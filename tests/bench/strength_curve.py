"""How the relief answers to `strength`, as the table and the plot of docs/artists.md have it:

    python tests/bench/strength_curve.py OUT.png [--side 2.0] [--resolution 1024] [--device D]

A flat square of `side` cm in the default look is grown and drawn at each strength. Prints, and
plots over strength 1, the mean depth, the root mean square of all around it, and that of the lines
and pores alone, without grain and undulation.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.preview import resident
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.engine.engine import open_device
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.engine.messages import MapQuery
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import synthesize
from rhytid_lab.plots import Point, curves

STRENGTHS = (0.25, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83, 4.0)
FLAT = {"shape": {"grain": 0.0, "undulation": 0.0}}
# Of the square in UV, and what of a side is left out at each border.
INSIDE, BORDER = (0.1, 0.9), 0.1


def square(side: float, count: int = 16) -> Mesh:
    """A flat square, `side` cm wide, in the middle of UDIM 1001."""
    at = np.linspace(0.0, 1.0, count + 1)
    xy = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    rows = np.arange(count * (count + 1)).reshape(count, count + 1)[:, :-1].ravel()
    a, b, c, d = rows, rows + 1, rows + count + 2, rows + count + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    uv = INSIDE[0] + (INSIDE[1] - INSIDE[0]) * xy
    positions = side * np.pad(xy, ((0, 0), (0, 1)))
    return Mesh(positions.astype(np.float32), faces, uv, faces)


def drawn(
    device: Device, mesh: Mesh, strength: float, resolution: int, shape: dict[str, object]
) -> NDArray[np.float64]:
    """Heights well inside the square, micrometres."""
    asked = AssetSettings.parse(
        {"resolution": resolution, "tile_size": 256, "graph": {"strength": strength}, **shape}
    ).for_synthesis()
    made = synthesize(mesh, asked.graph, device)
    settings = asked.with_lengths(made.lengths)
    with resident(device, mesh, made.graph, settings) as asset:
        query = MapQuery("neutral")
        found = asset.drawing.to_host(NEUTRAL_FRAME, query, 1001, 0, 0, 0, resolution)
    low, high = (int(resolution * at) for at in (INSIDE[0] + BORDER, INSIDE[1] - BORDER))
    return 1e4 * found[low:high, low:high].astype(np.float64)


def figures(
    device: Device, mesh: Mesh, strength: float, resolution: int
) -> tuple[float, float, float]:
    """Minus the mean, the rms of all around it, and that of lines and pores."""
    whole = drawn(device, mesh, strength, resolution, {})
    lines = drawn(device, mesh, strength, resolution, FLAT)
    return -float(whole.mean()), float(whole.std()), float(lines.std())


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--side", type=float, default=2.0)
    parser.add_argument("--resolution", type=int, default=1024)
    parser.add_argument("--device")
    given = parser.parse_args()
    device, mesh = open_device(ServiceSettings(), given.device), square(given.side)
    found = {s: figures(device, mesh, s, given.resolution) for s in STRENGTHS}
    names = ("mean depth", "rms of all", "rms of lines and pores")
    points = [Point(s, s, "twice is twice") for s in STRENGTHS]
    for strength, values in found.items():
        told = ", ".join(f"{n} {v:5.1f}" for n, v in zip(names, values, strict=True))
        print(f"strength {strength:4g}: {told} µm")  # noqa: T201
        over = zip(names, values, found[1.0], strict=True)
        points += [Point(strength, value / usual, name) for name, value, usual in over]
    points.sort(key=lambda point: point.series)
    curves(points, "strength", "relief, over that of strength 1").savefig(given.out)


if __name__ == "__main__":
    main()
