"""What decoding an upload may take, by its bytes and by what its headers promise."""

from __future__ import annotations

from pathlib import PurePath

from rhytid.errors import RhytidError
from rhytid.formats import exr, png, scan_headers
from rhytid.formats.gltf import promised_by_gltf
from rhytid.formats.npz import promised_by_npz
from rhytid.processes.decoding.reading import Files, Sent, all_files

MIB = 1 << 20
# Decodings with limits of their own that go on at once.
AT_ONCE = 2
# Bytes that headers promise, from which on one upload is decoded at a time.
LARGE = 256 * MIB
# Memory of one: so much, and so many bytes for each that was sent and that headers promise.
ROOM, ROOM_A_BYTE, ROOM_A_PROMISED = 256 * MIB, 16, 3
# Of files whose headers promise all that is made of them, packed or not, in place of ROOM_A_BYTE.
ROOM_A_PACKED = 2
# Seconds of processor time: so many, and one for each MiB.
SECONDS = 30
# Seconds by the clock for each of these: what waits for a disk takes no processor time.
CLOCK = 4
# What is not larger, of formats whose memory is bounded by their bytes, needs no such limits.
LIGHT, LIGHT_PROMISED = MIB, 16 * MIB
_BOUNDED = (".obj", ".ply", ".npz", ".npy")
# Of images, per texel, while they are decoded: of an EXR the tiles of its library, too.
_PNG_TEXEL, _EXR_TEXEL = 4, 12
# Of scans, per texel of a channel and per texel of the asset, and once for what measures them.
_SCAN_TEXEL, _RELIEF_TEXEL, _MEASURING = 12, 4, 64 * MIB


def sent_bytes(parts: Files) -> int:
    """Bytes of all files."""
    return sum(file.size for file in all_files(parts))


def room(parts: Files) -> int:
    """Bytes of memory for decoding, beside what headers promise."""
    return ROOM + sum(_room_a_byte(file) * file.size for file in all_files(parts))


def _room_a_byte(file: Sent) -> int:
    packed = file.name in ("mesh", "shapes") and _extension(file) == ".npz"
    return ROOM_A_PACKED if packed else ROOM_A_BYTE


def seconds(parts: Files) -> int:
    """Seconds of processor time for decoding."""
    return SECONDS + sent_bytes(parts) // MIB


def is_light(parts: Files) -> bool:
    """Whether a thread of the server may decode it: little was sent, and little is promised."""
    if sent_bytes(parts) > LIGHT:
        return False
    if "scan" in parts:
        return False
    for file in all_files(parts):
        if file.name in ("mesh", "shapes") and _extension(file) not in _BOUNDED:
            return False
        if file.data.startswith(exr.SIGNATURE):
            return False
    return promised(parts) <= LIGHT_PROMISED


def promised(parts: Files, resolution: int = 0) -> int:
    """Bytes of the arrays that headers of files promise.  resolution: texels per side of the
    asset, for those of its scan."""
    files = all_files(parts)
    reliefs = sum(file.name == "scan" for file in files)
    of_scan = reliefs * _RELIEF_TEXEL * resolution**2 + _MEASURING if reliefs else 0
    return of_scan + sum(map(_promised, files))


def _extension(file: Sent) -> str:
    return PurePath(file.filename or "").suffix.lower()


def _promised(file: Sent) -> int:
    try:
        return _by_header(file)
    except RhytidError:  # which is told when it is decoded
        return 0


def _by_header(file: Sent) -> int:
    extension = _extension(file)
    if file.name in ("mesh", "shapes"):
        if extension == ".npz":
            return promised_by_npz(file.data)
        return promised_by_gltf(file.data) if extension in (".gltf", ".glb") else 0
    data = file.data
    if file.name == "scan":
        header = scan_headers.read_header(data, file.name)
        return _SCAN_TEXEL * header.width * header.height * len(header.names)
    if data.startswith(png.SIGNATURE):
        width, height = png.read_sides(data, file.name)
        return _PNG_TEXEL * width * height
    if data.startswith(exr.SIGNATURE):
        width, height = exr.read_sides(data, file.name)
        return _EXR_TEXEL * width * height
    return 0
