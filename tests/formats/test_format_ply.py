"""PLY, ASCII and binary: what is accepted, what is refused, and what the message says."""

from __future__ import annotations

import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats.writers import SQUARE, SQUARE_ARRAYS, SQUARE_FACES, SQUARE_UV, ply, same_mesh
from rhytid.errors import LimitError, MeshError
from rhytid.formats.ply import read_ply

FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
FACES = SQUARE_FACES.tolist()
TEXT = ply(SQUARE, SQUARE_UV, FACES, "ascii")
BINARY = ply(SQUARE, SQUARE_UV, FACES)


def edited(data: bytes, old: bytes, new: bytes) -> bytes:
    assert old in data
    return data.replace(old, new, 1)


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("names", ["uv", "st"])
def test_one_mesh_in_every_format(format: str, names: str) -> None:
    same_mesh(read_ply(ply(SQUARE, SQUARE_UV, FACES, format, names)), *SQUARE_ARRAYS)


@pytest.mark.parametrize("format", FORMATS)
def test_polygons_of_several_sizes_are_cut_as_fans(format: str) -> None:
    mesh = read_ply(ply(SQUARE, SQUARE_UV, [[0, 1, 2], [1, 2, 3, 0], [3, 0, 1, 2, 3]], format))
    wanted = [[0, 1, 2], [1, 2, 3], [1, 3, 0], [3, 0, 1], [3, 1, 2], [3, 2, 3]]
    assert mesh.faces.tolist() == mesh.face_uv.tolist() == wanted


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(TEXT.replace(b"\n", b"\r\n"), id="CRLF"),
        pytest.param(edited(BINARY, b"\nend_header", b"\r\nend_header"), id="mixed line ends"),
        pytest.param(edited(BINARY, b"a test", b"caf\xe9 \xff"), id="comment that is not UTF-8"),
        pytest.param(edited(BINARY, b"_indices", b"_index"), id="vertex_index"),
        pytest.param(edited(BINARY, b"uchar int", b"uint8 int32"), id="sized types"),
        pytest.param(edited(TEXT, b"uchar int", b"int float"), id="float indices"),
        pytest.param(edited(TEXT, b"end_header", b"obj_info x\nend_header"), id="obj_info"),
        pytest.param(
            edited(TEXT, b"element vertex", b"element empty 0\nelement vertex"), id="no properties"
        ),
        pytest.param(
            edited(BINARY, b"end_header", b"element edge 1\nproperty int a\nend_header") + b"1234",
            id="another element after",
        ),
        pytest.param(
            TEXT.replace(
                b"element vertex", b"element note 2\nproperty list char int x\nelement vertex"
            ).replace(b"end_header\n", b"end_header\n3 1 2 3\n0\n"),
            id="lists before",
        ),
        pytest.param(
            TEXT.replace(b"property list", b"property uchar flag\nproperty list")
            .replace(b"vertex_indices", b"vertex_indices\nproperty list uchar float texcoord")
            .replace(b"\n3 ", b"\n9 3 ")
            .replace(b"1 2\n", b"1 2 1 0.5\n")
            .replace(b"2 3\n", b"2 3 0\n"),
            id="faces with more properties",
        ),
    ],
)
def test_accepted_spellings_of_one_mesh(data: bytes) -> None:
    same_mesh(read_ply(data), *SQUARE_ARRAYS)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a PLY file"),
        (b"ply\nformat ascii 1.0\n", "not a PLY file"),
        (edited(TEXT, b"ascii", b"binary_middle"), "line 2: 'format binary_middle 1.0' is no"),
        (edited(TEXT, b"1.0", b"2.0"), "line 2: 'format ascii 2.0'"),
        (edited(TEXT, b"format ascii 1.0\n", b""), "has 0 format lines"),
        (edited(TEXT, b"comment a test", b"format ascii 1.0"), "has 2 format lines"),
        (edited(TEXT, b"element vertex 4", b"element vertex -4"), "line 4: 'element vertex -4'"),
        (edited(TEXT, b"vertex 4", "vertex ٤".encode()), "line 4: "),
        (edited(TEXT, b"float x", b"real x"), "line 5: 'property real x'"),
        (edited(TEXT, b"comment a test", b"property float q"), "line 3: 'property float q'"),
        (edited(TEXT, b"float y", b"float x"), "element vertex declares 'x' twice"),
        (edited(TEXT, b"element face", b"element vertex"), "declares 'vertex' twice"),
        (edited(TEXT, b"float z", b"float w"), "must hold the numbers x, y, z"),
        (edited(TEXT, b"double u", b"double q"), "u and v, or s and t; unwrap the mesh"),
        (edited(TEXT, b"double v", b"list uchar double v"), "and no lists"),
        (edited(TEXT, b"vertex_indices", b"corners"), "no list vertex_indices"),
        (edited(TEXT, b"list uchar int vertex", b"int vertex"), "no list vertex_indices"),
        (edited(TEXT, b"element face 2\nproperty list uchar int vertex_indices\n", b""), "'face'"),
        (edited(TEXT, b"element vertex", b"element point"), "no element 'vertex'"),
        (edited(TEXT, b"vertex 4", b"vertex 999999999999999"), "999999999999999 rows promised"),
        (edited(BINARY, b"vertex 4", b"vertex 999999999999999"), "rows promised, 4 there"),
        (
            edited(BINARY, b"face 2", b"face 3"),
            "element face, row 2 of 3: the list .* past the end",
        ),
        (edited(BINARY, b"face 2", b"face 1"), "longer than its header says"),
        (BINARY[:-1], "row 1 of 2: the list vertex_indices goes past the end"),
        (BINARY[:-12], "row 1 of 2"),
        (BINARY[:-13], "row 1 of 2"),
        (BINARY[:-40], "element vertex: 4 rows promised, 3 there"),
        (BINARY + b"\0", "longer than its header says"),
        (edited(TEXT, b"3 0 1 2", b"-3 0 1 2"), "list vertex_indices 0 has length -3"),
        (edited(TEXT, b"3 0 1 2", b"3.5 0 1 2"), "list vertex_indices 0 has length 3.5"),
        (edited(TEXT, b"3 0 1 2", b"1e999 0 1 2"), "list vertex_indices 0 has length inf"),
        (edited(TEXT, b"3 0 1 2", b"2 0 1"), "face 0 has 2 corners: at least 3"),
        (edited(TEXT, b"3 0 2 3", b"3 0 2 4"), "face 1 corner 3: no vertex 4 of 4"),
        (edited(TEXT, b"3 0 2 3", b"3 0 -1 3"), "face 1 corner 2: no vertex -1 of 4"),
        (edited(TEXT, b"3 0 2 3", b"3 0 1.5 3"), "face 1 corner 2: no vertex 1.5"),
        (edited(TEXT, b"3 0 2 3", b"3 0 4294967298 3"), "face 1 corner 2: no vertex 4.29497e"),
        (edited(TEXT, b"0.25", b"nan"), "line 17: 'nan' is not a plain decimal"),
        (edited(TEXT, b"0.25", b"1_0"), "line 17: '1_0' is not a plain decimal"),
        (edited(TEXT, b"0.25", b"0x1"), "line 17: '0x1'"),
        (edited(TEXT, b"0.25", b"1-2"), "line 17: '1-2'"),
        (edited(TEXT, b"0.25", "٣".encode()), r"line 17: '\\xd9\\xa3'"),
        (edited(TEXT, b"0.25", b"1e39"), r"position 3 is \[0.0, 1.0, inf\]: not finite"),
        (edited(TEXT, b"0.25 ", b""), "longer than its header says"),
        (edited(TEXT, b"0.1 0.8", b"0.1 100.5"), "uv 3 is .*100.5"),
        (BINARY.replace(struct.pack("<d", 0.8), struct.pack("<d", np.nan)), "uv 2 .*not finite"),
        (ply(SQUARE, SQUARE_UV * 0, FACES), "no triangle has area"),
        (ply(SQUARE, SQUARE_UV, []), "no triangle has area"),
    ],
)
def test_refused(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_ply(data)


def test_too_many_numbers_are_refused_before_they_are_read() -> None:
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 20000000\n"
    header += b"".join(b"property uchar %c\n" % n for n in b"xyzuv")
    header += b"element face 0\nproperty list uchar int vertex_index\nend_header\n"
    with pytest.raises(LimitError, match="element vertex holds 100000000 numbers: at most 5"):
        read_ply(header + bytes(100_000_000))


polygon = st.lists(st.integers(0, 3), min_size=3, max_size=6)


@given(st.lists(polygon, max_size=8), st.sampled_from(FORMATS))
def test_every_format_reads_the_same_polygons(polygons: list[list[int]], format: str) -> None:
    polygons.append([0, 1, 2])
    mesh = read_ply(ply(SQUARE, SQUARE_UV, polygons, format))
    wanted = [[p[0], a, b] for p in polygons for a, b in pairwise(p[1:])]
    same_mesh(mesh, SQUARE, wanted, SQUARE_UV, wanted)
