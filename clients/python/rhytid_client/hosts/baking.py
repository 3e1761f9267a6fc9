"""Frames of a scene as files of displacement."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rhytid_client import npy, png
from rhytid_client.hosts.files import replaced, slug
from rhytid_client.hosts.sequences import MapSequence
from rhytid_client.hosts.server import Drawing, Server
from rhytid_client.hosts.work import Step

# Texels of 4 x 4 of the displacement.
SHINE_LEVEL = 2
# What a file of shine says of skin without relief, and how many bytes that is in at most.
_NOTE, _HEAD = "base_roughness", 4096


def baking(
    server: Server,
    asset: str,
    maps: MapSequence,
    positions: Callable[[int], ArrayLike],
    drawing: Drawing,
    roughness: float | None = None,
) -> Generator[Step, None, tuple[str, ...]]:
    """Draw each frame of `maps` and write its files, one frame a step; returns warnings.

    positions: (V, 3) at a frame.  roughness: of skin without relief; where it is given, files of
    shine are written beside. Closed, it leaves the files of the frames before, whole. Raises
    Trouble.
    """
    warned: dict[str, None] = {}
    count, who = len(maps.frames), f"bake-{slug(maps.name)}"
    drawings = [drawing]
    if roughness is not None:
        drawings.append(slopes(drawing))
    for done, frame in enumerate(maps.frames):
        yield done / count, f"frame {frame} of {maps.frames[-1]}", 0.0
        drawn, found = server.drawn_each(asset, who, positions(frame), maps.udims, drawings)
        warned |= dict.fromkeys(found)
        for udim, data in drawn[0].items():
            replaced(Path(maps.file(udim, frame)), data)
        if roughness is not None:
            for udim, data in drawn[1].items():
                replaced(maps.shine.file(udim, frame), shine(npy.decode(data), roughness))
    return tuple(warned)


def slopes(drawing: Drawing) -> Drawing:
    """What `shine` is made of, beside a drawing of displacement."""
    return replace(drawing, format="npy", layer="slopes", level=SHINE_LEVEL)


def roughness_of(file: Path) -> float | None:
    """The roughness that a file of shine was made with; None where it does not say, or is not
    there."""
    try:
        with file.open("rb") as opened:
            return float(png.notes_of(opened.read(_HEAD))[_NOTE])
    except (OSError, KeyError, ValueError):
        return None


def shine(moments: NDArray[np.float32], roughness: float, *, quick: bool = False) -> bytes:
    """A PNG of 16 bits from moments of slopes (n, n, 5): what Cycles takes, so that it may be
    filtered.

    Red is the roughness. Green and blue, as 2 value - 1, are the anisotropy times cosine and sine
    of twice the angle of the axis from the tangent towards the bitangent. alpha² = roughness⁴ + 2
    variance along each axis; the roughness is √(ρ₁ ρ₂), the anisotropy (1 - (ρ₂/ρ₁)²) / 0.9 at
    most 1, as "docs/shine.md" has them.  quick: a larger file, in less time.
    """
    x, y, xx, xy, yy = np.moveaxis(moments.astype(np.float64), -1, 0)
    xx, xy, yy = xx - x * x, xy - x * y, yy - y * y
    mean, half, size = (xx + yy) / 2, (xx - yy) / 2, np.hypot((xx - yy) / 2, xy)
    first, second = (
        np.sqrt((roughness**4 + 2.0 * np.maximum(part, 0.0)).clip(1e-8, 1.0))
        for part in (mean + size, mean - size)
    )
    strength = np.minimum((1.0 - second / first) / 0.9, 1.0) / np.maximum(size, 1e-30)
    values = [(first * second) ** 0.25, 0.5 + 0.5 * strength * half, 0.5 + 0.5 * strength * xy]
    codes = np.rint(65535.0 * np.stack(values, -1)).astype(np.uint16)
    return png.rgb16(codes, {_NOTE: repr(float(roughness))}, quick=quick)
