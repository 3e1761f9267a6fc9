"""How drawing is cut into work-groups. It changes no bit of a result, only the time."""

from __future__ import annotations

from dataclasses import dataclass

from rhytid.errors import DeviceError

# Rows of a block of 64² texels that a work-group may draw. Their sums take 2 · 72 floats per row,
# of three rows more than are drawn.
_ROWS, _MORE_ROWS = (64, 32, 16), 3
_ROW_BYTES = 2 * 72 * 4
# On a processor a work-group is a loop on one core: long ones cost less, until at the end of a tile
# one core waits for another.
_VECTORS_CPU, _VECTORS = 1024, 64
# Local memory that a driver uses itself, beside the sums.
_LEFT = 4 << 10


@dataclass(frozen=True)
class LaunchShape:
    """Work-groups draw `rows` rows of a block with `lanes` work-items, and blend up to `vectors`
    vectors of texels, a work-item each."""

    rows: int
    lanes: int
    vectors: int


def launch_shapes(kind: str, local_memory: int, largest_group: int) -> list[LaunchShape]:
    """Shapes that fit into the local memory and the work-groups of a device, the usual one first:
    as many rows as fit, one work-item on a CPU, where that is a vector loop, else one per row.

    Raises DeviceError where none fits: OpenCL promises 32 KiB of local memory.
    """
    fitting = [rows for rows in _ROWS if _bytes(rows) <= local_memory]
    if not fitting:
        least = _bytes(_ROWS[-1])
        raise DeviceError(f"{local_memory} bytes of local memory: drawing needs {least}")
    most = 1 << (largest_group.bit_length() - 1)
    if kind == "cpu":
        return [LaunchShape(rows, 1, min(_VECTORS_CPU, most)) for rows in fitting]
    vectors = min(_VECTORS, most)
    shapes = [
        LaunchShape(rows, min(rows // share, most), vectors) for share in (1, 2) for rows in fitting
    ]
    return list(dict.fromkeys(shapes))


def _bytes(rows: int) -> int:
    """Local memory of a work-group that draws so many rows."""
    return (rows + _MORE_ROWS) * _ROW_BYTES + _LEFT
