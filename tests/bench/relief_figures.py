"""The relief of a patch of skin beside that of a scan: octaves, heights, slopes, and three plots:

    python tests/bench/relief_figures.py OUT_DIR --patch NAME MESH UNIT MAP X Y Z MM [--patch ...]
        [--v-up MESH.glb]

NAME is what the patch is called in plots, UNIT the millimetres of a unit of MESH. MAP is an EXR in
that unit, or a grey picture with 128 for 0 whose micrometres a code are given by `NAME@UM`.
(X, Y, Z) is a place on MESH and MM the side of the square around it, seen along its normal. The
form of the square, a polynomial of the second degree, is taken out. Writes spectrum.png,
heights.png and slopes.png and prints a table. A glTF file is read with its v down, as glTF has it;
`--v-up` names one whose v points up all the same, as in that of Lee Perry-Smith's head.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

sys.path.insert(0, str(Path(__file__).parents[1]))

from rhytid.baking.input_files import mesh_file
from rhytid.meshes.relief import levelled
from rhytid.pictures.surface_patch import Frame, surface_patch
from rhytid_lab.plots import Point, curves

PIXELS = 512
# Millimetres of a wave, from and to, and of a Gaussian that slopes are taken after.
OCTAVES = (0.3, 0.6, 1.2, 2.4, 4.8, 9.6)
SMOOTH = 0.1


@dataclass(frozen=True)
class Patch:
    """heights (P, P): micrometres on a square of the surface, `pixel` millimetres apart."""

    name: str
    heights: NDArray[np.float64]
    pixel: float

    def power(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Frequencies (P, P), waves per millimetre, and the mean square of heights at each."""
        window = np.outer(*2 * [np.hanning(PIXELS)])
        power = np.abs(np.fft.fft2(self.heights * window)) ** 2 / ((window**2).sum() * PIXELS**2)
        along = np.fft.fftfreq(PIXELS, self.pixel)
        return np.hypot(along[:, None], along), power

    def octaves(self) -> list[float]:
        """Root mean square of each, micrometres."""
        frequency, power = self.power()
        return [
            float(np.sqrt(power[(frequency > 1 / high) & (frequency <= 1 / low)].sum()))
            for low, high in pairwise(OCTAVES)
        ]

    def slopes(self) -> NDArray[np.float64]:
        """(P, P) how steep the surface is."""
        smooth = gaussian_filter(self.heights, SMOOTH / self.pixel)
        return np.hypot(*np.gradient(smooth, 1000 * self.pixel))


def patch(
    name: str,
    mesh: Path,
    unit: float,
    relief: Path,
    at: NDArray[np.float64],
    side: float,
    turned: bool = False,
) -> Patch:
    """The square of `side` mm around the place of a mesh that is nearest to `at`.  turned: whether
    v is read upside down."""
    name, _, per_code = name.partition("@")
    whole = mesh_file(mesh).mesh
    corners, uv = whole.positions[whole.faces].astype(np.float64), whole.triangle_uv()
    if turned:
        uv = uv * (1, -1) + (0, 1)
    nearest = int(np.argmin(((corners.mean(axis=1) - at) ** 2).sum(axis=-1)))
    frame = Frame.of(corners[nearest])
    seen = surface_patch(corners, uv % 1.0, frame, side / unit, PIXELS)
    heights = seen.heights(
        _relief(relief, 1000 * unit if relief.suffix == ".exr" else float(per_code))
    )
    return Patch(name, levelled(heights), side / PIXELS)


def _relief(file: Path, step: float) -> NDArray[np.float64]:
    """(R, R) micrometres, from `step` of them in a unit or a code."""
    if file.suffix == ".exr":
        with OpenEXR.File(str(file)) as found:
            return found.channels()["Y"].pixels.astype(np.float64) * step
    with Image.open(file) as image:
        return (np.asarray(image.convert("L"), np.float64) - 128) * step


def spectrum(patches: list[Patch]) -> list[Point]:
    """Root mean square in thirds of octaves, by wavelength."""
    points = []
    for found in patches:
        frequency, power = found.power()
        for wave in 0.25 * 2 ** np.arange(0, 16 / 3, 1 / 3):
            inside = np.abs(np.log2(np.maximum(frequency, 1e-9) * wave)) <= 1 / 6
            height = float(np.sqrt(power[inside].sum()))
            points.append(Point(float(wave), height, found.name))
    return points


def histogram(patches: list[Patch], slopes: bool) -> list[Point]:
    """Per cent of the area by how high or low, or how steep, it is."""
    points = []
    for found in patches:
        values = found.slopes() if slopes else np.abs(found.heights)
        edges = np.geomspace(0.005, 0.6, 25) if slopes else np.geomspace(1, 150, 25)
        count, _ = np.histogram(values, edges)
        share = 100 * count / values.size
        middle = np.sqrt(edges[:-1] * edges[1:])
        points += [
            Point(float(x), float(y), found.name)
            for x, y in zip(middle, share, strict=True)
            if y > 0.02
        ]
    return points


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--patch", nargs=8, action="append", required=True)
    parser.add_argument("--v-up", action="append", default=[])
    given = parser.parse_args()
    patches = [
        patch(name, Path(mesh), float(unit), Path(relief), np.array(at, float), float(side), up)
        for name, mesh, unit, relief, *at, side in given.patch
        for up in [mesh in given.v_up]
    ]
    given.out.mkdir(parents=True, exist_ok=True)
    area = "per cent of the area"
    for file, points, x, y in (
        (
            "spectrum",
            spectrum(patches),
            "wavelength, mm",
            "rms of a third octave, micrometres",
        ),
        ("heights", histogram(patches, False), "height over or under the mean, micrometres", area),
        ("slopes", histogram(patches, True), "slope", area),
    ):
        curves(points, x, y).savefig(given.out / f"{file}.png")
    for found in patches:
        slope, h = found.slopes(), found.heights
        skew = ((h - h.mean()) ** 3).mean() / h.std() ** 3
        octaves = " ".join(f"{rms:5.1f}" for rms in found.octaves())
        print(  # noqa: T201
            f"{found.name:24} octaves from 0.3 mm, µm: {octaves}   skew {skew:5.2f}"
            f"   slope rms {np.sqrt((slope**2).mean()):.3f} p99 {np.quantile(slope, 0.99):.3f}"
        )


if __name__ == "__main__":
    main()
