"""How work is cut into launches: the shape of work-groups that draw, work-groups of other launches,
and how much work a launch has, so that none occupies the device for long. No result depends on it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rhytid.errors import DeviceError

# Rows of a block of 64² texels that a work-group may draw. Sums take most where the block is of
# cushions, with 4 texels of others: 2 · 76 floats per row, of three rows more than are drawn.
_ROWS, _MORE_ROWS, _MORE_COLUMNS = (64, 32, 16), 3, 8
_BLOCK, _OTHERS = 64, 4
_ROW_BYTES = 2 * 76 * 4
# On a processor a work-group is a loop on one core: long ones cost less, until at the end of a tile
# one core waits for another.
_VECTORS_CPU, _VECTORS = 1024, 64
# Local memory that a driver uses itself, beside the sums.
_LEFT = 4 << 10
# Work-items per group, at most. A multiple of every vector width and of the warps of GPUs.
MOST_GROUP = 64


@dataclass(frozen=True)
class LaunchShape:
    """How drawing is cut into work-groups: a group draws `rows` rows of a block with `lanes`
    work-items, and blends up to `vectors` vectors of texels, one work-item each."""

    rows: int
    lanes: int
    vectors: int


def launch_shapes(kind: str, local_memory: int, largest_group: int) -> list[LaunchShape]:
    """Shapes that fit into the local memory and the work-groups of a device, the usual one first:
    as many rows as fit; one work-item on a CPU, where it is a vector loop, else one per row.

    Raises DeviceError where none fits: OpenCL promises 32 KiB of local memory.
    """
    fitting = [rows for rows in _ROWS if _local_bytes(rows) <= local_memory]
    if not fitting:
        least = _local_bytes(_ROWS[-1])
        raise DeviceError(f"{local_memory} bytes of local memory: drawing needs {least}")
    most = 1 << (largest_group.bit_length() - 1)
    if kind == "cpu":
        return [LaunchShape(rows, 1, min(_VECTORS_CPU, most)) for rows in fitting]
    vectors = min(_VECTORS, most)
    shapes = [
        LaunchShape(rows, min(rows // share, most), vectors) for share in (1, 2) for rows in fitting
    ]
    return list(dict.fromkeys(shapes))


def sums_of_map(block: int, rows: int) -> int:
    """Floats of the sums of one map that a work-group has, SUMS of block.clh, where it draws so
    many rows of blocks of `block`² texels."""
    return (rows + _MORE_ROWS) * (block + _MORE_COLUMNS)


def maps_at_once(shape: LaunchShape, local_memory: int, sums: int) -> int:
    """How many maps with so many floats of sums each a work-group draws at once: as many as it has
    memory for; one where its work-items share the rows, as on a GPU."""
    return max((local_memory - _LEFT) // (4 * sums), 1) if shape.lanes == 1 else 1


def _local_bytes(rows: int) -> int:
    """Local memory of a work-group that draws this many rows."""
    return (rows + rows * _OTHERS // _BLOCK + _MORE_ROWS) * _ROW_BYTES + _LEFT


@dataclass(frozen=True)
class LaunchPiece:
    """A part of a launch: its first work-item, the number of its work-items, and of those of a
    work-group."""

    offset: tuple[int, ...] | None
    size: tuple[int, ...]
    group: tuple[int, ...]


def launch_pieces(size: tuple[int, ...], largest_group: int) -> list[LaunchPiece]:
    """The pieces of a launch over `size` work-items that asks for no work-groups of its own. No
    result depends on them.

    Left to a driver, the size of a work-group follows from the size of the launch. PoCL compiles a
    kernel anew for each such size (0.2 to 0.9 s), so each new number of triangles would be
    compiled; where a prime number is launched it has one work-item per group, on GPUs too.

    One dimension: groups of 64, and what is left in groups of one.
    More dimensions: groups along the first, the largest power of two that divides it, so that
    get_global_size is that of the whole launch.
    """
    most = 1 << (min(MOST_GROUP, largest_group).bit_length() - 1)
    if len(size) > 1:
        first = min(size[0] & -size[0], most)
        return [LaunchPiece(None, size, (first, *[1] * (len(size) - 1)))]
    whole = size[0] // most * most
    pieces = [LaunchPiece(None, (whole,), (most,))] if whole else []
    if rest := size[0] - whole:
        pieces.append(LaunchPiece((whole,) if whole else None, (rest,), (1,)))
    return pieces


def whole_groups(items: int) -> int:
    """So many work-items, or up to 63 more: of a kernel in which those beyond its elements do
    nothing. So it is launched, and compiled by PoCL, for groups of 64 alone."""
    return -(-items // MOST_GROUP) * MOST_GROUP


# Work-items of a launch: the most, the least, and of a kernel that nobody has measured yet.
MOST_ITEMS, LEAST_ITEMS, FIRST_ITEMS = 1 << 18, 1 << 10, 1 << 12
# Seconds that a launch should take. Its items may be several times as much work as those before.
LAUNCH_SECONDS = 0.025
# From one launch to the next no more times as many: the first is slow while its kernel is compiled.
_GROWTH = 8


class LaunchPacing:
    """Finds how many work-items of each kernel take about LAUNCH_SECONDS, by the time of its last
    launch."""

    def __init__(self) -> None:
        self._items: dict[tuple[str, str], int] = {}

    def items(self, program: str, kernel: str) -> int:
        """How many work-items the next launch of a kernel should have: a power of two."""
        return self._items.get((program, kernel), FIRST_ITEMS)

    def took(self, program: str, kernel: str, items: int, seconds: float) -> None:
        """Count a launch of `items` work-items that took `seconds`."""
        planned = self.items(program, kernel)
        if items < planned and seconds < LAUNCH_SECONDS:
            return  # the end of a run: too few work-items to predict the time of more
        wanted = int(items * LAUNCH_SECONDS / max(seconds, 1e-6))
        most = min(MOST_ITEMS, planned * _GROWTH)
        size = 1 << max(min(wanted, most).bit_length() - 1, 0)
        self._items[program, kernel] = max(size, LEAST_ITEMS)


# Seconds that one launch, or one piece, of drawing should take.
PIECE_SECONDS = 0.05
# Work a second (see pipeline/work.py) that is assumed until it was measured: that of a processor
# with two cores which is busy with other things, too.
FIRST_WORK = 5e8
# A pace is lowered where a piece takes so many times as long as it should, raised where the pace is
# so many times as high, and else left, so that pieces stay the same from one frame to the next.
_OFF = 2.0
# By no more than this at once: a kernel may be compiled first, or the machine have been busy.
_STEP = 4.0


class DrawingPace:
    """Work of drawing a second, by how long pieces took."""

    def __init__(self, per_second: float) -> None:
        self.per_second = per_second

    @property
    def most(self) -> float:
        """The work that takes about PIECE_SECONDS."""
        return PIECE_SECONDS * self.per_second

    @contextmanager
    def timing(self, work: float) -> Iterator[None]:
        """Counts the work of the block, which waits until it is done."""
        start = time.perf_counter()
        yield
        self.took(work, time.perf_counter() - start)

    def took(self, work: float, seconds: float) -> None:
        """Count a piece of so much work that took `seconds`."""
        found = work / max(seconds, 1e-6)
        if seconds > _OFF * PIECE_SECONDS and found < self.per_second:
            self.per_second = max(found, self.per_second / _STEP)
        elif found > _OFF * self.per_second:
            self.per_second *= _OFF
