"""What files of scanned displacement promise, by their headers alone: EXR, PNG, TIFF and JPEG.

A header is read here before a library sees a byte of the file. What a library would convert without
a word (palettes, transparency, inks, few bits, the first of several pages) is refused by its name.

After "TIFF 6.0" (Adobe), the BigTIFF design of libtiff, ITU-T T.81 for JPEG, and the PNG
specification, third edition.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from rhytid.errors import InputError
from rhytid.formats import exr, png
from rhytid.formats.limits import MOST_SCAN_SIDE, check_sides

# What a texel may have: grey, or three channels, and an alpha that is 1 throughout.
MOST_CHANNELS = 4
_TIFF = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
_JPEG = b"\xff\xd8\xff"
_FORMATS = "EXR, PNG, TIFF or JPEG"
# Tags of TIFF.
_KIND, _WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _SAMPLES, _FORMAT = 254, 256, 257, 258, 262, 277, 339
_ORIENTATION = 274
_REDUCED, _PAGES, _MOST_TAGS = 1, 32, 4096
_INKS = {
    0: "white as its lowest code",
    3: "a palette",
    5: "inks (CMYK)",
    6: "colours (YCbCr)",
    8: "colours (Lab)",
}
# Bytes of a value by its type; layouts of whole numbers.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8}
_WHOLE = {1: "B", 3: "H", 4: "I", 16: "Q"}
# Frames of JPEG that libraries decode: baseline, extended and progressive.
_FRAMES, _OTHER_FRAMES = (0xC0, 0xC1, 0xC2), set(range(0xC3, 0xD0)) - {0xC4, 0xC8, 0xCC}
_ALONE = {0x01, *range(0xD0, 0xD9)}
_NEEDED = (_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _SAMPLES, _FORMAT, _ORIENTATION)


@dataclass(frozen=True)
class ScanHeader:
    """What a header promises.

    format: `exr`, `png`, `tiff` or `jpeg`.  channels: their names for EXR, else how many in `names`
    without a name.  dtype: of the texels, as numpy writes it; of EXR that of the widest channel.
    """

    format: str
    width: int
    height: int
    names: tuple[str, ...]
    dtype: str

    @property
    def nbytes(self) -> int:
        """Bytes of the texels."""
        return self.width * self.height * len(self.names) * int(self.dtype[1:])


def read_header(data: bytes, name: str) -> ScanHeader:
    """The header of a file; `name` is for messages.

    Raises InputError where it is damaged or promises what is no displacement, LimitError above
    MOST_SCAN_SIDE texels per side.
    """
    if data.startswith(exr.SIGNATURE):
        names, width, height = exr.read_channels(data, name, MOST_CHANNELS, MOST_SCAN_SIDE)
        return ScanHeader("exr", width, height, names, "f4")
    for signature, read in ((png.SIGNATURE, _png), (_JPEG, _jpeg)):
        if data.startswith(signature):
            return _checked(read(data, name), name)
    if data[:4] in _TIFF:
        return _checked(_Tiff(data, name).header(), name)
    raise InputError(f"{name}: must be {_FORMATS}, by its first bytes")


def _checked(header: ScanHeader, name: str) -> ScanHeader:
    check_sides(name, header.width, header.height, MOST_SCAN_SIDE)
    return header


def _grey(count: int) -> tuple[str, ...]:
    return ("",) * count


def _png(data: bytes, name: str) -> ScanHeader:
    found = png.read_layout(data, name)
    if found.kind == png.PALETTE:
        raise InputError(f"{name} has a palette: save it as grey, of 16 bits where possible")
    if found.bits not in (8, 16):
        raise InputError(f"{name} has {found.bits} bits per texel: must be 8 or 16")
    dtype = f"u{found.bits // 8}"
    return ScanHeader("png", found.width, found.height, _grey(found.channels), dtype)


def _jpeg(data: bytes, name: str) -> ScanHeader:
    """By the first frame: its bits, height, width and number of components."""
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            break
        marker = data[at + 1]
        if marker in _ALONE or marker == 0xFF:
            at += 1 if marker == 0xFF else 2
            continue
        if marker in _FRAMES and at + 10 <= len(data):
            bits, height, width, count = struct.unpack_from(">BHHB", data, at + 4)
            if bits != 8 or count not in (1, 3):
                what = "inks (CMYK)" if count == 4 else f"{count} channels of {bits} bits"
                raise InputError(f"{name} has {what}: must be grey")
            return ScanHeader("jpeg", width, height, _grey(count), "u1")
        if marker in _OTHER_FRAMES:
            raise InputError(f"{name} is a JPEG of a rare kind: save it as PNG or TIFF of 16 bits")
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise InputError(f"{name}: a damaged JPEG image: it has no frame")


class _Tiff:
    """Directories of tags, of TIFF with offsets of 32 or 64 bits."""

    def __init__(self, data: bytes, name: str) -> None:
        self._data, self._name = data, name
        self._order = _TIFF[data[:4]]
        self._big = b"+" in data[2:4]

    def header(self) -> ScanHeader:
        """That of the only page; smaller copies of it, as textures have, are left out."""
        pages = [tags for tags in self._pages() if not self._one(tags, _KIND, 0) & _REDUCED]
        if len(pages) != 1:
            raise InputError(f"{self._name} has {len(pages)} pages: must have one")
        (tags,) = pages
        self._check_turned(tags)
        samples = self._one(tags, _SAMPLES, 1)
        self._check_colours(tags, samples)
        return ScanHeader(
            "tiff",
            self._one(tags, _WIDTH),
            self._one(tags, _HEIGHT),
            _grey(samples),
            self._dtype(tags, samples),
        )

    def _check_turned(self, tags: dict[int, list[int]]) -> None:
        """Pillow turns such a file, OpenImageIO does not, and neither says so."""
        if (turned := self._one(tags, _ORIENTATION, 1)) > 1:
            rule = "save it as it lies, without the tag"
            raise InputError(
                f"{self._name} says that it lies turned (orientation {turned}): {rule}"
            )

    def _check_colours(self, tags: dict[int, list[int]], samples: int) -> None:
        photometric = self._one(tags, _PHOTOMETRIC, 1)
        if photometric in _INKS:
            raise InputError(f"{self._name} has {_INKS[photometric]}: save it as grey")
        if not 1 <= samples <= MOST_CHANNELS:
            raise InputError(f"{self._name} has {samples} channels: must have 1 to {MOST_CHANNELS}")

    def _dtype(self, tags: dict[int, list[int]], samples: int) -> str:
        bits, formats = set(tags.get(_BITS, [1])), set(tags.get(_FORMAT, [1]))
        if len(bits) != 1 or len(formats) != 1:
            raise InputError(f"{self._name} has channels of several types: must have one")
        bit, form = bits.pop(), formats.pop()
        if (bit, form) in ((8, 1), (16, 1)):
            return f"u{bit // 8}"
        if (bit, form) in ((16, 3), (32, 3)):
            return f"f{bit // 8}"
        kind = {1: "codes", 2: "signed codes", 3: "floats"}.get(form, f"texels of type {form}")
        rule = "must be codes of 8 or 16 bits, or floats of 16 or 32"
        raise InputError(f"{self._name} has {kind} of {bit} bits: {rule}")

    def _one(self, tags: dict[int, list[int]], tag: int, usual: int | None = None) -> int:
        found = tags.get(tag, [] if usual is None else [usual])
        if not found:
            raise self._damaged(f"it has no tag {tag}")
        return found[0]

    def _pages(self) -> list[dict[int, list[int]]]:
        at = self._numbers("Q" if self._big else "I", 8 if self._big else 4, 1)[0]
        found: list[dict[int, list[int]]] = []
        while at:
            if len(found) == _PAGES:
                raise InputError(f"{self._name} has more than {_PAGES} pages: must have one")
            tags, at = self._directory(at)
            found.append(tags)
        return found

    def _directory(self, at: int) -> tuple[dict[int, list[int]], int]:
        """The tags of whole numbers of a directory, and where the next one is; 0 for none."""
        head, size, wide = (8, 20, "Q") if self._big else (2, 12, "I")
        (count,) = self._numbers("Q" if self._big else "H", at, 1)
        if count > _MOST_TAGS:
            raise self._damaged(f"it has {count} tags")
        tags = {}
        for start in range(at + head, at + head + size * count, size):
            tag, kind = self._numbers("H", start, 2)
            (many,) = self._numbers(wide, start + 4, 1)
            if kind in _WHOLE and tag in (_KIND, *_NEEDED):
                tags[tag] = self._values(kind, many, start + 4 + (size - 4) // 2, wide)
        return tags, self._numbers(wide, at + head + size * count, 1)[0]

    def _values(self, kind: int, many: int, at: int, wide: str) -> list[int]:
        many = min(many, MOST_CHANNELS + 1)
        fits = _SIZES[kind] * many <= struct.calcsize(f"<{wide}")
        place = at if fits else self._numbers(wide, at, 1)[0]
        return self._numbers(_WHOLE[kind], place, many)

    def _numbers(self, layout: str, at: int, many: int) -> list[int]:
        try:
            return list(struct.unpack_from(f"{self._order}{many}{layout}", self._data, at))
        except (struct.error, OverflowError) as exc:
            raise self._damaged("it is cut short") from exc

    def _damaged(self, why: str) -> InputError:
        return InputError(f"{self._name}: a damaged TIFF image: {why}")
