"""The lines that samples of the cushions answer by, as textures."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import LimitError
from rhytid.exports.skin_package.manifest import Lines
from rhytid.exports.skin_package.texture_arrays import MOST_SIDE, TextureFiles, index_channel
from rhytid.pipeline.elements import LineSources

# Columns of the texture of lines, and of what a frame draws of them.
LINES_A_ROW = MOST_SIDE
# A component of a direction in 16 bits: 1 is as much over the middle.
_MIDDLE, _UNIT = 32768, 32767
# Bytes that the arrays of a line take while its texture is made: sources, numbers and table.
LINE_BYTES = 160


class OwnerCount:
    """How many lines own samples of a UDIM, counted tile by tile as these are read."""

    def __init__(self) -> None:
        self._owns = np.zeros(0, np.bool_)

    def add(self, owners: NDArray[np.integer]) -> None:
        """Count the owners of a tile, rows of the graph. Raises LimitError where there are more
        than a texture holds."""
        lines = int(owners.max(initial=-1)) + 1
        if lines > len(self._owns):
            self._owns = np.pad(self._owns, (0, lines - len(self._owns)))
        self._owns[owners[owners >= 0]] = True
        _check(int(np.count_nonzero(self._owns)))


def _check(lines: int) -> None:
    most = LINES_A_ROW * MOST_SIDE - 1  # the last is none
    if lines > most:
        raise LimitError(f"{lines} lines that swell are more than a texture holds, {most}")


def used_lines(
    owners: NDArray[np.integer], lines: LineSources, triangles: int
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """The owners as numbers of lines, and the table (4, L) of these, as `Lines` of the manifest has
    it.

    owners: rows of the graph, -1 for none.  triangles: of the mesh, which is what none samples. The
    table has the owners, the lines that continue them, and none. Raises LimitError where they do
    not fit into a texture.
    """
    place = np.full(int(lines.rows.max(initial=-1)) + 2, -1, np.int64)  # -1 finds the last
    place[lines.rows] = np.arange(len(lines.rows))
    owner = place[owners]
    own = np.unique(owner[owner >= 0])
    next_to = lines.partners[own]
    used = np.union1d(own, next_to[next_to >= 0])
    _check(len(used))
    number = np.full(len(lines.rows) + 1, len(used), np.int64)
    number[used] = np.arange(len(used))
    return number[owner].astype(np.uint32), _table(lines, used, number, triangles)


def _table(
    lines: LineSources, used: NDArray[np.int64], number: NDArray[np.int64], triangles: int
) -> NDArray[np.uint32]:
    """The table (4, L + 1) of lines `used` (L,), the last of none.  number: of every line, L where
    it is not used."""
    table = np.zeros((4, len(used) + 1), np.uint32)
    table[0] = np.append(lines.triangle[used], triangles)
    u, v = np.rint(lines.directions[used] * _UNIT).astype(np.int64).T + _MIDDLE
    table[1, :-1], table[1, -1] = v << 16 | u, _MIDDLE << 16 | (_MIDDLE + _UNIT)
    partners = lines.partners[used]
    # Of lines that own nothing the next ones are not asked for.
    known = (partners >= 0) & (number[partners] < len(used))
    table[2:, :-1] = np.where(known, number[partners] + 1, 0).T
    return table


@dataclass
class LineFiles:
    """The textures of lines, one for each UDIM."""

    folder: Path
    ends: float
    height: int = 0
    files: TextureFiles = field(init=False)

    def __post_init__(self) -> None:
        self.files = TextureFiles(self.folder, "cushion_lines", "r32uint", 4)

    def write(self, udim: int, table: NDArray[np.uint32]) -> None:
        """Write the table (4, L) of a UDIM."""
        rows = -(-table.shape[1] // LINES_A_ROW)
        whole = np.zeros((4, rows * LINES_A_ROW), np.uint32)
        whole[:, : table.shape[1]] = table
        self.files.write(udim, [whole.reshape(4, rows, LINES_A_ROW)])
        self.height = max(self.height, rows)

    def manifest_entry(self) -> Lines:
        """The textures as the manifest describes them."""
        return Lines(
            files=self.files.files,
            width=LINES_A_ROW,
            height=self.height,
            ends=self.ends,
            bytes=self.files.bytes,
        )


class CushionFiles:
    """The textures of the cushions: maps, owners and lines."""

    def __init__(self, folder: Path, maps: int, triangles: int, ends: float) -> None:
        """maps: of the samples, and of places.  triangles: of the mesh.  ends: `response.ends`."""
        self.maps = TextureFiles(folder, "cushions", "r8snorm", maps)
        self.owners = TextureFiles(folder, "cushion_owners", "r32uint")
        self.lines = LineFiles(folder, ends)
        self._triangles = triangles

    @property
    def textures(self) -> list[TextureFiles]:
        """All of them."""
        return [self.maps, self.owners, self.lines.files]

    def write(
        self,
        udim: int,
        maps: NDArray[np.integer],
        owners: NDArray[np.integer],
        lines: LineSources,
    ) -> None:
        """Write the textures of a UDIM.  maps (K, n, n); owners (1, n, n): rows of the graph."""
        numbers, table = used_lines(owners, lines, self._triangles)
        self.maps.write(udim, [maps])
        self.owners.channel = index_channel(table.shape[1])
        self.owners.write(udim, [numbers])
        self.lines.write(udim, table)
