"""The texture arrays of a package as files that every WebGL2 takes.

Maps that are larger than a texture may be are cut into pages. The codes of all samples of a bin are
stored as the number of their set, texel by texel: far fewer sets occur than there could be, so that
a texel takes two bytes for all samples. Both are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.errors import LimitError
from rhytid.exports.skin_package.manifest import Codes, Textures
from rhytid.formats.ktx2 import CHANNELS, ktx2_pieces
from rhytid.support import cancellation
from rhytid.support.atomic_files import atomic_write, write_pieces

SetCodes = NDArray[np.int8]
Pairs = NDArray[np.uint32]
Maps = NDArray[np.integer]
_FORMATS = {"r8snorm": "R8_SNORM", "r16uint": "R16_UINT", "r32uint": "R32_UINT"}
# The limits of the smallest WebGL2: texels per side, and layers of an array.
MOST_SIDE, MOST_LAYERS = 2048, 256
# Columns of the array of the sets, and rows that every WebGL2 takes.
A_ROW, MOST_ROWS = 1024, 2048
# Values that a table has at once, and texels that are taken at once.
TABLE, STRIP = 1 << 23, 1 << 18
# Bytes that `in_sets` takes beside its numbers, at most: tables, strips, and the sets.
BESIDE = 5 * TABLE + 32 * STRIP + 32 * A_ROW * MOST_ROWS


def index_channel(most: int) -> str:
    """The narrowest channel that holds indices up to `most`."""
    return "r16uint" if most < 1 << 16 else "r32uint"


@dataclass
class TextureFiles:
    """Texture arrays of one kind, one for each UDIM, written to `folder`/`name`.<UDIM>.ktx2."""

    folder: Path
    name: str
    channel: str
    maps: int = 1
    pages_a_row: int = 1
    files: dict[str, str] = field(default_factory=dict)
    shape: tuple[int, ...] = ()
    levels: int = 0
    formats: set[str] = field(default_factory=set)
    bytes: int = 0
    finest: int = 0

    def write(self, udim: int, levels: Sequence[NDArray[np.generic]]) -> None:
        """Write the array of a UDIM, finest level first; the file is visible once it is whole."""
        layers, rows, columns = self.shape = levels[0].shape
        file = self.folder / f"{self.name}.{udim}.ktx2"
        with atomic_write(file) as aside:
            pieces = ktx2_pieces(self.channel, (layers, rows, columns), levels)
            write_pieces(aside, cancellation.check_each(pieces))
        item = CHANNELS[self.channel].dtype.itemsize
        self.files[str(udim)] = f"{self.folder.name}/{file.name}"
        self.levels = len(levels)
        self.formats.add(_FORMATS[self.channel])
        self.finest += levels[0].size * item
        self.bytes += sum(level.size for level in levels) * item

    def manifest_entry(self) -> Textures:
        """The textures as the manifest describes them, once all are written."""
        layers, size, _ = self.shape
        return Textures(
            files=self.files,
            format=max(self.formats, key=[*_FORMATS.values()].index),
            size=size,
            maps=self.maps,
            pages=layers // self.maps,
            pages_a_row=self.pages_a_row,
            levels=self.levels,
            bytes=self.bytes,
            bytes_of_level_0=self.finest,
        )


@dataclass
class SetFiles:
    """The maps of bins, stored as sets of the codes of their samples, for each UDIM.

    They are `name`.<UDIM>.ktx2, the number of the set at every texel, and `name`_codes.<UDIM>.ktx2,
    the codes of each set.
    """

    folder: Path
    name: str
    bins: int
    samples: int
    pages_a_row: int = 1

    def __post_init__(self) -> None:
        self._numbers = TextureFiles(self.folder, self.name, "r16uint", self.bins, self.pages_a_row)
        self._codes = TextureFiles(self.folder, f"{self.name}_codes", "r8snorm", self.samples)

    @property
    def files(self) -> list[str]:
        """All files that were written."""
        return [*self._numbers.files.values(), *self._codes.files.values()]

    def write(self, udim: int, levels: Sequence[NDArray[np.integer]]) -> None:
        """Write the arrays of a UDIM, from maps of every level, finest first."""
        numbers, codes = in_sets(levels, self.samples)
        self._numbers.channel = index_channel(codes[0].size)
        self._numbers.write(udim, numbers)
        self._codes.write(udim, [codes])

    def manifest_entry(self) -> tuple[Textures, Codes]:
        """The textures and their codes as the manifest describes them."""
        codes = Codes(files=self._codes.files, width=A_ROW, bytes=self._codes.bytes)
        return self._numbers.manifest_entry(), codes


@dataclass(frozen=True)
class Paging:
    """How maps of `resolution` texels a side are cut into pages of `size` texels a side."""

    resolution: int
    size: int

    @classmethod
    def of(cls, resolution: int, maps: int) -> Paging:
        """The paging of so many maps; raises LimitError where they need more layers than WebGL2
        has."""
        paging = cls(resolution, min(resolution, MOST_SIDE))
        layers = paging.count * maps
        if layers > MOST_LAYERS:
            raise LimitError(
                f"{maps} maps of {resolution} texels a side are {layers} layers of {paging.size}; "
                f"WebGL2 has {MOST_LAYERS}: a lower resolution, or fewer bins or samples, fit"
            )
        return paging

    @property
    def across(self) -> int:
        """How many pages lie in a row."""
        return self.resolution // self.size

    @property
    def count(self) -> int:
        """How many pages a map has."""
        return self.across**2

    def cut(self, maps: Maps) -> Maps:
        """(pages * K, size, size) from maps (K, R, R): page by page, row by row."""
        n, size = self.across, self.size
        cut = maps.reshape(len(maps), n, size, n, size).transpose(1, 3, 0, 2, 4)
        pages: Maps = cut.reshape(-1, size, size)
        return pages


def pyramid(maps: Maps, count: int) -> list[Maps]:
    """The maps (K, n, n) and `count` - 1 coarser levels of them.

    Each level has the means of 2 x 2 texels of the level before, taken before that was rounded.
    """
    k, side = maps.shape[:2]
    levels = [maps, *(np.empty((k, side >> n, side >> n), maps.dtype) for n in range(1, count))]
    for i, finest in enumerate(cancellation.check_each(maps)):
        means = finest.astype(np.float32)
        for level in levels[1:]:
            half = len(means) // 2
            means = means.reshape(half, 2, half, 2).mean(axis=(1, 3))
            level[i] = np.rint(means)
    return levels


def in_sets(
    levels: Sequence[NDArray[np.integer]], samples: int
) -> tuple[list[NDArray[np.uint32]], SetCodes]:
    """The codes of all samples of a bin, at every texel, as the number of their set.

    levels: maps (N·S, n, n) int8 of every level, for each bin those of its S samples. Gives the
    numbers of sets, (N, n, n) of every level, and the codes of the sets, (S, rows, 1024): set i at
    row i // 1024, column i % 1024.

    Takes four bytes a texel of a bin for the numbers, and at most BESIDE. Raises LimitError where
    there are more sets than WebGL2 has texels for.
    """
    bins = [level.reshape(-1, samples, *level.shape[1:]).view(np.uint8) for level in levels]
    numbers = [maps[:, 0].astype(np.uint32) for maps in bins]
    sets = np.arange(256, dtype=np.uint8)[None]
    for sample in range(1, samples):
        # In place: the number of the set of the samples before and this code, as one value.
        for number, code in zip(_strips(numbers), _strips(m[:, sample] for m in bins), strict=True):
            number <<= 8
            number |= code
        found = _found(numbers, sets.shape[1] << 8)
        place = _places(found, sets.shape[1] << 8)
        for number in _strips(numbers):
            number[...] = place(number)
        sets = np.concatenate([sets[:, found >> 8], (found & 255).astype(np.uint8)[None]])
    rows = -(-sets.shape[1] // A_ROW)
    codes = np.zeros((samples, rows * A_ROW), np.int8)
    codes[:, : sets.shape[1]] = sets.view(np.int8)
    return numbers, codes.reshape(samples, rows, A_ROW)


def _strips(levels: Iterable[NDArray[np.unsignedinteger]]) -> Iterator[NDArray[np.unsignedinteger]]:
    """Views of (N, n, n) of every level, STRIP texels at a time."""
    for level in levels:
        for one in level:
            flat = one.reshape(-1)
            for at in range(0, flat.size, STRIP):
                cancellation.check()
                yield flat[at : at + STRIP]


def _found(numbers: list[Pairs], end: int) -> Pairs:
    """The values below `end` that occur, in order; raises LimitError where they are too many."""
    found, count = [], 0
    for first in range(0, end, TABLE):
        there = np.zeros(min(TABLE, end - first), bool)
        for values in _strips(numbers):
            # Values below `first` wrap round to numbers beyond every table.
            within = values - np.uint32(first)
            there[within if end <= TABLE else within[within < len(there)]] = True
        found.append((np.flatnonzero(there) + first).astype(np.uint32))
        count += len(found[-1])
        if count > A_ROW * MOST_ROWS:
            raise LimitError(
                f"at least {count} sets of codes are more than a texture holds, "
                f"{A_ROW * MOST_ROWS}: a lower resolution has fewer"
            )
    return np.concatenate(found)


def _places(found: Pairs, end: int) -> Callable[[Pairs], NDArray[np.integer]]:
    """A function that gives the index of values in `found`, by a table where that is small."""
    if end > TABLE:
        return lambda values: np.searchsorted(found, values)
    table = np.zeros(end, np.uint32)
    table[found] = np.arange(len(found), dtype=np.uint32)
    return lambda values: table[values]
