"""Grey PNG images are read exactly, and everything else is refused by name."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from rhytid.errors import InputError, LimitError
from rhytid.formats.limits import MOST_SIDE
from rhytid.formats.painted import read_grey

RNG = np.random.default_rng(5)


def png(texels, **options):
    """The bytes of an image of uint8 or uint16 codes, or of a mode of the library."""
    image = texels if isinstance(texels, Image.Image) else Image.fromarray(texels)
    stream = io.BytesIO()
    image.save(stream, "PNG", **options)
    return stream.getvalue()


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def raw_png(width, height, bits, kind=0, rows=b"", interlace=0):
    """A PNG written byte by byte, for what the library does not write."""
    head = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, interlace)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_codes_are_as_they_are(dtype):
    most = np.iinfo(dtype).max
    codes = RNG.integers(0, most, (37, 23), endpoint=True).astype(dtype)
    codes[0, :2] = 0, most
    found = read_grey(png(codes), "a.png")
    np.testing.assert_array_equal(found, codes, strict=True)


def test_every_16_bit_code_is_told_apart():
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    assert len(np.unique(read_grey(png(codes), "a.png"))) == 65536


@pytest.mark.parametrize(("bits", "byte"), [(8, b"\x40"), (16, b"\x40\x00")])
def test_an_image_of_one_texel(bits, byte):
    found = read_grey(raw_png(1, 1, bits, rows=b"\x00" + byte), "a.png")
    assert found.tolist() == [[0x40 if bits == 8 else 0x4000]]


def test_the_first_row_of_the_file_is_row_0():
    codes = np.array([[0, 10], [20, 30], [40, 50]], np.uint8)
    np.testing.assert_array_equal(read_grey(png(codes), "a.png"), codes)


def test_text_and_gamma_change_nothing():
    codes = RNG.integers(0, 256, (8, 8)).astype(np.uint8)
    notes = PngInfo()
    notes.add_text("note", "x")
    notes.add(b"gAMA", struct.pack(">I", 45455))
    np.testing.assert_array_equal(
        read_grey(png(codes, pnginfo=notes), "a.png"), read_grey(png(codes), "a.png")
    )


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (png(Image.new("RGB", (4, 4))), "colours: must be grey"),
        (png(Image.new("RGBA", (4, 4))), "colours and transparency: must be grey"),
        (png(Image.new("LA", (4, 4))), "transparency: must be grey"),
        (png(Image.new("P", (4, 4))), "a palette: must be grey"),
        (png(np.zeros((4, 4), np.uint8), transparency=0), "transparency: must be grey"),
        (png(Image.new("1", (4, 4))), "1 bits per texel: must be 8 or 16"),
        (raw_png(4, 4, 4), "4 bits per texel: must be 8 or 16"),
        (raw_png(4, 4, 8, kind=9), "colour type 9: must be grey"),
        (raw_png(0, 4, 8), "0 x 4 texels"),
        (raw_png(4, 4, 8), "a damaged PNG image"),
        (raw_png(4, 4, 8, rows=bytes(12)), "a damaged PNG image"),
        (b"", "not a PNG or OpenEXR image"),
        (b"\xff\xd8\xff\xe0 JFIF", "not a PNG or OpenEXR image"),
        (b"\x89PNG\r\n\x1a\n", "a damaged PNG image"),
    ],
)
def test_what_is_not_grey_is_refused_by_name(data, why):
    with pytest.raises(InputError, match=f"face.1001.png.*{why}"):
        read_grey(data, "face.1001.png")


CHUNKS = "IHDR PLTE tRNS cHRM gAMA iCCP sBIT sRGB pHYs tIME tEXt zTXt iTXt eXIf acTL fcTL fdAT cICP"


@pytest.mark.filterwarnings("ignore:Invalid APNG")
@pytest.mark.parametrize("place", ["before", "after"])
@pytest.mark.parametrize("kind", CHUNKS.split())
def test_odd_chunks_are_refused_or_change_nothing(kind, place):
    whole = raw_png(1, 1, 8, rows=b"\x00\x40")
    at = whole.index(b"IDAT") - 4 if place == "before" else len(whole) - 12
    for body in (b"", b"\0", b"a\0", b"a\0\0", b"a\0\0x", bytes(9), b"\xff" * 13):
        odd = whole[:at] + chunk(kind.encode(), body) + whole[at:]
        try:
            found = read_grey(odd, "a.png")
        except (InputError, LimitError) as refused:
            assert "a.png" in str(refused)  # noqa: PT017
        else:
            assert found.tolist() == [[0x40]]


def test_an_empty_profile_after_the_texels_is_refused():
    whole = raw_png(1, 1, 8, rows=b"\x00\x40")
    with pytest.raises(InputError, match=r"a\.png: a damaged PNG image: .*index"):
        read_grey(whole[:-12] + chunk(b"iCCP", b"") + whole[-12:], "a.png")


@pytest.mark.parametrize("size", [(MOST_SIDE + 1, 1), (1, MOST_SIDE + 1), (2**31 - 1, 2**31 - 1)])
def test_the_size_is_checked_before_anything_is_decoded(size):
    with pytest.raises(LimitError, match=f"{size[0]} x {size[1]} texels: at most {MOST_SIDE}"):
        read_grey(raw_png(*size, 16), "a.png")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_file_cut_anywhere_is_refused(dtype):
    whole = png(RNG.integers(0, 256, (16, 16)).astype(dtype))
    for end in range(len(whole) - 4):  # the last chunk is empty: its checksum may be missing
        with pytest.raises(InputError):
            read_grey(whole[:end], "a.png")


def test_a_changed_byte_is_refused_or_changes_nothing():
    codes = RNG.integers(0, 256, (16, 16)).astype(np.uint8)
    whole = png(codes)
    plain = read_grey(whole, "a.png")
    for at in range(len(whole)):
        broken = bytearray(whole)
        broken[at] ^= 0x11
        try:
            found = read_grey(bytes(broken), "a.png")
        except (InputError, LimitError):
            continue
        np.testing.assert_array_equal(found, plain, err_msg=f"byte {at}")
