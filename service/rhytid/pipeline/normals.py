"""Normal maps of heights that are drawn. Kernel: normals.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device


def normal_codes(
    device: Device,
    heights: NDArray[np.float32],
    triangles: NDArray[np.int32],
    codes: NDArray[np.uint8],
    records: NDArray[np.float32],
    rows: slice,
    green: int,
) -> NDArray[np.uint16]:
    """(n, R, 3) codes of (normal + 1) / 2 in some rows; of (0, 0, 1) where no triangle is under the
    centre of a texel.

    heights: (R, R) of level 0, mesh units, row 0 at the top.  triangles, codes: (R, R) of its
    texels, codes as `neighbour_codes` has them.  records: of triangles, as
    `NormalChart.records` has them.  green: 1 for along v, -1 against it. In a task of the device.
    """
    side, start, stop = len(heights), rows.start, rows.stop
    first = max(start - 1, 0)
    lent = [
        device.lend(heights[first : min(stop + 1, side)]),
        device.lend(triangles[rows]),
        device.lend(codes[rows]),
        device.lend(records),
    ]
    out = device.readable(3 * (stop - start) * side, np.uint16)
    device.launch(
        "normals", "normal_codes", (side, stop - start), *lent,
        np.int32(records.shape[1]), np.int32(start), np.int32(start - first), np.float32(green),
        out,
    )  # fmt: skip
    found: NDArray[np.uint16] = device.read(out, (stop - start, side, 3), np.uint16)
    for buffer in (*lent, out):
        buffer.release()
    return found
