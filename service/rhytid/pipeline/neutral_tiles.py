"""What `convolved` reads that no frame changes: a tile of the neutral map with its surroundings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.buffer_group import BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.levels import Draw
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.stiffness import stiffness_of_texels
from rhytid.pipeline.vectors import VECTOR
from rhytid.pipeline.work import BLOCK

# Taps on either side of a texel, at most: 3 sigma, so that sigma is 21 texels at most.
MOST_TAPS = 63


@dataclass(frozen=True)
class NeutralTile(BufferGroup):
    """What convolving `side`² texels from (row, column) on needs and no frame changes.

    heights: (side + 4 apron)² float32, the neutral map around the tile; beyond the border of the
    map the texel at the border.  triangles: (side + 2 apron)² int32, which holds each texel.
    stiffness: float32 of the same texels, or None: 1 throughout.
    """

    row: int
    column: int
    side: int
    apron: int
    heights: Buffer
    triangles: Buffer
    stiffness: Buffer | None = None

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return (self.heights, self.triangles, self.stiffness)


class NeutralTiles:
    """Makes them for a mesh.

    slowest: (F,) float64, the least |J ŝ| that a texel in each triangle can have, whatever the
    frame; infinite where none is convolved.
    """

    def __init__(
        self, device: Device, mesh: Mesh, slowest: NDArray[np.float64], stiffness: Stiffness | None
    ) -> None:
        self._device, self._stiffness = device, stiffness
        self._slowest = slowest
        self._uv = mesh.triangle_uv()

    def neutral_tile(
        self, draw: Draw, located: UdimTriangles, settings: AssetSettings,
        udim: int, row: int, column: int, side: int,
    ) -> NeutralTile:  # fmt: skip
        """What can be made ahead of a tile of level 0; `draw` draws the neutral map."""
        apron = self.apron(settings, udim, row, column, side)
        resolution = settings.resolution
        heights = _extended(
            self._device, draw, resolution, row - 2 * apron, column - 2 * apron, side + 4 * apron
        )
        triangles = located.texels(resolution, row - apron, column - apron, side + 2 * apron)
        stiffness = stiffness_of_texels(
            self._device, self._stiffness, udim, resolution, row - apron, column - apron,
            side + 2 * apron,
        )  # fmt: skip
        return NeutralTile(row, column, side, apron, heights, triangles, stiffness)

    def apron(self, settings: AssetSettings, udim: int, row: int, column: int, side: int) -> int:
        """How far one pass over a tile can read at most, whatever the frame; a multiple of VECTOR.

        The bits of a tile do not depend on it, only its cost.
        """
        resolution = settings.resolution
        margin = (MOST_TAPS + 1 + settings.padding + 1) / resolution
        low = np.array([column, resolution - row - side]) / resolution - margin
        high = low + side / resolution + 2 * margin
        corners = self._uv - udim_origin(udim)
        touches = (corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)
        slowest = self._slowest[touches.all(axis=1)].min(initial=np.inf)
        # One more for rounding, one for the texel that bilinear reads beside the last tap.
        taps = min(3.0 * reach(settings) / slowest + 1.0, MOST_TAPS) + 1.0
        return VECTOR * int(np.ceil(taps / VECTOR))


def reach(settings: AssetSettings) -> float:
    """σ in mesh units times texels per side: over |J ŝ| it is σ in texels."""
    assert settings.convolve.sigma is not None
    return settings.convolve.sigma * settings.resolution


def _extended(
    device: Device, draw: Draw, resolution: int, row: int, column: int, side: int
) -> Buffer:
    """`side`² texels from (row, column) on, which may lie beyond the border of the map."""
    blocks = max(-(-(at % BLOCK + side) // BLOCK) for at in (row, column))
    inside = min(blocks * BLOCK, resolution)
    corner = [int(np.clip(at // BLOCK * BLOCK, 0, resolution - inside)) for at in (column, row)]
    part = draw(corner[1], corner[0], inside)
    out = device.empty(side * side, np.float32)
    device.launch(
        "convolve", "extend", (side, side),
        part, np.array(corner, np.int32), np.int32(inside), np.int32(resolution),
        np.int32(row), np.int32(column), out,
    )  # fmt: skip
    part.release()
    return out
