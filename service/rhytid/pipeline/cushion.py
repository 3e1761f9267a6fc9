"""Draws the broad layer of the wrinkles, coarse. Kernel: cushion.cl; spline.clh brings it up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.pipeline.cushion_elements import APRON, COARSE_BLOCK, LEAST_HALF_WIDTH, WIDENED
from rhytid.pipeline.elements import UdimElements

# Texels a side of what a work-group draws.
_BLOCK = COARSE_BLOCK + 2 * APRON
# Values beyond a coarse map that its buffer has: spline.clh reads a vector at once.
MORE = 8


def coarse_side(side: int, factor: int) -> int:
    """Samples a side of the coarse map of `side` texels, with its apron."""
    return side // factor + 2 * APRON


def draw_cushion(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: Buffer,
    square: tuple[int, int, int],
) -> Buffer:  # fmt: skip
    """The broad layer around a square (row, column, texels per side) of level 0, multiples of
    BLOCK: coarse_side² samples in mesh units and room for a vector.

    scales: (σ_w, σ_d) of wrinkles.
    """
    return launch_cushion(device, "cushion", elements, settings, square, scales)


def launch_cushion(
    device: Device,
    kernel: str,
    elements: UdimElements,
    settings: AssetSettings,
    square: tuple[int, int, int],
    *arguments: Any,
    defines: Mapping[str, object] | None = None,
) -> Buffer:
    """Run a kernel of cushion.cl over the coarse map around a square.  arguments: of its own."""
    cushion = elements.cushion
    assert cushion is not None
    factor, assets = cushion.factor, settings.resolution
    row, column, texels = (at // factor for at in square)
    side = coarse_side(square[2], factor)
    out = device.empty(side * side + MORE, np.float32)
    parts = max(COARSE_BLOCK // device.shape.rows, 1)
    across, down = (
        (at + texels - 1) // COARSE_BLOCK - at // COARSE_BLOCK + 1 for at in (column, row)
    )
    segments, _, *others = elements.line_arguments
    place = (row - APRON, column - APRON, side, assets // (factor * COARSE_BLOCK))
    device.launch(
        "cushion", kernel, (across * device.shape.lanes, down * parts),
        segments, cushion.sizes, *others, *arguments, cushion.lists.offsets,
        cushion.lists.members, _shape_values(settings),
        np.float32(settings.depth), np.array(place, np.int32), out,
        group=(device.shape.lanes, 1),
        defines={
            "BLOCK": _BLOCK, "ROWS": _BLOCK // parts, "ITEMS": device.shape.lanes,
            "APRON": APRON, "COARSE_BLOCK": COARSE_BLOCK, "COARSER": factor,
            "LEAST_HALF_WIDTH": f"{LEAST_HALF_WIDTH}f", "WIDENED": f"{WIDENED}f",
            **elements.line_defines, **(defines or {}),
        },
    )  # fmt: skip
    return out


def _shape_values(settings: AssetSettings) -> NDArray[np.float32]:
    """No bulge, a sharpness of its own, one slot: a lone line keeps its depth."""
    return np.array([0.0, 0.0, settings.shape.cushion_sharpness, 1.0], np.float32)
