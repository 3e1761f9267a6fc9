"""Which triangle holds a texel or a point in UV. Kernels: locate.cl, locate_texels.cl.

Texture coordinates never move, so this is done once per asset, never per frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.device.runtime import Device
from rhytid.domain.mesh import Mesh, has_area
from rhytid.domain.tiles import udim_origin, udims_at
from rhytid.pipeline.cells import cells_that_fit, list_by_cell
from rhytid.pipeline.vectors import VECTOR

_MOST_CELLS = 256
_TEXELS_A_CELL = 16
# Rows that a work-item of locate_texels.cl looks up, HIGH there.
_ROWS = 8
# Points that one launch looks up: others get the device between two.
_MOST_POINTS = 1 << 17


class UdimTriangles:
    """The triangles of one UDIM on the device, listed by cell for look-up.

    A triangle without area in UV, or with none left in float32, holds nothing. A point outside all
    triangles takes the nearest one within `padding` level-0 texels, else the index `none`, which is
    the number of triangles.
    """

    def __init__(
        self, device: Device, mesh: Mesh, udim: int, resolution: int, padding: int
    ) -> None:
        reach = padding / resolution
        corners = mesh.triangle_uv() - np.array(udim_origin(udim), np.float64)
        rounded = corners.astype(np.float32)
        flat = ~(mesh.triangles_with_uv() & has_area(rounded.astype(np.float64)))[:, None]
        low = np.where(flat, np.inf, corners.min(axis=1))  # in no cell
        high = np.where(flat, -np.inf, corners.max(axis=1))
        margin = reach + 1e-6  # beyond the rounding of float32 coordinates
        cells = int(np.clip(resolution // _TEXELS_A_CELL, 1, _MOST_CELLS))
        cells = cells_that_fit(low - margin, high + margin, cells)
        lists = list_by_cell(low - margin, high + margin, cells, top_down=False)
        self._device, self.udim = device, udim
        self.none = np.int32(len(mesh.faces))
        self._cells = np.int32(cells)
        self._reach2 = np.float32(reach * reach)
        self._buffers = (
            device.upload(rounded),
            device.upload(lists.offsets),
            device.upload(lists.members),
        )

    @property
    def corners(self) -> Buffer:
        """float32 UV of three corners per triangle, local to the UDIM."""
        return self._buffers[0]

    def texels(self, side: int, row: int, column: int, count: int) -> Buffer:
        """int32 triangle of each of count² texels of a level of `side` texels, on the device."""
        if count * count < VECTOR:
            # Room for a whole vector, so that the smallest levels can be blended like the others.
            found = self._device.full(VECTOR, self.none)
        else:
            found = self._device.empty(count * count, np.int32)
        self._device.launch(
            "locate_texels", "locate_texels", (-(-count // VECTOR), -(-count // _ROWS)),
            *self._arguments(),
            np.int32(side), np.int32(row), np.int32(column), np.int32(count), found,
        )  # fmt: skip
        return found

    def points(self, local: NDArray[np.float32]) -> NDArray[np.int32]:
        """(P,) int32 triangle of each point (P, 2), in UV local to the UDIM."""
        parts = [local[i : i + _MOST_POINTS] for i in range(0, len(local), _MOST_POINTS)]
        found = [self._points(part) for part in parts]
        return np.concatenate(found) if found else np.empty(0, np.int32)

    def _points(self, local: NDArray[np.float32]) -> NDArray[np.int32]:
        points = self._device.upload(local)
        found = self._device.empty(len(local), np.int32)
        self._device.launch(
            "locate", "locate_points", (len(local),), *self._arguments(), points, found
        )
        result: NDArray[np.int32] = self._device.read(found, (len(local),), np.int32)
        points.release()
        found.release()
        return result

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self._buffers:
            buffer.release()

    def _arguments(self) -> tuple[object, ...]:
        return (*self._buffers, self._cells, self._reach2, self.none)


def locate_points(
    device: Device, mesh: Mesh, uv: NDArray[np.float32], resolution: int, padding: int
) -> NDArray[np.int32]:
    """(P,) int32 triangle of each point, UDIM offset included; the number of triangles = none."""
    found = np.full(len(uv), len(mesh.faces), np.int32)
    corner = np.floor(uv).astype(np.int64)
    inside = (corner[:, 0] >= 0) & (corner[:, 0] < 10) & (corner[:, 1] >= 0)
    udims = np.where(inside, udims_at(uv), 0)
    for udim in np.unique(udims[inside]):
        members = np.flatnonzero(udims == udim)
        local = uv[members] - np.array(udim_origin(int(udim)), np.float32)
        triangles = UdimTriangles(device, mesh, int(udim), resolution, padding)
        found[members] = triangles.points(local)
        triangles.release()
    return found
