"""OpenEXR images by way of the process that decodes them: every test starts it a few times."""

from __future__ import annotations

import sys

import numpy as np
import OpenEXR
import pytest

from exr_images import exr
from rhytid.domain.controls import signed
from rhytid.domain.painted import shares
from rhytid.errors import InputError
from rhytid.formats import exr as exr_format
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
    start(monkeypatch, "while True: pass")
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
