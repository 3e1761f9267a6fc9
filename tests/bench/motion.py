"""Skin in motion, as the table and the picture of docs/skin.md have it:

    python tests/bench/motion.py FACE.npz COMPOSITES.json OUT.jpg [--device D]

FACE.npz and COMPOSITES.json are as in skin_pictures.py. The face shuts its eyes, smiles, raises its
brows and comes to rest again in 60 frames, with ease, and holds each pose for three. Skin is grown
with the default settings and drawn at 4096² by both methods. Printed for each:

still: whether frames of equal positions have equal maps, bit for bit.
step: the largest change of a texel from a frame to the next, and with twice as many frames: half of
it where heights move without a jump.
slide: how far the deepest point across a leader moves, of its half width, while it is deep.
flash: leaders that are deeper by 10 um on the way between two poses than in both.

The picture has a line of skin of each place, across its leaders, under which the frames follow from
top to bottom.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from patchiness import Face
from skin_pictures import LEADERS, Pictures, Place

from rhytid.domain.graph import WrinkleGraph
from rhytid.engine.engine import open_device
from rhytid.engine.frames import Frame
from rhytid.pictures.images import to_picture
from rhytid.pictures.relief import spline_samples
from rhytid.pictures.sheet import Panel, sheet
from rhytid.pictures.surface_patch import SurfacePatch
from rhytid.support.settings import ServiceSettings
from rhytid_lab.bench.skin import Skin

POSES = (None, "eyes_closed_tight", "big_smile", "brows_up", None)
# Frames from a pose to the next, and that each is held for.
EASED, HELD = 12, 3
METHODS = ("redraw", "binned")
# A leader is looked at so many half widths to each side, at so many points; it is deep from a share
# of its largest depth on. Micrometres: what leaders move by that count, and a flash.
REACH, POINTS, DEEP, MOVES, FLASH = 1.0, 33, 0.5, 4.0, 10.0
# Of the picture: micrometres from grey to black, and rows of a frame.
SHOWN, ROWS = 60.0, 5
CAPTION = (
    "36 mm of skin across its leaders, black where it is deep. Time runs down, 60 frames: eyes "
    "shut, a smile, raised brows, rest."
)
MICRONS = 1e4  # per centimetre, the unit of the face
Weights = NDArray[np.float64]
Map = NDArray[np.float32]


def weights_of_frames(poses: list[Weights], eased: int) -> list[Weights]:
    """Of each frame: eased from pose to pose, and held."""
    found = []
    for before, after in pairwise(poses):
        for t in np.arange(1, eased + 1) / eased:
            share = t**3 * (t * (6 * t - 15) + 10)
            found.append(before + share * (after - before))
        found += [after] * HELD
    return found


@dataclass(frozen=True)
class Leaders:
    """Wrinkles that take the largest shares.

    uv: (N, POINTS, 2) across each.  half_widths: of the points' range, N of them, texels.
    """

    uv: Weights

    @classmethod
    def of(cls, graph: WrinkleGraph, udim: int) -> Leaders:
        """Those whose share is above 1, of one UDIM."""
        assert graph.edge_share is not None
        corner = np.array([(udim - 1001) % 10, (udim - 1001) // 10])
        ends = graph.node_uv[graph.edge_nodes].astype(np.float64) - corner
        inside = ((ends > 0) & (ends < 1)).all(axis=(1, 2))
        chosen = np.flatnonzero((graph.edge_share > 1.0) & inside & (graph.edge_weight > 0))
        along = ends[chosen, 1] - ends[chosen, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        way = (
            np.linspace(-REACH, REACH, POINTS)[:, None] * graph.edge_half_width[chosen, None, None]
        )
        return cls(ends[chosen].mean(axis=1)[:, None] + way * across[:, None])

    def profiles(self, drawn: Map) -> Weights:
        """(N, POINTS) heights, micrometres."""
        size = len(drawn)
        rows, columns = (1 - self.uv[..., 1]) * size - 0.5, self.uv[..., 0] * size - 0.5
        return MICRONS * spline_samples(drawn, rows, columns)


def slide(profiles: Weights) -> Weights:
    """(N,) of (frames, N, POINTS): how far the deepest point moves, of the half width, while the
    middle is deep."""
    at = (profiles.argmin(axis=2) - POINTS // 2) * (2 * REACH / (POINTS - 1))
    depth = profiles.max(axis=2) - profiles.min(axis=2)
    deep = depth >= DEEP * depth.max(axis=0)
    low = np.where(deep, at, np.inf).min(axis=0)
    high = np.where(deep, at, -np.inf).max(axis=0)
    return high - low


def flashes(depth: Weights) -> Weights:
    """(N,) of (frames, N): how far a leader is deeper on the way between two poses than in both."""
    found = np.zeros(depth.shape[1])
    for first in range(0, len(depth), EASED + HELD):
        way = depth[max(first - 1, 0) : first + EASED]
        found = np.maximum(found, way.max(axis=0) - np.maximum(way[0], way[-1]))
    return found


def largest_step(maps: Iterator[Map]) -> float:
    """The largest change of a texel from a map to the next, micrometres."""
    before, found = next(maps), 0.0
    for drawn in maps:
        found = max(found, float(np.abs(drawn - before).max()))
        before = drawn
    return MICRONS * found


def across(patch: SurfacePatch, drawn: Map, place: Place) -> Weights:
    """(P,) heights of a line across the leaders of a place, micrometres: upright where these are
    level."""
    heights = MICRONS * patch.heights(drawn)
    middle = len(heights) // 2
    return heights[:, middle] if place.expression == "brows_up" else heights[middle]


class Motion:
    """A face with its skin, which moves from pose to pose."""

    def __init__(self, pictures: Pictures, face: Face) -> None:
        made, settings = pictures.grown()
        self._pictures = pictures
        self._poses = [pictures.weights(name) for name in POSES]
        self._skin = Skin(face.device, face.mesh, made.graph, settings, face.udim)
        self._leaders = Leaders.of(made.graph, face.udim)
        rest = pictures.posed(self._poses[0])
        self._patches = [pictures.patch(rest, place) for place in LEADERS]

    def maps(self, weights: list[Weights], method: str) -> Iterator[Map]:
        """Displacement of each frame, mesh units."""
        for row in weights:
            yield self._skin.map(Frame.of(self._pictures.posed(row)), method)

    def measure(self, method: str) -> list[Panel]:
        """Print the figures of a method; a panel for each place."""
        weights = weights_of_frames(self._poses, EASED)
        digests, profiles = [], []
        lines: list[list[Weights]] = [[] for _ in LEADERS]
        for drawn in self.maps(weights, method):
            digests.append(hashlib.sha256(drawn.tobytes()).hexdigest())
            profiles.append(self._leaders.profiles(drawn))
            for line, patch, place in zip(lines, self._patches, LEADERS, strict=True):
                line.append(across(patch, drawn, place))
        steps = [
            largest_step(self.maps(weights_of_frames(self._poses, frames), method))
            for frames in (EASED, 2 * EASED)
        ]
        report(method, weights, digests, np.array(profiles), steps)
        return [
            panel(f"{method}: {place.expression}", np.array(line))
            for line, place in zip(lines, LEADERS, strict=True)
        ]


def report(
    method: str, weights: list[Weights], digests: list[str], profiles: Weights, steps: list[float]
) -> None:
    """Print figures.  profiles: (frames, N, POINTS).  steps: of these frames, and of twice as
    many."""
    maps: dict[bytes, set[str]] = {}
    for row, digest in zip(weights, digests, strict=True):
        maps.setdefault(row.tobytes(), set()).add(digest)
    still = all(len(found) == 1 for found in maps.values())
    depth = np.ptp(profiles, axis=2)
    moving = np.ptp(depth, axis=0) >= MOVES
    slides = slide(profiles[:, moving])
    over = flashes(depth[:, moving])
    sys.stdout.write(
        f"{method}: still {'yes' if still else 'NO'}; step {steps[0]:.1f} um, of twice as many "
        f"frames {steps[1]:.1f} ({steps[1] / steps[0]:.2f}); {moving.sum()} of {len(moving)} "
        f"leaders change by {MOVES:g} um: slide {np.median(slides):.2f}, 99 % below "
        f"{np.quantile(slides, 0.99):.2f}; flash {100 * np.mean(over > FLASH):.1f} %, "
        f"at most {over.max():.0f} um\n"
    )


def panel(title: str, line: Weights) -> Panel:
    """Heights (frames, P) of a line of skin, the frames from top to bottom."""
    grey = 0.5 + (line - np.median(line)) / (2 * SHOWN)
    return Panel(title.replace("_", " "), np.repeat(to_picture(grey), ROWS, axis=0))


def main() -> None:
    """Print the table and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("composites", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--device")
    arguments = parser.parse_args()
    face = Face(open_device(ServiceSettings(), arguments.device), arguments.face)
    motion = Motion(Pictures(face, arguments.face, arguments.composites), face)
    rows = [motion.measure(method) for method in METHODS]
    sheet(rows, CAPTION).save(arguments.out, quality=88)


if __name__ == "__main__":
    main()
