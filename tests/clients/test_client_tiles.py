"""Tiles as files and as pictures; their readers here are others' than the client's."""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from clients.shells import Script
from rhytid.baking.frame_names import FramePlace
from rhytid.baking.output import FLOATS, Output
from rhytid.formats.png import read_grey_png
from rhytid_client import Tile, npy, png

ROWS = np.linspace(-0.3, 0.4, 20)[:, None] * np.linspace(0.1, 1.0, 30)
HEIGHTS = ROWS.astype(np.float32)


def drawn(format: str = "npy", values: Any = HEIGHTS, label: str = "1001.smile") -> Tile:
    content = npy.encode(values) if format == "npy" else b"as sent"
    return Tile(format, content, values=values if format in ("npy", "f16") else None, label=label)


def picture(data: bytes) -> Image.Image:
    image = Image.open(io.BytesIO(data))
    image.load()
    return image


@pytest.mark.parametrize(
    ("format", "extension"),
    [("npy", ".npy"), ("f16", ".f16"), ("exr", ".exr"), ("exr16", ".exr"), ("png", ".png")],
)
def test_what_was_sent_is_kept(tmp_path: Path, format: str, extension: str) -> None:
    tile = drawn(format)
    in_folder = tile.save(tmp_path, name="cheek")
    assert in_folder == tmp_path / f"cheek.1001.smile{extension}"
    by_name = tile.save(str(tmp_path / f"other{extension}"))
    assert in_folder.read_bytes() == by_name.read_bytes() == tile.content
    assert sorted(tmp_path.iterdir()) == sorted([in_folder, by_name])
    in_new_folder = tile.save(tmp_path / "new" / "maps", name="cheek")
    assert in_new_folder == tmp_path / "new" / "maps" / in_folder.name
    assert in_new_folder.read_bytes() == tile.content
    in_version = tile.save(f"{tmp_path}/maps.v2/", name="cheek")
    assert in_version == tmp_path / "maps.v2" / in_folder.name


def test_half_floats_become_an_array_file(tmp_path: Path) -> None:
    half = HEIGHTS.astype(np.float16)
    saved = np.load(drawn("f16", half).save(tmp_path / "a.npy"))
    assert saved.dtype == np.float16
    np.testing.assert_array_equal(saved, half)


@pytest.mark.parametrize("scale", [None, 1.25])
def test_png_of_16_bits_holds_heights(tmp_path: Path, scale: float | None) -> None:
    data = drawn().save(tmp_path / "a.png", scale=scale).read_bytes()
    codes = read_grey_png(data, "a.png")
    assert codes.dtype == np.uint16
    told = float(picture(data).text["scale"])  # type: ignore[attr-defined]
    assert told == (float(np.abs(HEIGHTS).max()) if scale is None else scale)
    found = (codes.astype(np.float64) - 32768) / 32767 * told
    np.testing.assert_allclose(found, HEIGHTS, atol=0.5001 * told / 32767)


def test_flat_and_tiny_tiles_have_files_and_pictures() -> None:
    for side in (1, 2, 3):
        flat = np.zeros((side, side), np.float32)
        assert (read_grey_png(png.heights16(flat), "flat") == 32768).all()
        assert np.asarray(picture(png.relief(flat))).shape == (side, side)


@pytest.mark.parametrize(
    ("tile", "file", "options", "told"),
    [
        (drawn(), "a.exr", {}, "ask for format='exr' or format='exr16'"),
        (drawn("exr"), "a.npy", {}, "ask for format='npy'"),
        (drawn("exr"), "a.png", {}, "ask for format='png'"),
        (drawn("exr"), "maps", {"scale": 1.0}, "leave scale out"),
        (drawn(), "a.tif", {}, "written as .npy, .f16, .exr, .png"),
        (drawn(), "a.png", {"scale": 0.0}, "scale 0"),
        (drawn(), "a.npy", {"scale": 1.0}, "leave scale out"),
        (drawn("png"), "a.png", {"scale": 1.0}, "leave scale out"),
        (drawn(values=HEIGHTS * np.float32(np.nan)), "a.png", {}, "nan"),
    ],
)
def test_what_cannot_be_written_is_told(
    tmp_path: Path, tile: Tile, file: str, options: dict[str, Any], told: str
) -> None:
    with pytest.raises(ValueError, match=told):
        tile.save(tmp_path / file, **options)
    assert list(tmp_path.iterdir()) == []


def test_a_notebook_shows_relief_lit_from_the_upper_left() -> None:
    x, y = np.meshgrid(np.arange(600), np.arange(600))
    bump = np.exp(-((x - 300.0) ** 2 + (y - 300.0) ** 2) / 1e4) * 0.01
    data = drawn(values=bump.astype(np.float32))._repr_png_()
    assert data is not None
    image = picture(data)
    assert image.mode == "L"
    assert max(image.size) <= 512
    grey = np.asarray(image).astype(float)
    half = len(grey) // 2
    reach = int(half * 0.23)
    up_left, down_right = (grey[half + s * reach, half + s * reach] for s in (-1, 1))
    assert up_left > grey[5, 5] + 20
    assert down_right < grey[5, 5] - 20
    assert image.text["highest"] == "0.01"  # type: ignore[attr-defined]


def test_a_notebook_shows_what_it_can() -> None:
    sent = png.heights16(HEIGHTS)
    assert Tile("png", sent)._repr_png_() == sent
    assert Tile("exr", b"v/1\x01")._repr_png_() is None


def test_damage_is_seen_by_the_reader_of_the_tests() -> None:
    data = bytearray(png.heights16(HEIGHTS))
    at = data.index(b"IDAT") + 6
    data[at] ^= 0xFF
    with pytest.raises((OSError, SyntaxError, zlib.error)):
        picture(bytes(data))


def test_maps_are_called_as_those_of_bake(tmp_path: Path, shell: Any) -> None:
    client = shell(Script(httpx.Response(200, content=npy.encode(HEIGHTS))))
    place = FramePlace("smile", Path("smile.obj"), 0)
    saved = client.map("a", "smile", 1002, format="npy").save(tmp_path, name="cheek")
    baked = Output(tmp_path, "cheek").file(FLOATS[0], 1002, place)
    assert saved.stem == baked.stem
    assert client.map("a", "smile", 1002, level=3).label == "1002.smile.3"
    assert client.tile("a", "smile", 1002, 0, 5, 6).label == "1002.smile.0.5.6"
