"""Displacement tiles: every format gives back what it promises to hold."""

from __future__ import annotations

import io
import tracemalloc
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from rhytid import __version__
from rhytid.errors import QueryError
from rhytid.formats.exr import decode_exr
from rhytid.formats.tiles import FORMATS, Encoded, TileHeader, encode, quantise

DRAWN = ("redraw", "tension", "smooth")
HEADER = TileHeader("cm", "smile.0001", "a1b2", *DRAWN, 1002, 3, 1, 2, scale=0.5)
TILE = np.random.default_rng(3).normal(scale=0.1, size=(24, 40)).astype(np.float32)
TILE[0, :4] = 0.0, -0.0, 1e-7, 0.75


def decoded(encoded: Encoded) -> NDArray[np.generic]:
    return np.load(io.BytesIO(encoded.body), allow_pickle=False)


def test_npy_is_exact() -> None:
    encoded = encode(TILE, "npy", HEADER)
    np.testing.assert_array_equal(decoded(encoded), TILE, strict=True)
    assert (encoded.media_type, encoded.extension) == ("application/x-npy", ".npy")


@pytest.mark.parametrize("tile", [TILE, TILE.T, TILE[::2, 1:], TILE.astype(">f4"), TILE[:0]])
def test_npy_is_the_file_that_numpy_saves(tile: NDArray[np.float32]) -> None:
    stream = io.BytesIO()
    np.save(stream, np.ascontiguousarray(tile, "<f4"))
    assert encode(tile, "npy", HEADER).body == stream.getvalue()


def test_moments_of_slopes_have_a_channel_each() -> None:
    moments = np.random.default_rng(5).normal(size=(8, 6, 5)).astype(np.float32)
    np.testing.assert_array_equal(decoded(encode(moments, "npy", HEADER)), moments)
    stream = io.BytesIO(encode(moments, "exr", HEADER).body)
    file = OpenEXR.File(stream, separate_channels=True)
    found = {name: channel.pixels for name, channel in file.channels().items()}
    names = [f"slope.{name}" for name in ("x", "y", "xx", "xy", "yy")]
    assert sorted(found) == sorted(names)
    np.testing.assert_array_equal(np.stack([found[n] for n in names], axis=-1), moments)
    assert file.header()["layer"] == "slopes"


def test_f16_holds_what_rounds_to_its_largest() -> None:
    largest = np.full((2, 2), np.nextafter(np.float32(65520), np.float32(0)))
    assert np.frombuffer(encode(-largest, "f16", HEADER).body, "<f2").tolist() == [-65504.0] * 4
    for beyond in (65520.0, np.nan, -np.inf):
        with pytest.raises(QueryError):
            encode(np.full((1, 1), beyond, np.float32), "f16", HEADER)


def test_f16_is_raw_little_endian_half() -> None:
    encoded = encode(TILE, "f16", HEADER)
    read = np.frombuffer(encoded.body, "<f2").reshape(TILE.shape)
    np.testing.assert_array_equal(read, TILE.astype(np.float16))
    assert (encoded.media_type, encoded.extension) == ("application/octet-stream", ".f16")


@pytest.mark.parametrize(("format", "dtype"), [("exr", np.float32), ("exr16", np.float16)])
def test_exr_has_one_channel_and_its_attributes(format: str, dtype: type[np.generic]) -> None:
    encoded = encode(TILE, format, HEADER)
    assert (encoded.media_type, encoded.extension) == ("image/x-exr", ".exr")
    texels, attributes = decode_exr(encoded.body)
    np.testing.assert_array_equal(texels, TILE.astype(dtype), strict=True)
    assert [channel.name for channel in attributes["channels"]] == ["Y"]
    assert attributes["compression"] == OpenEXR.ZIP_COMPRESSION
    wanted = {"unit": "cm", "frame": "smile.0001", "asset": "a1b2", "method": "redraw"}
    wanted |= {"stretch": "tension", "sampling": "smooth"}
    wanted |= {"udim": 1002, "level": 3, "row": 1, "column": 2, "rhytid_version": __version__}
    assert {name: attributes[name] for name in wanted} == wanted


def test_png_is_grey_of_16_bits_around_32768() -> None:
    encoded = encode(TILE, "png", HEADER)
    assert (encoded.media_type, encoded.extension) == ("image/png", ".png")
    with Image.open(io.BytesIO(encoded.body)) as image:
        assert image.mode == "I;16"
        codes = np.asarray(image)
        notes = dict(image.info)
    assert codes[0, :2].tolist() == [32768, 32768]
    assert codes[0, 3] == 65535  # 0.75 is beyond the scale
    inside = np.abs(TILE) <= HEADER.scale
    heights = (codes.astype(np.float64) - 32768) / 32767 * HEADER.scale
    half_step = HEADER.scale / 32767 / 2
    assert np.abs(heights - TILE)[inside].max() <= half_step * (1 + 1e-9)
    assert (notes["scale"], notes["unit"], notes["frame"]) == ("0.5", "cm", "smile.0001")
    assert (notes["method"], notes["stretch"], notes["sampling"]) == DRAWN


@given(st.floats(-2, 2, width=32), st.floats(1e-6, 1e6))
def test_codes_are_odd_symmetric_and_end_at_the_scale(share: float, scale: float) -> None:
    height = np.array([[share * scale]], np.float32)
    up, down = (int(quantise(h, scale)[0, 0]) - 32768 for h in (height, -height))
    assert max(up, -32767) == -max(down, -32767) or abs(share) > 1
    exact = float(height[0, 0]) / scale * 32767
    assert abs(up - min(max(exact, -32768), 32767)) <= 0.5 + 1e-6


def test_the_ends_of_the_scale_are_codes() -> None:
    heights = np.array([[-0.5, 0.5, -1, 1, -0.50001526]], np.float32)
    assert quantise(heights, 0.5).tolist() == [[1, 65535, 0, 65535, 0]]


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (17, 16), (64, 64)])
def test_any_shape_in_any_memory_order_and_always_the_same_bytes(
    format: str, shape: tuple[int, int]
) -> None:
    tile = np.random.default_rng(1).normal(size=(2 * shape[0], shape[1])).astype(np.float32)
    first = encode(tile[::2], format, HEADER)
    assert encode(np.asfortranarray(tile[::2]), format, HEADER) == first
    assert encode(tile[::2].copy(), format, replace(HEADER)) == first


@pytest.mark.parametrize("format", ["exr", "exr16", "png"])
def test_notes_in_any_language_and_empty_ones(format: str) -> None:
    header = replace(HEADER, unit="µm", frame="")
    body = encode(TILE, format, header).body
    if format == "png":
        with Image.open(io.BytesIO(body)) as image:
            notes = dict(image.info)
    else:
        notes = decode_exr(body)[1]
    assert (notes["unit"], notes["frame"]) == ("µm", "")


@pytest.mark.parametrize("format", ["f16", "exr16"])
def test_what_half_floats_cannot_hold_is_refused(format: str) -> None:
    with pytest.raises(QueryError, match="displacement 70000 does not fit half floats"):
        encode(np.array([[1, -70000]], np.float32), format, HEADER)


def test_an_unknown_format_names_the_known_ones() -> None:
    with pytest.raises(QueryError, match="format 'tiff': one of npy, f16, exr, exr16, png"):
        encode(TILE, "tiff", HEADER)


@pytest.mark.parametrize("format", FORMATS)
def test_encoding_takes_no_more_memory_than_it_says(format: str) -> None:
    tile = np.random.default_rng(5).normal(scale=0.1, size=(1024, 1024)).astype(np.float32)
    encode(tile[:64, :64], format, HEADER)  # what is made once

    tracemalloc.start()
    try:
        encode(tile, format, HEADER)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    most = FORMATS[format].working * tile.nbytes
    assert most - tile.nbytes < tile.nbytes + peak < 1.01 * most
