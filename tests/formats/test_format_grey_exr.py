"""Grey OpenEXR images are read as codes of 16 bits, and everything else is refused by name."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import OpenEXR
import pytest

from exr_images import (
    HALF,
    PLAIN,
    channels,
    exr,
    exr_file,
    exr_of,
    raw_exr,
    raw_header,
    window,
)
from rhytid.domain.controls import signed
from rhytid.domain.painted import fixed_map, shares
from rhytid.errors import InputError, LimitError
from rhytid.formats.grey import read_grey
from rhytid.formats.limits import MOST_SIDE

RNG = np.random.default_rng(7)
NOISE = RNG.random((37, 53)).astype(np.float32)
SMOOTH = np.linspace(0, 1, 37 * 53, dtype=np.float32).reshape(37, 53).round(2)
NONE, ZIPS, ZIP = OpenEXR.NO_COMPRESSION, OpenEXR.ZIPS_COMPRESSION, OpenEXR.ZIP_COMPRESSION


def told(given):
    """Of a test's parameters, what tells it apart."""
    return given if isinstance(given, str) else "file"


def codes_of(texels):
    return np.round(texels.astype(np.float64) * 65535).astype(np.uint16)


@pytest.mark.parametrize("texels", [NOISE, SMOOTH, SMOOTH[:1, :1], SMOOTH[:16], SMOOTH[:, :1]])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("compression", [NONE, ZIPS, ZIP])
@pytest.mark.parametrize(
    "layout",
    [{}, {"lineOrder": OpenEXR.DECREASING_Y}, {"tiles": (16, 32)}, {"tiles": (64, 16)}],
)
def test_values_become_the_nearest_codes(texels, dtype, compression, layout):
    texels = texels.astype(dtype)
    found = read_grey(exr(texels, compression=compression, **layout), "a.exr")
    np.testing.assert_array_equal(found, codes_of(texels), strict=True)


@pytest.mark.parametrize("channel", ["Y", "R", "A", "Z", "mask.V"])
def test_the_only_channel_may_have_any_name(channel):
    np.testing.assert_array_equal(read_grey(exr(SMOOTH, channel), "a.exr"), codes_of(SMOOTH))


def test_codes_of_a_png_as_values_are_these_codes():
    wide = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    values = (wide / 65535).astype(np.float32)
    np.testing.assert_array_equal(read_grey(exr(values), "a.exr"), wide)
    narrow = np.arange(256, dtype=np.uint8).reshape(16, 16)
    found = fixed_map(read_grey(exr((narrow / 255).astype(np.float32)), "a.exr"), "a map")
    np.testing.assert_array_equal(found, narrow, strict=True)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_one_half_is_neutral_and_the_ends_are_the_ends(dtype):
    values = np.array([[0.0, 0.5, 1.0, -0.0]], dtype)
    codes = read_grey(exr(values), "a.exr")
    assert codes.tolist() == [[0, 32768, 65535, 0]]
    assert signed(shares(codes)).tolist() == [[-1, 0, 1, -1]]


def test_other_attributes_change_nothing():
    odd = {"owner": ("string", b"\xff\xfe"), "preview": ("preview", b"\xff" * 8)}
    assert read_grey(raw_exr(**odd), "a.exr").tolist() == [[0, 16384], [32768, 65535]]
    assert read_grey(raw_exr(order=(1, 0)), "a.exr").tolist() == [[0, 16384], [32768, 65535]]


@pytest.mark.parametrize("row", [0, 20, 36])
@pytest.mark.parametrize("layout", [{}, {"tiles": (16, 16)}])
@pytest.mark.parametrize(
    ("value", "told"),
    [(1.001, r"1\.001"), (-0.25, r"-0\.25"), (np.nan, "nan"), (np.inf, "inf"), (-np.inf, "-inf")],
)
def test_a_value_that_is_no_share_is_named_with_its_place(value, told, layout, row):
    texels = SMOOTH.copy()
    texels[row, 41] = value
    place = f"column 41, row {row} is {told}: must be from 0 to 1"
    with pytest.raises(InputError, match=f"face.1001.exr: the texel of {place}"):
        read_grey(exr(texels, **layout), "face.1001.exr")


def test_a_value_just_above_1_and_a_half_that_signals_are_refused():
    above = struct.pack("<ff", 0.0, np.nextafter(np.float32(1), np.float32(2)))
    with pytest.raises(InputError, match=r"column 1, row 0 is 1\.0000001: must"):
        read_grey(raw_exr((above, above)), "a.exr")
    signals = (b"\x00\x00\x01\x7c",) * 2
    with pytest.raises(InputError, match="column 1, row 0 is nan"):
        read_grey(raw_exr(signals, channels=channels("Y", kind=HALF)), "a.exr")


def of_the_library():
    """What the library writes and a grey map is not."""
    part = OpenEXR.Part({"name": "one"}, {"Y": SMOOTH})
    other = OpenEXR.Part({"name": "two"}, {"Y": SMOOTH})
    rgb = np.zeros((4, 4, 3), np.float32)
    plain = {"compression": ZIP, "type": OpenEXR.scanlineimage}
    yield exr_file(OpenEXR.File([part, other])), "has several parts: must have one"
    yield exr_of(plain, "RGB", rgb), r"has colours \(B, G, R\): must be grey, one channel"
    yield (
        exr_file(OpenEXR.File({**plain}, {"Y": SMOOTH, "A": SMOOTH})),
        r"not one channel \(A, Y\): must be grey",
    )
    yield exr(SMOOTH.astype(np.uint32)), r"texels of type 0 \(0 is UINT\): must be half or float"
    piz = {"compression": OpenEXR.PIZ_COMPRESSION}
    yield exr(SMOOTH, **piz), "compression PIZ: must be one of none, ZIPS, ZIP"
    moved = {"dataWindow": ((1, 2), (53, 38)), "displayWindow": ((1, 2), (53, 38))}
    yield exr(SMOOTH, **moved), r"data window \(1, 2\) to \(53, 38\).*from \(0, 0\) on"
    wider = {"displayWindow": ((0, 0), (99, 99))}
    yield exr(SMOOTH, **wider), r"display window \(0, 0\) to \(99, 99\): must be the same"


@pytest.mark.parametrize(("data", "why"), list(of_the_library()), ids=told)
def test_what_is_no_grey_map_is_refused_by_name(data, why):
    with pytest.raises(InputError, match=f"face.1001.exr.*{why}"):
        read_grey(data, "face.1001.exr")


def tiles(width, height, mode=0):
    return {"flags": 0x202, "tiles": ("tiledesc", struct.pack("<IIB", width, height, mode))}


NO_ROW = "the block of row 0 is not there"


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (raw_exr(flags=0x802), "has deep texels"),
        (raw_exr(type=("string", b"deepscanline")), "has deep texels"),
        (raw_exr(flags=1), "an unknown version"),
        (raw_exr(flags=0x2002), "an unknown version"),
        (raw_exr(channels=channels()), r"not one channel \(\)"),
        (raw_exr(channels=channels(*"ABCDEFGHIJKL")), r"colours \(A, B, C, D, E, F, G, H\)"),
        (raw_exr(channels=channels("Y", "RY", "BY")), "colours"),
        (raw_exr(channels=channels("Y", kind=3)), "texels of type 3"),
        (raw_exr(channels=channels("Y", step=(2, 1))), "a value every 2 x 1 texels: must be 1 x 1"),
        (raw_exr(channels=("chlist", b"Y")), "a name in the header has no end"),
        (raw_exr(channels=("chlist", b"Y\0\2")), "the header is cut short"),
        (raw_exr(compression=("compression", b"\xff")), "compression number 255"),
        (raw_exr(compression=("compression", b"")), "the header is cut short"),
        (raw_exr(dataWindow=("box2i", bytes(15))), "the header is cut short"),
        (raw_exr(dataWindow=("box2f", bytes(16))), "dataWindow is of type box2f"),
        (raw_exr(dataWindow=window(-1, 1), displayWindow=window(-1, 1)), "has 0 x 2 texels"),
        *[(raw_exr(**{name: None}), f"the header has no {name}") for name in PLAIN],
        (raw_header()[:-1] + raw_header()[8:], "is of type chlist, or there twice"),
        (raw_header()[:-1] + b"a\0b\0" + struct.pack("<i", -1), "the header is cut short"),
        (raw_header()[:-1] + b"a\0b\0" + struct.pack("<i", 2**31 - 1), "the header is cut short"),
        (raw_header()[:-1] + b"a" * 256 + b"\0" * 7, "a name in the header has no end"),
        (raw_header()[:-1] + b"a\0b\0\0\0\0\0" * 10_000, "more than 10000 attributes"),
        (raw_header(flags=0x202), "the header has no tiles"),
        (raw_header(**tiles(16, 16, 1)), r"levels \(mipmaps\)"),
        (raw_header(**tiles(2**32 - 1, 16)), "tiles of 4294967295 x 16 texels: from 16 to 1024"),
        (raw_header(**tiles(16, 1)), "tiles of 16 x 1 texels"),
        (raw_header(), "cut short before its 2 blocks"),
        (raw_header() + bytes(16), NO_ROW),
        (raw_header() + b"\xff" * 16, NO_ROW),
        (raw_exr()[:-1], "the block of row 1 is not there, or cut short"),
        (raw_exr()[:-12] + b"\xff" * 12, "the block of row 1 is not there, or cut short"),
        (raw_exr((bytes(7), bytes(7))), "a block has 7 bytes for 8"),
        (raw_exr((bytes(9), bytes(9))), "a block has 9 bytes for 8"),
        (raw_exr((bytes(9), bytes(9)), compression=("compression", b"\2")), "9 bytes for 8"),
        (b"\x76\x2f\x31\x01", "the header is cut short"),
    ],
    ids=told,
)
def test_a_hostile_header_is_refused_by_name(data, why):
    with pytest.raises(InputError, match=f"face.1001.exr.*{why}"):
        read_grey(data, "face.1001.exr")


@pytest.mark.parametrize("kind", ["lines", "tiles"])
@pytest.mark.parametrize("size", [(MOST_SIDE + 1, 1), (1, MOST_SIDE + 1), (2**31 - 1, 2**31 - 1)])
def test_the_size_is_checked_before_anything_is_decoded(size, kind):
    box = window(size[0] - 1, size[1] - 1)
    head = {} if kind == "lines" else tiles(16, 16)
    data = raw_header(dataWindow=box, displayWindow=box, **head)
    with pytest.raises(LimitError, match=f"{size[0]} x {size[1]} texels: at most {MOST_SIDE}"):
        read_grey(data, "a.exr")


def test_a_block_that_unpacks_to_more_or_less_is_refused():
    """256 bytes a row, in ZIPS; one cut short lacks its checksum alone."""
    box = window(63, 1)
    header = {"compression": ("compression", b"\2"), "dataWindow": box, "displayWindow": box}
    whole = zlib.compress(b"\x00" + b"\x80" * 255)  # steps of nothing
    assert not read_grey(raw_exr((whole, whole), **header), "a.exr").any()
    others = [zlib.compress(bytes(length), 9) for length in (0, 255, 257, 100_000)]
    for block in (whole[:-1], whole[:-4], *others):
        assert len(block) < 256
        with pytest.raises(InputError, match="a block does not unpack to 256 bytes"):
            read_grey(raw_exr((block, block), **header), "a.exr")


@pytest.mark.parametrize("layout", [{}, {"tiles": (16, 16)}, {"compression": NONE}])
def test_a_file_cut_anywhere_is_refused(layout):
    whole = exr(SMOOTH[:20, :20], **layout)
    assert len(whole) < 3000
    for end in range(len(whole)):
        with pytest.raises(InputError):
            read_grey(whole[:end], "a.exr")


@pytest.mark.parametrize("layout", [{}, {"tiles": (16, 16)}, {"compression": NONE}])
@pytest.mark.parametrize("flip", [0x01, 0x80, 0xFF])
def test_a_changed_byte_is_refused_or_read(layout, flip):
    whole = exr(SMOOTH[:20, :20], **layout)
    for at in range(len(whole)):
        broken = bytearray(whole)
        broken[at] ^= flip
        try:
            found = read_grey(bytes(broken), "a.exr")
        except (InputError, LimitError):
            continue
        assert found.dtype == np.uint16
        assert found.shape == (20, 20), f"byte {at}"


@pytest.mark.parametrize("seed", range(3))
def test_random_bytes_in_a_file_are_refused_or_read(seed):
    rng = np.random.default_rng(seed)
    whole = exr(SMOOTH, **({"tiles": (16, 16)} if seed == 0 else {}))
    for _ in range(300):
        broken = bytearray(whole)
        for at in rng.integers(4, rng.choice([400, len(whole)]), 6):
            broken[at] = rng.integers(256)
        try:
            assert read_grey(bytes(broken), "a.exr").dtype == np.uint16
        except (InputError, LimitError) as refused:
            assert "a.exr" in str(refused)  # noqa: PT017
