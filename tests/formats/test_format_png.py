"""PNG of 8 and 16 bits, grey and RGB, as others read it."""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from exports.textures.reading import read_texture
from rhytid.errors import InputError
from rhytid.formats import png
from rhytid.formats.png import encode_png, renamed


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1), (5, 3), (7, 2, 3), (64, 64, 3)])
def test_openimageio_reads_the_same_codes(
    tmp_path: Path, kind: type[Any], shape: tuple[int, ...]
) -> None:
    top = np.iinfo(kind).max
    texels = np.random.default_rng(1).integers(0, top, shape, kind, endpoint=True)
    file = tmp_path / "a.png"
    file.write_bytes(encode_png(texels, {"unit": "cm", "where": "µ, 語"}))

    found = read_texture(file)

    assert found.texels.dtype == kind
    np.testing.assert_array_equal(found.texels.reshape(shape), texels)
    assert found.attributes["unit"] == "cm"
    assert found.attributes["where"] == "µ, 語"


def test_pillow_reads_the_same_codes_and_texts() -> None:
    texels = np.random.default_rng(2).integers(0, 65535, (9, 4), np.uint16)

    with Image.open(io.BytesIO(encode_png(texels, {"scale": "0.5"}))) as image:
        image.load()
        np.testing.assert_array_equal(np.asarray(image), texels)
        assert image.info["scale"] == "0.5"


@pytest.mark.parametrize("strip", [1, 40, 96, 1 << 19])  # bytes: rows one by one to all at once
@pytest.mark.parametrize("shape", [(9, 4), (16, 8, 3)])
def test_strips_are_one_stream(
    strip: int, shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(png, "_STRIP", strip)
    texels = np.random.default_rng(4).integers(0, 65535, shape, np.uint16)

    data = encode_png(texels, {})

    stream, at = b"", len(png.SIGNATURE)
    while at < len(data):
        size, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        body = data[at + 8 : at + 8 + size]
        assert zlib.crc32(name + body) == int.from_bytes(data[at + 8 + size :][:4], "big")
        stream += body if name == b"IDAT" else b""
        at += 12 + size
    # Which raises where the checksum is not that of all bytes.
    rows = np.frombuffer(zlib.decompress(stream), np.uint8).reshape(shape[0], -1)
    codes = np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).view(">u2").reshape(shape)
    assert set(rows[:, 0]) == {2}
    np.testing.assert_array_equal(codes, texels)


@pytest.mark.parametrize(
    "texels",
    [
        np.zeros((2, 2, 2), np.uint8),
        np.zeros((2, 2), np.int16),
        np.zeros(4, np.uint8),
        np.zeros((0, 4), np.uint8),
        np.zeros((4, 0, 3), np.uint16),
    ],
)
def test_what_is_no_picture_is_refused(texels: Any) -> None:
    with pytest.raises(InputError, match="no PNG of"):
        encode_png(texels, {})


@pytest.mark.parametrize("name", ["0007", "1", "a name of more letters"])
def test_a_renamed_file_differs_in_the_name_alone(name: str) -> None:
    texels = np.random.default_rng(3).integers(0, 255, (9, 4), np.uint8)
    texts = {"a": "frame", "frame": "0001", "unit": "cm"}

    data = b"".join(renamed(encode_png(texels, texts), "frame", name))

    assert data == encode_png(texels, {**texts, "frame": name})


def test_a_file_without_the_keyword_is_not_renamed() -> None:
    with pytest.raises(ValueError, match="not found"):
        renamed(encode_png(np.zeros((2, 2), np.uint8), {}), "frame", "1")
