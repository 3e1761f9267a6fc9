"""How drawing is cut into work-groups. It changes no bit of a result, only the time."""

from __future__ import annotations

from dataclasses import dataclass

# Rows of a block of 64² texels that a work-group may draw. Their sums take 2 · 72 floats a row.
_ROWS = (64, 32, 16)
_ROW_BYTES = 2 * 72 * 4
# Beside the sums, for what a driver keeps in local memory itself.
_LEFT = 4 << 10


@dataclass(frozen=True)
class LaunchShape:
    """Work-groups draw `rows` rows of a block with `lanes` work-items."""

    rows: int
    lanes: int


def launch_shapes(kind: str, local_memory: int) -> list[LaunchShape]:
    """Shapes that fit into the local memory of a device, the usual one first: as many rows as fit,
    one work-item on a CPU, where that is a vector loop, else one a row."""
    fitting = [rows for rows in _ROWS if rows * _ROW_BYTES + _LEFT <= local_memory]
    if kind == "cpu":
        return [LaunchShape(rows, 1) for rows in fitting]
    a_row_each = [LaunchShape(rows, rows) for rows in fitting]
    return a_row_each + [LaunchShape(rows, rows // 2) for rows in fitting]
