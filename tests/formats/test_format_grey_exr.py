"""Grey OpenEXR images: the header decides before anything is decoded, then a process decodes them,
which most tests start a few times."""

from __future__ import annotations

import struct
import sys

import numpy as np
import OpenEXR
import pytest

from exr_images import HALF, channels, exr, exr_file, exr_of, raw_exr, raw_header, window
from rhytid.domain.painted_maps import shares, signed
from rhytid.errors import InputError, LimitError
from rhytid.formats import exr as exr_format
from rhytid.formats.exr import read_sides
from rhytid.formats.limits import MOST_SIDE
from rhytid.formats.painted import read_grey

NAME = "face.1001.exr"
RNG = np.random.default_rng(7)
PIZ, ZIP = OpenEXR.PIZ_COMPRESSION, OpenEXR.ZIP_COMPRESSION
SMOOTH = np.linspace(0, 1, 37 * 53, dtype=np.float32).reshape(37, 53).round(2)


def start(monkeypatch, code):
    """Let the decoder be a process that runs this."""
    monkeypatch.setattr(exr_format, "_START", code)


def test_every_code_comes_back():
    codes = np.arange(65536, dtype=np.uint16).reshape(128, 512)
    found = read_grey(exr((codes / 65535).astype(np.float32), compression=PIZ), NAME)
    np.testing.assert_array_equal(found, codes, strict=True)
    assert signed(shares(found[64:65, :1])).tolist() == [[0]]


def test_a_wrong_value_is_named_with_its_place():
    texels = SMOOTH.copy()
    texels[20, 41] = 1.001
    place = r"the texel of column 41, row 20 is 1\.001: must be from 0 to 1"
    with pytest.raises(InputError, match=f"^{NAME}: {place}$"):
        read_grey(exr(texels), NAME)


def test_the_decoder_imports_from_where_this_process_does(monkeypatch, tmp_path):
    """Whatever lies in the working folder, and whatever the environment says."""
    for module in ("numpy", "OpenEXR", "rhytid", "json", "sitecustomize"):
        (tmp_path / f"{module}.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert read_grey(exr(SMOOTH[:2, :2]), NAME).shape == (2, 2)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if "site-packages" not in place])
    with pytest.raises(RuntimeError, match=r"(?s)the EXR decoder does not start.*No module named"):
        read_grey(exr(SMOOTH[:2, :2]), NAME)


@pytest.mark.parametrize("end", ["os.abort()", "os.kill(os.getpid(), 11)", "os._exit(1)"])
def test_a_decoder_that_dies_is_a_damaged_image(monkeypatch, end):
    """Even after an answer of the right length."""
    start(monkeypatch, f"import os; os.write(1, b'ready\\nnull\\n12345678'); {end}")
    with pytest.raises(InputError, match=f"{NAME}: a damaged EXR image"):
        read_grey(exr(SMOOTH[:2, :2]), NAME)


def test_an_answer_of_another_length_is_a_damaged_image(monkeypatch):
    for answer in (
        "",
        "null",
        "null\\n",
        "null\\n123",
        "null\\n123456789",
        "[1, 2]",
        "{",
        "5\\n",
        "true\\n",
        '"abc"\\n',
        "[[],[],[]]\\n",
        "[1,2,3]\\n",
    ):
        start(monkeypatch, f"import os; os.write(1, b'ready\\n{answer}')")
        with pytest.raises(InputError, match=f"{NAME}: a damaged EXR image"):
            read_grey(exr(SMOOTH[:2, :2]), NAME)


def test_a_decoder_that_does_not_end_is_stopped(monkeypatch):
    monkeypatch.setattr(exr_format, "_SECONDS", 1)
    start(monkeypatch, "import time; time.sleep(60)")
    with pytest.raises(InputError, match=f"{NAME}: not decoded within 1 s"):
        read_grey(exr(SMOOTH), NAME)


def test_the_decoder_has_room_for_the_image_and_little_more(monkeypatch):
    """Codes of 1: room for a little, none for a GiB. What it prints is no answer."""
    code = """
import sys; sys.path[:] = sys.argv[4:]
from rhytid.formats import exr_decoder
def greedy(path, width, height):
    print("a warning", flush=True)
    bytearray(200 << 20)
    try:
        bytearray(1 << 30)
    except MemoryError:
        return None, exr_decoder.np.ones((height, width), "u2")
    return None, exr_decoder.np.zeros((height, width), "u2")
exr_decoder.decode = greedy
exr_decoder.main()
"""
    start(monkeypatch, code)
    limited = sys.platform == "linux"
    assert read_grey(exr(SMOOTH[:2, :2]), NAME).tolist() == [[limited] * 2] * 2


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits it")
def test_a_decoder_cannot_write_more_than_an_answer(monkeypatch):
    code = """
import os, sys; sys.path[:] = sys.argv[4:]
from rhytid.formats import exr_decoder
def endless(path, width, height):
    while True:
        os.write(2, b"a" * 65536)
exr_decoder.decode = endless
exr_decoder.main()
"""
    start(monkeypatch, code)
    with pytest.raises(InputError, match=f"{NAME}: a damaged EXR image"):
        read_grey(exr(SMOOTH[:2, :2]), NAME)


@pytest.mark.parametrize("compression", [ZIP, PIZ])
def test_damaged_bytes_are_refused_or_read(compression):
    whole = exr(SMOOTH, compression=compression)
    for end in (len(whole) - 1, len(whole) // 2):
        with pytest.raises(InputError, match=f"{NAME}: a damaged EXR image"):
            read_grey(whole[:end], NAME)
    broken = bytearray(whole)
    for at in RNG.integers(len(whole) // 2, len(whole), 6):
        broken[at] ^= 0xFF
    try:
        assert read_grey(bytes(broken), NAME).shape == SMOOTH.shape
    except InputError as refused:
        assert NAME in str(refused)  # noqa: PT017


TEXELS = np.zeros((37, 53), np.float32)


def told(given):
    """Of a test's parameters, what tells it apart."""
    return given if isinstance(given, str) else "file"


@pytest.mark.parametrize("layout", [{}, {"tiles": (16, 32)}, {"lineOrder": OpenEXR.DECREASING_Y}])
@pytest.mark.parametrize("channel", ["Y", "R", "Z", "mask.V", "a" * 200])
def test_sides_of_what_the_library_writes(channel, layout):
    for dtype in (np.float16, np.float32):
        assert read_sides(exr(TEXELS.astype(dtype), channel, **layout), "a.exr") == (53, 37)


def test_other_attributes_count_for_nothing():
    odd = {"owner": ("string", b"\xff\xfe"), "preview": ("preview", b"\xff" * 8)}
    half = channels("Y", kind=HALF)
    assert read_sides(raw_header(**odd, compression=None, channels=half), "a.exr") == (2, 2)


@pytest.mark.parametrize("size", [(MOST_SIDE + 1, 1), (1, MOST_SIDE + 1), (2**31 - 1, 2**31 - 1)])
def test_too_many_texels_are_refused(size):
    box = window(size[0] - 1, size[1] - 1)
    with pytest.raises(LimitError, match=f"{size[0]} x {size[1]} texels: at most {MOST_SIDE}"):
        read_sides(raw_header(dataWindow=box, displayWindow=box), "a.exr")
    box = window(MOST_SIDE - 1, MOST_SIDE - 1)
    sides = read_sides(raw_header(dataWindow=box, displayWindow=box), "a.exr")
    assert sides == (MOST_SIDE, MOST_SIDE)


def of_the_library():
    """What the library writes and a grey map is not."""
    part = OpenEXR.Part({"name": "one"}, {"Y": TEXELS})
    other = OpenEXR.Part({"name": "two"}, {"Y": TEXELS})
    rgb = np.zeros((4, 4, 3), np.float32)
    plain = {"type": OpenEXR.scanlineimage}
    yield exr_file(OpenEXR.File([part, other])), "has several parts: must have one"
    yield exr_of(plain, "RGB", rgb), r"has colours \(B, G, R\): must be grey, one channel"
    yield (
        exr_file(OpenEXR.File({**plain}, {"Y": TEXELS, "A": TEXELS})),
        r"not one channel \(A, Y\): must be grey",
    )
    yield exr(TEXELS.astype(np.uint32)), "texels of uint: must be half or float"
    moved = {"dataWindow": ((1, 2), (53, 38)), "displayWindow": ((1, 2), (53, 38))}
    yield exr(TEXELS, **moved), r"data window \(1, 2\) to \(53, 38\).*from \(0, 0\) on"
    wider = {"displayWindow": ((0, 0), (99, 99))}
    yield exr(TEXELS, **wider), r"display window \(0, 0\) to \(99, 99\): must be the same"


SHORT = "a damaged EXR image: the header is cut short"


@pytest.mark.parametrize(
    ("data", "why"),
    [
        *of_the_library(),
        (raw_exr(flags=0x802), "has deep texels"),
        (raw_exr(flags=1), "an unknown version"),
        (raw_exr(flags=0x2002), "an unknown version"),
        (raw_exr(channels=channels()), r"not one channel \(\)"),
        (raw_exr(channels=channels(*"ABCDEFGHIJKL")), r"colours \(A, B, C, D, E, F, G, H\)"),
        (raw_exr(channels=channels("Y", "RY", "BY")), "colours"),
        (raw_exr(channels=channels("Y", kind=3)), "texels of type 3: must be half or float"),
        (raw_exr(channels=channels("Y", step=(2, 1))), "a value every 2 x 1 texels: must be 1 x 1"),
        (raw_exr(channels=("chlist", b"Y")), "a name in the header has no end"),
        (raw_exr(channels=("chlist", b"Y\0\2")), SHORT),
        (raw_exr(dataWindow=("box2i", bytes(15))), SHORT),
        (raw_exr(dataWindow=window(-1, 1), displayWindow=window(-1, 1)), "has 0 x 2 texels"),
        (raw_exr(channels=None), "the header has no channels"),
        (raw_exr(dataWindow=None), "the header has no dataWindow"),
        (raw_exr(displayWindow=None), "the header has no displayWindow"),
        (raw_header()[:-1] + raw_header()[8:], "channels is there twice"),
        (raw_header()[:-1] + b"a\0b\0" + struct.pack("<i", -1), SHORT),
        (raw_header()[:-1] + b"a\0b\0" + struct.pack("<i", 2**31 - 1), SHORT),
        (raw_header()[:-1] + b"a" * 256 + b"\0" * 7, "a name in the header has no end"),
        (raw_header()[:-1] + b"a\0b\0\0\0\0\0" * 10_000, "more than 10000 attributes"),
        (b"\x76\x2f\x31\x01", SHORT),
    ],
    ids=told,
)
def test_what_is_no_grey_map_is_refused_by_name(data, why):
    with pytest.raises(InputError, match=f"face.1001.exr.*{why}"):
        read_sides(data, "face.1001.exr")


def test_a_header_cut_anywhere_is_refused():
    whole = raw_header()
    for end in range(4, len(whole)):
        with pytest.raises(InputError, match=r"a\.exr: a damaged EXR image"):
            read_sides(whole[:end], "a.exr")
