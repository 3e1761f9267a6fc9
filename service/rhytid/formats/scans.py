"""Files of scanned displacement, one for each UDIM, as their channels.

EXR of half and float, PNG and TIFF of 8 and 16 bits, TIFF of floats, and JPEG. Each is decoded by
`scan_decoder` in a process of its own, or in this one where `exr.decode_here` says so.

A map has one channel, or three: equal ones, of which one is kept, or bands of a relief. Bands are
told from what else has three channels by measurement: each has a fineness of its own, while the
channels of colours, of normals and of vector displacement are alike.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted_maps import check_udim
from rhytid.domain.scan import BANDS, Codes, ScanMap, full_range
from rhytid.domain.wording import install_hint
from rhytid.errors import InputError, LimitError
from rhytid.formats import exr
from rhytid.formats.decoder_process import answer_of
from rhytid.formats.scan_decoder import NO_READER, NoReaderError, decode, written
from rhytid.formats.scan_headers import ScanHeader, read_header
from rhytid.support.temporary_folders import temporary_folder

# Bytes of all maps of a scan together: four of 16384² and 16 bits, or two of floats.
MOST_BYTES = 1 << 31
# Texels a side that a map has at least.
LEAST_SIDE = 16
# Seconds that a decoder may take, and one more for so many bytes of texels.
_SECONDS, _BYTES_A_SECOND = 60, 1 << 23
_START = (
    "import sys; sys.path[:] = sys.argv[3:]; from rhytid.formats.scan_decoder import main; main()"
)
_UDIM = re.compile(r"(?:^|[._-])(1[0-9]{3})(?=[._-])")
# A name with this number that no UDIM of the mesh has: texels a side.
_SIDE_NAMED = 1024
_VECTOR_NAMES = re.compile(r"(?:^|[^a-z])(?:vdm|vdisp|vector)(?:[^a-z]|$)", re.IGNORECASE)
# Bands differ in fineness (rms of differences of neighbours over that of the values) by this factor
# at least, and the correlation of two is less than that.
BAND_RATIO, BAND_CORRELATION = 1.25, 0.8
# Of normals: how far their length is from 1 in the median.
_UNIT_LENGTH = 0.03
# Squares of texels that are looked at, along a side, and their sides.
_SQUARES, _SQUARE = 8, 64


def read_scan(
    files: Sequence[tuple[str, bytes]], udims: Sequence[int], *, partial: bool = False
) -> dict[int, ScanMap]:
    """The maps of a mesh with these UDIMs, by UDIM.

    files: (file name or path, bytes) of each.  partial: whether UDIMs of the mesh may have none. A
    name holds its UDIM, as in `face.1001.exr`; a lone file of a mesh of one UDIM needs none.
    Raises InputError, or one of its kinds, naming the file that cannot be used, LimitError.
    """
    places = scan_udims([name for name, _ in files], udims)
    lacking = [udim for udim in udims if udim not in places.values()]
    if lacking and not partial:
        have = ", ".join(str(udim) for udim in lacking)
        raise InputError(f"no map of UDIM {have}, which the mesh has; scan.partial allows it")
    _check_total([(name, read_header(data, name)) for name, data in files])
    maps: dict[int, ScanMap] = {}
    for name, data in files:
        maps[places[name]] = one = read_scan_map(data, name, places[name])
        _check_alike(next(iter(maps.values())), one)
    return dict(sorted(maps.items()))


def scan_udims(names: Sequence[str], udims: Sequence[int]) -> dict[str, int]:
    """The UDIM of each file by its name; raises InputError for one that has none, or another's."""
    found: dict[str, int] = {}
    for name in names:
        udim = _udim(name, len(names) == 1, udims)
        check_udim(udim, udims, name)
        if udim in found.values():
            other = next(known for known, place in found.items() if place == udim)
            raise InputError(f"{name} and {other} are both of UDIM {udim}")
        found[name] = udim
    return found


def _udim(name: str, alone: bool, udims: Sequence[int]) -> int:
    numbers = [int(number) for number in _UDIM.findall(PurePath(name).name)]
    known = [number for number in numbers if number in udims]
    if known:
        return known[0]
    alone = alone and len(udims) == 1
    if alone and set(numbers) <= {_SIDE_NAMED}:
        return udims[0]
    if numbers:
        return numbers[0]
    have = ", ".join(str(udim) for udim in udims)
    rule = "name every map by its UDIM, as in face.1001.exr"
    raise InputError(f"{name} names no UDIM; the mesh has {have}: {rule}")


def _check_total(headers: Sequence[tuple[str, ScanHeader]]) -> None:
    total = 0
    for name, header in headers:
        total += header.nbytes
        if total > MOST_BYTES:
            rule = f"at most {MOST_BYTES}"
            raise LimitError(f"{name}: maps up to it have {total} bytes of texels in all: {rule}")
        if min(header.width, header.height) < LEAST_SIDE:
            size = f"{header.width} x {header.height} texels"
            raise InputError(f"{name} has {size}: at least {LEAST_SIDE} a side")


def _check_alike(first: ScanMap, one: ScanMap) -> None:
    if one.coded != first.coded or (one.coded and one.kind != first.kind):
        kinds = f"{one.name} has {one.kind}, {first.name} has {first.kind}"
        raise InputError(f"{kinds}: one scale and midlevel cannot be right for both")
    if len(one.channels) != len(first.channels):
        counts = f"{one.name} has {len(one.channels)} channels that differ, {first.name} has"
        raise InputError(f"{counts} {len(first.channels)}: must be as many")


def read_scan_map(data: bytes, name: str, udim: int) -> ScanMap:
    """One map; raises InputError naming what is wrong with it and where, LimitError."""
    header = read_header(data, name)
    channels = _relief_channels(header, _decoded(data, name, header), name)
    for channel in channels:
        _check_finite(channel, name)
    if len(channels) == BANDS:
        _check_bands(header, channels, name)
    return ScanMap(udim, name, channels)


def _decoded(data: bytes, name: str, header: ScanHeader) -> tuple[Codes, ...]:
    if exr.decodes_here(name):
        return _decoded_here(data, name, header)
    seconds = _SECONDS + header.nbytes / _BYTES_A_SECOND
    try:
        answer = answer_of(_START, data, [written(header)], seconds, "scan")
    except subprocess.TimeoutExpired as exc:
        raise InputError(f"{name}: not decoded within {seconds:.0f} s") from exc
    word, _, _ = answer[:64].partition(b"\n")
    try:
        found = json.loads(word)
        if found == NO_READER:
            raise _no_reader(name, header)
        flat = np.frombuffer(answer, np.dtype(found), offset=len(word) + 1)
        whole = flat.reshape(len(header.names), header.height, header.width)
    except (ValueError, TypeError) as exc:  # it failed, or was made to answer something else
        raise _damaged(name, header) from exc
    return tuple(whole)


def _decoded_here(data: bytes, name: str, header: ScanHeader) -> tuple[Codes, ...]:
    with temporary_folder("rhytid-") as folder:
        path = folder / "image"
        path.write_bytes(data)
        try:
            return decode(path, header)
        except MemoryError:
            raise
        except NoReaderError as exc:
            raise _no_reader(name, header) from exc
        except Exception as exc:
            raise _damaged(name, header) from exc


def _damaged(name: str, header: ScanHeader) -> InputError:
    return InputError(f"{name}: a damaged {header.format.upper()} image, or one that is cut short")


def _no_reader(name: str, header: ScanHeader) -> InputError:
    what = f"{len(header.names)} channels of {'half floats' if header.dtype == 'f2' else '16 bits'}"
    if header.dtype == "f4":
        what = f"{len(header.names)} channels of floats"
    hint = f"{install_hint('tx')}, or save it as EXR"
    return InputError(f"{name} has {what}, which OpenImageIO reads: {hint}")


def _relief_channels(
    header: ScanHeader, channels: tuple[Codes, ...], name: str
) -> tuple[Codes, ...]:
    """One channel, or BANDS that differ; without an alpha that is 1 throughout."""
    found = dict(zip(_names_of(header), channels, strict=True))
    alpha = found.pop("A", None)
    if alpha is not None and (alpha != full_range(alpha)).any():
        raise InputError(f"{name} has transparency: save it without, the relief alone")
    if {"X", "Y", "Z"} <= set(found):
        raise _vectors(f"{name} has channels X, Y and Z:")
    if len(found) == 1:
        return tuple(found.values())
    if set(found) != {"R", "G", "B"}:
        have = ", ".join(found)
        raise InputError(f"{name} has channels {have}: must have one, or R, G and B for bands")
    red, green, blue = (found[channel] for channel in "RGB")
    if np.array_equal(red, green) and np.array_equal(red, blue):
        return (red,)
    if _VECTOR_NAMES.search(PurePath(name).name):
        raise _vectors(f"{name} is named so, and has three channels that differ:")
    return red, green, blue


def _names_of(header: ScanHeader) -> tuple[str, ...]:
    """Names of channels without those of layers before them; where there are none, by number."""
    count = len(header.names)
    if header.format == "exr":
        names = tuple(name.rpartition(".")[2] for name in header.names)
        named = names if len(set(names)) == count else header.names
        return ("Y",) if count == 1 else named
    return {1: ("Y",), 2: ("Y", "A"), 3: ("R", "G", "B")}.get(count, ("R", "G", "B", "A"))


def _vectors(what: str) -> InputError:
    rule = "only heights along the normal are read: bake it as displacement along the normal"
    return InputError(f"{what} vector displacement, of three directions; {rule}")


def _check_finite(values: Codes, name: str) -> None:
    if values.dtype.kind != "f":
        return
    for start in range(0, len(values), 256):
        wrong = np.argwhere(~np.isfinite(values[start : start + 256]))
        if len(wrong):
            row, column = (wrong[0] + (start, 0)).tolist()
            value = values[row, column]
            raise InputError(f"{name}: the texel of column {column}, row {row} is {value}")


def _check_bands(header: ScanHeader, channels: Sequence[Codes], name: str) -> None:
    """Refuse normals, colours and vectors: three channels that are no bands of a relief."""
    squares = np.stack([_squares(channel) for channel in channels])
    if header.dtype[0] == "u" and _are_normals(squares):
        raise InputError(f"{name} is a normal map: must be displacement, heights along the normal")
    highest = _most_alike(squares)
    if highest >= BAND_CORRELATION:
        raise InputError(
            f"{name} has colours or vectors: two of its channels rise and fall together "
            f"(correlation {highest:.2f}), so they are no bands of a relief; save displacement as "
            "grey"
        )
    fineness = np.sort([_fineness(one) for one in squares])
    with np.errstate(invalid="ignore"):  # channels that are flat
        ratio = float((fineness[1:] / fineness[:-1]).min())
    if ratio < BAND_RATIO:
        raise _vectors(
            f"{name} has three channels of which two are as fine as one another (bands of a relief "
            f"differ {BAND_RATIO:g} times or more, these {ratio:.2f} times), which looks like"
        )


def _squares(values: Codes) -> NDArray[np.float64]:
    """(K, h, w) squares of a channel, evenly spread, as values; all of it where it is small."""
    height, width = values.shape
    corners = [
        (row, column)
        for row in np.linspace(0, max(height - _SQUARE, 0), _SQUARES).astype(int)
        for column in np.linspace(0, max(width - _SQUARE, 0), _SQUARES).astype(int)
    ]
    cut = [values[row : row + _SQUARE, column : column + _SQUARE] for row, column in corners]
    return np.stack(cut).astype(np.float64) / full_range(values)


def _are_normals(squares: NDArray[np.float64]) -> bool:
    length = np.sqrt(((2.0 * squares - 1.0) ** 2).sum(axis=0))
    return bool(np.median(np.abs(length - 1.0)) < _UNIT_LENGTH)


def _most_alike(squares: NDArray[np.float64]) -> float:
    """The largest correlation of two channels, whichever way; 0 where they do not vary."""
    flat = squares.reshape(len(squares), -1)
    flat = flat - flat.mean(axis=1, keepdims=True)
    size = np.linalg.norm(flat, axis=1)
    flat = flat / np.where(size > 0.0, size, 1.0)[:, None]
    found = np.abs(flat @ flat.T)
    return float(found[np.triu_indices(len(found), 1)].max())


def _fineness(squares: NDArray[np.float64]) -> float:
    """How fine a channel is, about 1 / wavelength in texels; infinite where it is flat."""
    size = float(squares.std())
    steps = np.diff(squares, axis=2)
    return float(np.sqrt((steps**2).mean())) / size if size > 0.0 else np.inf
