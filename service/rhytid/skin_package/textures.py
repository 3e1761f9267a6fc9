"""The texture arrays of a package, as files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rhytid.formats.ktx2 import CHANNELS, ktx2_pieces
from rhytid.skin_package.manifest import Codes, Textures
from rhytid.skin_package.sets import A_ROW, in_sets
from rhytid.support import cancellation
from rhytid.support.atomic_files import atomic_write, write_pieces

_FORMATS = {"r8snorm": "R8_SNORM", "r16uint": "R16_UINT", "r32uint": "R32_UINT"}


def index_channel(most: int) -> str:
    """The narrowest that holds indices up to `most`."""
    return "r16uint" if most < 1 << 16 else "r32uint"


@dataclass
class TextureFiles:
    """Arrays of one kind, one of every UDIM, written to `folder`/`name`.<UDIM>.ktx2."""

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
        """The array of a UDIM, finest level first; the file is there when it is whole."""
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

    def described(self) -> Textures:
        """As the manifest has it, once all are written."""
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
    """Maps of bins as sets of the codes of their samples, of every UDIM: `name`.<UDIM>.ktx2 and
    `name`_codes.<UDIM>.ktx2."""

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
        """All that were written."""
        return [*self._numbers.files.values(), *self._codes.files.values()]

    def write(self, udim: int, levels: Sequence[NDArray[np.integer]]) -> None:
        """The arrays of a UDIM, from maps of every level, finest first."""
        numbers, codes = in_sets(levels, self.samples)
        self._numbers.channel = index_channel(codes[0].size)
        self._numbers.write(udim, numbers)
        self._codes.write(udim, [codes])

    def described(self) -> tuple[Textures, Codes]:
        """As the manifest has them."""
        codes = self._codes
        return self._numbers.described(), Codes(files=codes.files, width=A_ROW, bytes=codes.bytes)
