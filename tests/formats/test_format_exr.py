"""EXR files are written whole or not at all, and a damaged one is an error."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from rhytid.errors import InputError, StorageError
from rhytid.exports.textures.writers import write_parts
from rhytid.formats.exr import decode_exr, encode_exr, read_exr
from rhytid.formats.exr_encoder import exr_parts
from rhytid.formats.tile_header import TileHeader

HEADER = TileHeader("cm", "0001", "a1b2", "binned", "uv", "smooth", 1001, 0, 0, 0, scale=1.0)
# Compressible, because what ZIP cannot shrink is stored as it is, without a checksum.
MAP = np.sin(np.arange(128 * 128).reshape(128, 128) / 40).round(2).astype(np.float32)


def test_a_written_map_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "face.1001.0001.exr"
    write_parts(path, exr_parts(MAP, HEADER.attributes()))
    texels, attributes = read_exr(path)
    np.testing.assert_array_equal(texels, MAP, strict=True)
    assert attributes["method"] == "binned"
    assert path.read_bytes() == encode_exr(MAP, HEADER)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_writing_replaces_a_file_and_keeps_the_usual_permissions(tmp_path: Path) -> None:
    plain, path = tmp_path / "plain", tmp_path / "map.exr"
    plain.touch()
    path.write_bytes(b"old")
    (tmp_path / "open elsewhere").hardlink_to(path)
    write_parts(path, exr_parts(MAP, HEADER.attributes()))
    np.testing.assert_array_equal(read_exr(path)[0], MAP)
    assert (tmp_path / "open elsewhere").read_bytes() == b"old"  # moved into place, not rewritten
    assert path.stat().st_mode == plain.stat().st_mode


def test_an_interrupted_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "map.exr"
    path.write_bytes(b"old")

    def parts() -> Iterator[bytes]:
        yield b"new"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_parts(path, parts())
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["map.exr"]


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"absent/map.exr cannot be written"):
        write_parts(tmp_path / "absent" / "map.exr", exr_parts(MAP, HEADER.attributes()))
    (tmp_path / "taken.exr").mkdir()
    with pytest.raises(StorageError, match=r"taken.exr cannot be written"):
        write_parts(tmp_path / "taken.exr", exr_parts(MAP, HEADER.attributes()))


@pytest.mark.parametrize("keep", [0, 3, 40, 300, 700, 0.5, -1])
def test_a_file_cut_short_is_an_error(keep: float) -> None:
    data = encode_exr(MAP, HEADER)
    cut = data[: int(keep * len(data)) if isinstance(keep, float) else keep]
    with pytest.raises(InputError, match=r"tile.exr: (not a readable|a damaged) EXR file"):
        decode_exr(cut)


def test_a_flipped_byte_in_the_texels_is_an_error() -> None:
    data = bytearray(encode_exr(MAP, HEADER))
    data[len(data) // 2] ^= 0xFF
    with pytest.raises(InputError, match="EXR file"):
        decode_exr(bytes(data))


def test_a_file_without_the_channel_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "red.exr"
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"R": MAP}).write(str(path))
    with pytest.raises(InputError, match=r"red.exr: .* without a channel Y"):
        read_exr(path)
    with pytest.raises(InputError, match=r"absent\.exr: not a readable EXR file"):
        read_exr(tmp_path / "absent.exr")
