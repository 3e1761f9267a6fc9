"""Relief of regions of a face beside that of a scanned head, as the table of docs/skin.md has it:

    python tests/bench/beside_scan.py FACE.npz SCAN [--age 35] [--seeds 1 2 3] [--device D]

FACE.npz is the ICT face with expressions of ARKit's names as `shapes`, SCAN a folder with
Lee Perry-Smith's `LeePerrySmith.glb` and `displacement_4096.jpg`. Skin is grown with the default
settings and drawn at rest at 4096². 16 mm around places of each region are looked at, of the scan
where its map has skin: not lashes, brows or nostrils. Figures are the median of places and seeds,
skewness the least and the most.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from rhytid.baking.input_files import mesh_file, shape_files
from rhytid.cli.preview import drawn_under, resident
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.engine.engine import open_device
from rhytid.meshes.relief import levelled
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch
from rhytid.pipeline.folds import measured_folds
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.workspace import directly

FloatArray = NDArray[np.float64]
Places = dict[str, tuple[tuple[float, float], ...]]
UNIT, RESOLUTION, UDIM = "cm", 4096, 1001
# Of the scan: centimetres to a unit, micrometres to a code.
SCAN_UNIT, SCAN_CODE = 5.5, 17.3
# Millimetres: a side of a patch and of a pixel; deviations of the Gaussians that take waves above
# 5 mm out, that bound the band of 0.45 to 4 mm, and that make windows of 2 mm, with their rim.
SIDE, STEP, LONG, BAND, WINDOW, RIM = 16.0, 0.05, 1.25, (0.15, 1.2), 1.0, 3.0
OCTAVES = (0.45, 0.7, 1.0, 1.5, 2.2, 3.3, 5.0)
# Beyond where the autocorrelation falls below 0, so far it is looked at, and in such steps.
FARTHEST, APART = 4.5, 0.1
# Texels beside a patch that a spline through texels needs.
_SPLINE = 20
# How far from a place the foremost skin is looked for, and normals are averaged.
_NEAR, _AROUND = 3.0, 5.0
# Right and up, cm. The same of both faces, as nearly as their forms allow.
OURS: Places = {
    "forehead": ((1.5, 7.0), (-1.5, 7.0), (0.0, 8.0), (3.0, 6.8), (-3.0, 6.8)),
    "cheek": ((4.6, -1.0), (-4.6, -1.0), (4.2, -2.2), (-4.2, -2.2), (5.0, 0.0)),
    "eye": ((5.9, 2.8), (-5.9, 2.8), (5.8, 2.0), (-5.8, 2.0)),
    "mouth": ((3.6, -3.2), (-3.6, -3.2), (3.4, -4.6), (-3.4, -4.6), (3.2, -2.2), (-3.2, -2.2)),
    "nose": ((0.3, 2.2), (-0.3, 2.2), (0.0, 2.8)),
    "neck": ((2.0, -12.0), (-2.0, -12.0), (1.0, -10.8), (-1.0, -10.8), (3.0, -11.4), (-3.0, -13.0)),
}  # fmt: skip
SCANNED: Places = {
    "forehead": ((1.5, 12.6), (-1.5, 12.6), (0.0, 13.4), (3.0, 12.4), (-3.0, 12.4)),
    "cheek": ((4.6, 5.0), (-4.6, 5.0), (4.2, 3.6), (-4.2, 3.6), (5.0, 5.8)),
    "eye": ((5.9, 8.5), (5.8, 7.7), (-5.8, 7.7)),
    "mouth": ((3.6, 2.0), (-3.6, 2.0), (3.4, 0.6), (-3.4, 0.6), (3.2, 3.0), (-3.2, 3.0)),
    "nose": ((0.3, 8.0), (-0.3, 8.0), (0.0, 8.6)),
    "neck": ((2.0, -6.0), (-2.0, -6.0), (1.0, -5.0), (-1.0, -5.0), (3.0, -5.6), (-3.0, -7.0)),
}


@dataclass(frozen=True)
class Figures:
    """Of one patch.  rms, octaves: micrometres, of waves below 5 mm and by wavelength.  skew: of
    heights without longer waves.  patchiness: coefficient of variation of the local root mean
    square.  ring: the most of the autocorrelation beyond where it falls below 0."""

    rms: float
    skew: float
    patchiness: float
    ring: float
    octaves: FloatArray

    @classmethod
    def of(cls, relief: FloatArray) -> Figures:
        """Of heights (P, P), micrometres."""
        level = levelled(relief)
        short = _without(level, LONG)
        skew = float(((short - short.mean()) ** 3).mean() / short.std() ** 3)
        band = gaussian_filter(level, BAND[0] / STEP) - gaussian_filter(level, BAND[1] / STEP)
        rim = slice(round(RIM / STEP), -round(RIM / STEP))
        local = np.sqrt(gaussian_filter(band**2, WINDOW / STEP))[rim, rim]
        patchiness = float(local.std() / local.mean())
        return cls(float(short.std()), skew, patchiness, ring(band), octaves(level))


def _without(level: FloatArray, size: float) -> FloatArray:
    found: FloatArray = level - gaussian_filter(level, size / STEP)
    return found


def octaves(level: FloatArray) -> FloatArray:
    """Root mean square of heights (P, P) by wavelength."""
    window = np.outer(*2 * [np.hanning(len(level))])
    power = np.abs(np.fft.fft2(level * window)) ** 2 / (window**2).sum() / level.size
    along = np.fft.fftfreq(len(level), STEP)
    wave = 1.0 / np.maximum(np.hypot(along[:, None], along), 1e-9)
    return np.array(
        [np.sqrt(power[(wave >= low) & (wave < high)].sum()) for low, high in pairwise(OCTAVES)]
    )


def ring(band: FloatArray) -> float:
    """The most of the mean autocorrelation by distance, beyond where it first falls below 0: what
    cells of one size have at their distance."""
    window = np.outer(*2 * [np.hanning(len(band))])
    both = [_correlated(values) for values in ((band - band.mean()) * window, window)]
    found = both[0] / np.maximum(both[1], both[1].max() * 1e-3)
    line = (np.arange(len(found)) - len(found) // 2) * STEP
    distance = (np.hypot(line[:, None], line) / APART).astype(int).ravel()
    mean = np.bincount(distance, (found / found.max()).ravel()) / np.bincount(distance)
    first = int(np.argmax(mean < 0.0))
    return float(mean[first : first + round(FARTHEST / APART)].max())


def _correlated(values: FloatArray) -> FloatArray:
    power = np.abs(np.fft.fft2(np.pad(values, ((0, len(values)),) * 2))) ** 2
    found: FloatArray = np.fft.fftshift(np.real(np.fft.ifft2(power)))
    return found


def heights(patch: SurfacePatch, drawn: NDArray[Any]) -> FloatArray:
    """(P, P) of a map, interpolated: to smooth it, as pictures do, takes more of coarse texels."""
    size = len(drawn)
    at = np.stack([(1.0 - patch.uv[..., 1]) * size - 0.5, patch.uv[..., 0] * size - 0.5])
    start = np.maximum(at.min(axis=(1, 2)).astype(int) - _SPLINE, 0)
    stop = at.max(axis=(1, 2)).astype(int) + _SPLINE
    part = drawn[start[0] : stop[0], start[1] : stop[1]].astype(np.float64)
    found: FloatArray = map_coordinates(part, at - start[:, None, None], order=3, mode="nearest")
    return found


def patches(
    mesh: Mesh, uv: NDArray[np.floating], unit: float, places: Places
) -> dict[str, list[SurfacePatch]]:
    """Those of each region.  uv (F, 3, 2).  unit: millimetres."""
    corners = mesh.positions[mesh.faces].astype(np.float64) * unit
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    pixels = round(SIDE / STEP)
    return {
        region: [
            surface_patch(corners, uv, _frame(corners, across, 10.0 * np.array(at)), SIDE, pixels)
            for at in every
        ]
        for region, every in places.items()
    }


def _frame(corners: FloatArray, across: FloatArray, at: FloatArray) -> Frame:
    """Around the foremost skin at a place (2,), by the mean normal of what is near."""
    middle = corners.mean(axis=1)
    away = np.where(across[:, 2] > 0.0, np.hypot(*(middle[:, :2] - at).T), np.inf)
    near = np.flatnonzero(away < max(away.min() + 1.5, _NEAR))
    origin = middle[near[middle[near, 2].argmax()]]
    weight = np.exp(-((middle - origin) ** 2).sum(axis=1) / (2.0 * _AROUND**2))
    return Frame.at(origin, (across * weight[:, None]).sum(axis=0))


def grown(
    device: Device, mesh: Mesh, expressions: Expressions, age: float, seeds: Sequence[int]
) -> dict[str, list[list[Figures]]]:
    """Of each region, seed and place of skin with the default settings."""
    limit = AssetSettings().response.log_stretch_limit
    folds = measured_folds(device, mesh, expressions, limit, UNIT, lambda *_: None, directly)
    seen = patches(mesh, mesh.triangle_uv(), 10.0, OURS)
    every = [patch for some in seen.values() for patch in some]
    found: dict[str, list[list[Figures]]] = {region: [] for region in seen}
    for seed in seeds:
        graph = {"age": age, "seed": seed}
        settings = AssetSettings.parse({"unit": UNIT, "graph": graph}).for_synthesis()
        made = synthesize(mesh, settings.graph, device, folds=folds, unit=UNIT)
        settings = settings.with_lengths(made.lengths).changed({"resolution": RESOLUTION})
        with resident(device, mesh, made.graph, settings) as asset:
            drawn = drawn_under(asset, UDIM, every, lambda *_: None)
        for region, some in seen.items():
            found[region].append([Figures.of(1e4 * heights(patch, drawn)) for patch in some])
    return found


def scanned(folder: Path) -> dict[str, list[list[Figures]]]:
    """The same of the scan. Its v points up in the file already, unlike glTF's: it is turned
    back."""
    mesh = mesh_file(folder / "LeePerrySmith.glb").mesh
    with Image.open(folder / "displacement_4096.jpg") as image:
        drawn = (np.asarray(image.convert("L"), np.float64) - 128.0) * SCAN_CODE
    seen = patches(mesh, mesh.triangle_uv() * (1, -1) + (0, 1), 10.0 * SCAN_UNIT, SCANNED)
    return {n: [[Figures.of(heights(p, drawn)) for p in some]] for n, some in seen.items()}


@dataclass(frozen=True)
class Summary:
    """Medians of places and seeds, of skew the least and the most."""

    rms: float
    skew: tuple[float, float]
    patchiness: float
    ring: float
    octaves: FloatArray

    @classmethod
    def of(cls, seeds: list[list[Figures]]) -> Summary:
        """Of the figures of places by seed."""
        every = [figures for places in seeds for figures in places]
        skew = [figures.skew for figures in every]
        medians = (
            float(np.median([getattr(figures, name) for figures in every]))
            for name in ("rms", "patchiness", "ring")
        )
        rms, patchiness, around = medians
        octave = np.median([figures.octaves for figures in every], axis=0)
        return cls(rms, (min(skew), max(skew)), patchiness, around, octave)

    def row(self, beside: Summary) -> str:
        """Of a table, with octaves in per cent of those of another."""
        share = " | ".join(f"{100 * v:.0f}" for v in self.octaves / beside.octaves)
        both = [
            f"{found.rms:.1f} | {found.skew[0]:.2f} to {found.skew[1]:.2f} | "
            f"{found.patchiness:.2f} | {found.ring:.3f}".split(" | ")
            for found in (self, beside)
        ]
        rms, skew, patchiness, around = (", ".join(pair) for pair in zip(*both, strict=True))
        return f"{rms} | {share} | {skew} | {patchiness} | {around}"


def main() -> None:
    """Print the rows of the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("face", type=Path)
    parser.add_argument("scan", type=Path)
    parser.add_argument("--age", type=float, default=35.0)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--device")
    arguments = parser.parse_args()
    read, device = mesh_file(arguments.face), open_device(ServiceSettings(), arguments.device)
    expressions = shape_files(None, read)
    assert expressions is not None
    wanted = scanned(arguments.scan)
    for region, found in grown(
        device, read.mesh, expressions, arguments.age, arguments.seeds
    ).items():
        row = Summary.of(found).row(Summary.of(wanted[region]))
        sys.stdout.write(f"| `{region}` | {row} |\n")


if __name__ == "__main__":
    main()
