"""Figure 4 of the paper: the precomputed maps of each bin, compressed, neutral and stretched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rhytid.domain.tiles import TileAddress
from rhytid.pictures.flat_patches import FlatPatch
from rhytid.pictures.images import Picture, signed_grey, to_picture
from rhytid.pictures.relief import relief, surface_crop
from rhytid.pictures.sheet import Panel, sheet
from rhytid.pipeline.bins import quantisation_steps, sample_stretches
from rhytid_lab.bench.face_figures import Scene
from rhytid_lab.bench.skin import Skin

_SIZE = 190
_ROWS = ("compression", "neutral", "stretch")


def figure_4(scene: Scene) -> Image.Image:
    """Columns: the orientation bins and the pores; each cell is displacement and relief."""
    skin, patch = scene.skin, scene.patches[0]
    side = 0.75 * scene.side
    address, local = _within_tile(skin, patch, side)
    bins = skin.settings.bins
    middle, last = bins.samples // 2, bins.samples - 1
    rows = []
    for name, sample in zip(_ROWS, (0, middle, last), strict=True):
        crops = [
            _crop(skin, address, local, layer, sample, side) for layer in range(bins.count + 1)
        ]
        rows.append(
            [_cell(_title(skin, name, i, sample), crop, skin, side) for i, crop in enumerate(crops)]
        )
    caption = (
        f"The precomputed maps of the fast method (N = {bins.count}, M = {bins.samples}, "
        f"{bins.bits} bits) on one patch of the undeformed skin: displacement left, relief right. "
        "Each bin holds the wrinkles nearest to its direction; pores are a layer of their own. "
        f"Rows are drawn at log stretch {-bins.r_max:.2f}, 0 and {bins.r_max:.2f}."
    )
    return sheet(rows, caption)


def _title(skin: Skin, row: str, layer: int, sample: int) -> str:
    count = skin.settings.bins.count
    bin = "pores" if layer == count else f"bin {layer}, {_direction(layer, count)}"
    r = sample_stretches(skin.settings)[sample]
    return f"{bin}: {row} ({np.exp(r):.2f})"


def _direction(layer: int, count: int) -> str:
    """The direction of a bin, (sin αₙ, cos αₙ): the first one is up in UV."""
    names = {0.0: "N-S", 0.25: "NE-SW", 0.5: "E-W", 0.75: "NW-SE"}
    share = layer / count
    return names.get(share, f"{180 * share:g} deg from N")


def _within_tile(skin: Skin, patch: FlatPatch, side: float) -> tuple[TileAddress, FlatPatch]:
    """The tile of a patch, and the patch in the tile's own coordinates, moved so that it fits."""
    grid = skin.settings.grid
    count = grid.count(0)
    down = np.array([patch.uv[0], 1 - patch.uv[1]]) * count
    column, row = np.clip(np.floor(down).astype(int), 0, count - 1)
    to_uv = patch.to_uv * count
    reach = 0.75 * side * float(np.linalg.norm(to_uv, 2))
    within = np.clip(down - (column, row), min(reach, 0.5), max(1 - reach, 0.5))
    local = replace(patch, uv=np.array([within[0], 1 - within[1]]), to_uv=to_uv)
    return TileAddress(skin.udim, 0, int(row), int(column)), local


def _crop(
    skin: Skin, address: TileAddress, patch: FlatPatch, layer: int, sample: int, side: float
) -> NDArray[np.float64]:
    step = quantisation_steps(skin.settings)[layer, sample]
    codes = skin.bin_map(address, layer * skin.settings.bins.samples + sample)
    return surface_crop(codes * step, patch, side, _SIZE, deformed=False)


def _cell(title: str, heights: NDArray[np.float64], skin: Skin, side: float) -> Panel:
    depth = skin.settings.depth or 1.0
    grey: Picture = to_picture(signed_grey(heights, 1.5 * depth))
    return Panel(title, np.concatenate([grey, relief(heights, side / _SIZE)], axis=1))
