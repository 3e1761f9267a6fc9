"""A patch of skin, 16 384² texels a UDIM, as a grid of points, for `shine_cycles.py`:

    python tests/bench/shine_patch.py NEUTRAL.obj POSED.obj OUT_DIR --patch NAME X Y Z [--patch ...]

Bakes displacement, moments and normals of their level 4 (1024²), and displacement of 1024² beside
them, then writes OUT_DIR/NAME.npz for each place on POSED: points (N, N, 3) on the surface without
relief, a texel of 16 384² apart, its unit normals, heights, and slopes. Lengths are those of the
mesh. The surface without relief is smooth: through the vertices by cubic pieces that meet without a
crease, then a Gaussian, because facets of the mesh would be seen in a highlight. Prints the mean
square of slopes that a texel of level 4 has, by the moments and by the normals of the grid.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.ndimage import gaussian_filter, map_coordinates

from rhytid.baking.input_files import mesh_file

Floats = NDArray[np.float64]
RESOLUTION, LEVEL = 16384, 4
# Texels: a side of the patch, from one coarse point to the next, beyond the patch; smoothing.
SIDE, STEP, MARGIN, SMOOTH = 2432, 16, 512, 96.0


def bake(neutral: Path, posed: Path, out: Path) -> None:
    """The maps, by the command as a user would call it; those that are there stay."""
    fine = ["float", "slopes", "roughness", "anisotropy", "normal-gl", "--level", LEVEL]
    for name, resolution, profiles in (("fine", RESOLUTION, fine), ("1k", 1024, ["float"])):
        given = ["--mesh", neutral, "--frames", posed, "--sampling", "smooth", "--name", "f"]
        given += ["--resolution", resolution, "--compression", "none", "--store", out / "store"]
        given += ["--out", out / name, "--profile", *profiles]
        command = [Path(sys.executable).with_name("rhytid"), "bake", *map(str, given)]
        subprocess.run(command, check=True)


def channels(file: Path, corner: tuple[int, int], side: int) -> Floats:
    """(side, side, C) of a file, from a row and a column on, channels by name."""
    window = np.s_[corner[0] : corner[0] + side, corner[1] : corner[1] + side]
    with OpenEXR.File(str(file), separate_channels=True) as found:
        named = found.channels()
        return np.stack([named[c].pixels[window].astype(np.float64) for c in sorted(named)], -1)


def smooth_points(uv: Floats, places: Floats, corner: tuple[int, int]) -> Floats:
    """(SIDE, SIDE, 3) points of the surface without relief at the middles of texels."""
    coarse = np.arange(-MARGIN, SIDE + MARGIN + 1, STEP)
    rows, columns = np.meshgrid(corner[0] + coarse, corner[1] + coarse, indexing="ij")
    at = np.stack([(columns + 0.5) / RESOLUTION, 1.0 - (rows + 0.5) / RESOLUTION], -1)
    near = (np.abs(uv - at.mean(axis=(0, 1))) < (SIDE + 3 * MARGIN) / 2 / RESOLUTION).all(axis=1)
    _, once = np.unique(uv[near], axis=0, return_index=True)
    surface = CloughTocher2DInterpolator(uv[near][once], places[near][once])(at)
    if np.isnan(surface).any():
        raise SystemExit(f"the patch at {places[near].mean(axis=0)} reaches over the mesh's border")
    surface = gaussian_filter(surface, (SMOOTH / STEP, SMOOTH / STEP, 0.0))
    fine = (np.arange(SIDE) + MARGIN) / STEP
    grid = np.meshgrid(fine, fine, indexing="ij")
    return np.stack([map_coordinates(surface[..., i], grid, order=3) for i in range(3)], -1)


def normals(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit vectors (N, N, 3) of a grid: normal, tangent along u, bitangent along v."""
    down, along = np.gradient(points, axis=(0, 1))
    normal = unit(np.cross(along, -down))
    tangent = unit(along - (along * normal).sum(axis=-1, keepdims=True) * normal)
    return normal, tangent, np.cross(normal, tangent)


def unit(vectors: Floats) -> Floats:
    found: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return found


def residual(slopes: Floats) -> Floats:
    """Means (xx, xy, yy) of covariances within texels of the level."""
    cell = 1 << LEVEL
    blocks = slopes.reshape(SIDE // cell, cell, SIDE // cell, cell, 2).swapaxes(1, 2)
    off = blocks - blocks.mean(axis=(2, 3), keepdims=True)
    return np.array([(off[..., i] * off[..., j]).mean() for i, j in ((0, 0), (0, 1), (1, 1))])


def patch(name: str, at: Floats, neutral: Path, posed: Path, out: Path) -> None:
    mesh, places = mesh_file(neutral).mesh, mesh_file(posed).mesh.positions.astype(np.float64)
    nearest = int(np.argmin(((places[mesh.faces].mean(axis=1) - at) ** 2).sum(axis=-1)))
    middle = mesh.uv[mesh.face_uv[nearest]].mean(axis=0) * (1, -1) + (0, 1)
    cells = (middle[::-1] * RESOLUTION - SIDE / 2) // (1 << LEVEL)
    row, column = (int(i) << LEVEL for i in cells)
    corners, first = mesh.face_uv.ravel(), mesh.faces.ravel()
    points = smooth_points(mesh.uv[corners].astype(np.float64), places[first], (row, column))
    heights = channels(out / "fine" / "f.1001.smile.exr", (row, column), SIDE)[..., 0]
    normal, tangent, bitangent = normals(points)
    lifted = normals(points + heights[..., None] * normal)[0]
    part = [(lifted * axis).sum(axis=-1) for axis in (tangent, bitangent, normal)]
    slopes = -np.stack(part[:2], -1) / part[2][..., None]
    low = (row >> LEVEL, column >> LEVEL)
    x, xx, xy, y, yy = np.moveaxis(
        channels(out / "fine" / "f.slopes.1001.smile.exr", low, SIDE >> LEVEL), -1, 0
    )
    told = np.array([(xx - x * x).mean(), (xy - x * y).mean(), (yy - y * y).mean()])
    print(name, "moments", told, "grid", residual(slopes), "all", (slopes**2).mean(axis=(0, 1)))  # noqa: T201
    grid = {"points": points, "normals": normal, "slopes": slopes, "heights": heights}
    small = {key: value.astype(np.float32) for key, value in grid.items()}
    np.savez(out / f"{name}.npz", corner=np.array([row, column]), resolution=RESOLUTION, **small)


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    for name in ("neutral", "posed", "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--patch", nargs=4, action="append", required=True)
    given = parser.parse_args()
    bake(given.neutral, given.posed, given.out)
    for name, *at in given.patch:
        patch(name, np.array(at, float), given.neutral, given.posed, given.out)


if __name__ == "__main__":
    main()
