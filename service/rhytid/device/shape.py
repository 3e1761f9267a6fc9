"""How drawing is cut into work-groups. It changes no bit of a result, only the time."""

from __future__ import annotations

from dataclasses import dataclass

# Rows of a block of 64² texels that a work-group may draw. Their sums take 2 · 72 floats a row.
_ROWS = (64, 32, 16)
_ROW_BYTES = 2 * 72 * 4
# On a processor a work-group is a loop on one core: long ones cost less, until at the end of a tile
# one core waits for another.
_VECTORS_CPU, _VECTORS = 1024, 64
# Beside the sums, for what a driver keeps in local memory itself.
_LEFT = 4 << 10


@dataclass(frozen=True)
class LaunchShape:
    """Work-groups draw `rows` rows of a block with `lanes` work-items, and blend up to `vectors`
    vectors of texels, a work-item each."""

    rows: int
    lanes: int
    vectors: int


def launch_shapes(kind: str, local_memory: int) -> list[LaunchShape]:
    """Shapes that fit into the local memory of a device, the usual one first: as many rows as fit,
    one work-item on a CPU, where that is a vector loop, else one a row."""
    fitting = [rows for rows in _ROWS if rows * _ROW_BYTES + _LEFT <= local_memory]
    if kind == "cpu":
        return [LaunchShape(rows, 1, _VECTORS_CPU) for rows in fitting]
    a_row_each = [LaunchShape(rows, rows, _VECTORS) for rows in fitting]
    return a_row_each + [LaunchShape(rows, rows // 2, _VECTORS) for rows in fitting]
