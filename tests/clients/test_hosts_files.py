"""Files of maps as hosts name, find and open them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from rhytid_client.hosts import MapSequence, Trouble, found
from rhytid_client.hosts.exr_header import float_attribute, text_attribute
from rhytid_client.hosts.files import folder_at, replaced, slug
from rhytid_client.hosts.sequences import NO_UDIM, STANDARD, UDIM_LAST, UNPADDED, copied


def write(path: Path, **attributes: object) -> None:
    """An EXR by the OpenEXR library, as `bake` writes it."""
    pixels = {"Y": np.zeros((4, 4), np.float32)}
    OpenEXR.File(attributes, pixels).write(str(path))


def baked(folder: Path, udims: tuple[int, ...], frames: tuple[int, ...]) -> None:
    for udim in udims:
        for frame in frames:
            height = float(frame + udim - 1001)
            facts = {"unit": "mm", "minimum": -height, "maximum": 0.5 * height, "triangles": 12}
            write(folder / f"face.{udim}.{frame:04d}.exr", **facts)


@pytest.mark.parametrize(
    ("style", "udims", "name"),
    [
        (STANDARD, (1001,), "face.1001.0007.exr"),
        (STANDARD, (1001, 1012), "face.1012.0007.exr"),
        (UNPADDED, (1001, 1012), "face.1012.7.exr"),
        (UDIM_LAST, (1001, 1012), "face_f0007.1012.exr"),
        (NO_UDIM, (1001,), "face_f0007.exr"),
    ],
)
def test_names_of_files(tmp_path: Path, style: tuple, udims: tuple[int, ...], name: str) -> None:
    maps = MapSequence.of(tmp_path, "face", style, udims, [7])
    assert maps.file(udims[-1], 7) == tmp_path / name


def test_frames_beyond_the_digits_keep_theirs(tmp_path: Path) -> None:
    maps = MapSequence.of(tmp_path, "face", STANDARD, (1001,), [12345])
    assert maps.file(1001, 12345).name == "face.1001.12345.exr"


def test_tokens_of_a_host(tmp_path: Path) -> None:
    one = MapSequence.of(tmp_path, "face", STANDARD, (1001,), [1])
    tiled = MapSequence.of(tmp_path, "face", STANDARD, (1001, 1002), [1])
    other = MapSequence.of(tmp_path, "face", STANDARD, (1002,), [1])
    assert one.tokens("$F4") == str(tmp_path / "face.1001.$F4.exr")
    assert tiled.tokens("$F4") == str(tmp_path / "face.<UDIM>.$F4.exr")
    assert tiled.tokens("%04d", "%(UDIM)d") == str(tmp_path / "face.%(UDIM)d.%04d.exr")
    assert [maps.tiled for maps in (one, tiled, other)] == [False, True, True]


def test_what_bake_left_is_found(tmp_path: Path) -> None:
    baked(tmp_path, (1001, 1002), (3, 4, 5))
    maps = found(tmp_path)
    assert (maps.name, maps.udims, maps.frames, maps.digits) == ("face", (1001, 1002), (3, 4, 5), 4)
    assert (maps.unit, maps.triangles) == ("mm", 12)
    assert maps.bound == 6.0
    assert [maps.file(u, f).is_file() for u in maps.udims for f in maps.frames] == [True] * 6


def test_frames_without_zeros_are_found(tmp_path: Path) -> None:
    for frame in range(8, 12):
        write(tmp_path / f"face.1001.{frame}.exr")
    maps = found(tmp_path)
    assert maps.digits == 1
    assert [maps.file(1001, frame).is_file() for frame in maps.frames] == [True] * 4


def test_a_bound_is_known_where_every_file_says_it(tmp_path: Path) -> None:
    baked(tmp_path, (1001,), (1, 2))
    write(tmp_path / "face.1001.0003.exr", unit="mm")
    assert found(tmp_path).bound is None


@pytest.mark.parametrize(
    ("names", "name", "told"),
    [
        ([], "", "has no files named NAME"),
        (["a.1001.0001", "b.1001.0001"], "", "has maps of a, b: give the name of one"),
        (["a.1001.0001", "b.1001.0001"], "c", "has no maps of c; there are a, b"),
        (["a.1001.0001", "a.1001.0003"], "", "Maps of frame 2 are missing"),
        (["a.1001.0001", "a.1001.0009"], "", "Maps of the frames 2, 3, 4, 5, 6 and 2 more are"),
        (["a.1001.0001", "a.1001.0002", "a.1002.0001"], "", "have no map of a UDIM"),
        (["a.1001.1", "a.1001.02"], "", r"a\.1001\.02\.exr .* has zeros that other files have not"),
    ],
)
def test_what_is_missing_is_told(tmp_path: Path, names: list[str], name: str, told: str) -> None:
    for file in names:
        (tmp_path / f"{file}.exr").write_bytes(b"")
    with pytest.raises(Trouble, match=told):
        found(tmp_path, name)


def test_copies_under_other_names(tmp_path: Path) -> None:
    baked(tmp_path, (1001, 1002), (1, 2))
    maps = found(tmp_path)
    copies = copied(maps, folder_at(tmp_path / "renamed"), UDIM_LAST)
    names = sorted(path.name for path in (tmp_path / "renamed").iterdir())
    assert names == [f"face_f000{f}.{u}.exr" for f in (1, 2) for u in (1001, 1002)]
    assert copies.file(1002, 2).read_bytes() == maps.file(1002, 2).read_bytes()
    assert (copies.unit, copies.bound, copies.triangles) == ("mm", 3.0, 12)


def test_a_copy_that_fails_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    baked(tmp_path, (1001,), (1,))
    maps, folder = found(tmp_path), folder_at(tmp_path / "renamed")
    (folder / "face_f0001.1001.exr").mkdir()
    (folder / "face_f0001.1001.part").write_text("of somebody else")
    with pytest.raises(Trouble, match=r"face\.1001\.0001\.exr cannot be copied to"):
        copied(maps, folder, UDIM_LAST)
    left = sorted(path.name for path in folder.iterdir())
    assert left == ["face_f0001.1001.exr", "face_f0001.1001.part"]
    assert (folder / "face_f0001.1001.part").read_text() == "of somebody else"


def test_attributes_of_a_header(tmp_path: Path) -> None:
    file = tmp_path / "a.exr"
    write(file, unit="cm", minimum=-0.25, frame="smile")
    assert text_attribute(file, "unit") == "cm"
    assert float_attribute(file, "minimum") == -0.25
    assert text_attribute(file, "minimum") is None
    assert float_attribute(file, "maximum") is None


@pytest.mark.parametrize("damage", [b"", b"\x76\x2f\x31\x01", b"PNG", b"\x76\x2f\x31\x01" * 4])
def test_a_damaged_header_says_nothing(tmp_path: Path, damage: bytes) -> None:
    (tmp_path / "a.exr").write_bytes(damage)
    assert text_attribute(tmp_path / "a.exr", "unit") is None
    with pytest.raises(Trouble, match="cannot be read"):
        text_attribute(tmp_path, "unit")


def test_names_stay_apart() -> None:
    names = ["Face", "Face.001", "Face 001", "Face:001", "a" * 60, "a" * 61, "Ä"]
    slugs = [slug(name) for name in names]
    assert slugs[0] == "Face"
    assert len(set(slugs)) == len(names)
    assert max(map(len, slugs)) <= 40
    assert all(s.replace("-", "").replace("_", "").isalnum() and s.isascii() for s in slugs)


def test_a_file_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(Trouble, match="cannot be written"):
        replaced(tmp_path / "file" / "a.exr", b"")
    with pytest.raises(Trouble, match="Maps cannot be written to"):
        folder_at(tmp_path / "file" / "maps")
    replaced(tmp_path / "file", b"whole")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
