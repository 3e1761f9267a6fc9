"""OBJ: what is accepted, what is refused, and where the message says it is."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats.writers import SQUARE, SQUARE_ARRAYS, SQUARE_UV, obj, same_mesh
from rhytid.errors import LimitError, MeshError
from rhytid.formats import obj as module
from rhytid.formats.obj import read_obj, read_obj_positions, split_statements

PLAIN = """\
v 0 0 0.5
v 1 0 0
v 1 1 0
v 0 1 0.25
vt 0.1 0.2
vt 0.9 0.2
vt 0.9 0.8
vt 0.1 0.8
f 1/1 2/2 3/3
f 1/1 3/3 4/4
"""
FIRST = "f 1/1 2/2 3/3"
# Every statement of the format that holds no face, as in the examples of its specification.
CURVES = """\
vp 0.2 0.3 1
cstype rat bspline
deg 3 3
bmat u 1 0 0 0 \\
 0 1 0 0
step 1 1
res 4 4
curv2 1 1 1
parm u 0 0 1 1
end
curv 0.0 1.0 1 2 3 4
surf 0 1 0 1 1/1 2/2 \\
 3/3 4/4
parm u 0.0 1.0
trim 0 1 1
hole 0 1 1
scrv 0 1 1
sp 1
end
con 1 0 1 1 2 0 1 1
ctech cparm 1.0
stech cparma 1.0 1.0
cdc 1 2 3 4
cdp 1 2 3 4
bsp 1 2 3 4
"""


def edited(old: str, new: str) -> bytes:
    assert old in PLAIN
    return PLAIN.replace(old, new, 1).encode()


def vertex(new: str) -> bytes:
    """With another second line."""
    return edited("v 1 0 0", new)


def face(new: str) -> bytes:
    """With another ninth line."""
    return edited(FIRST, new)


def test_a_plain_file() -> None:
    same_mesh(read_obj(PLAIN.encode()), *SQUARE_ARRAYS)


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(PLAIN.replace("\n", "\r\n").encode(), id="CRLF"),
        pytest.param(PLAIN.replace("\n", "\r").encode(), id="CR"),
        pytest.param(PLAIN.replace(" ", "\t").encode(), id="tabs"),
        pytest.param(PLAIN.replace(" ", " \t ").replace("\n", "  \n").encode(), id="spaces"),
        pytest.param(PLAIN.replace("f ", " \tf ").encode(), id="indented"),
        pytest.param(b"\xef\xbb\xbf" + PLAIN.encode(), id="byte-order mark"),
        pytest.param(PLAIN.rstrip().encode(), id="no last line end"),
        pytest.param(b"# caf\xe9 \xff\\\n" + PLAIN.encode(), id="comment that is not UTF-8"),
        pytest.param(vertex("v 1 0 0 # right"), id="comment after"),
        pytest.param(vertex("v 1 0 0 1.0"), id="weight"),
        pytest.param(vertex("v 1 0 0 .2 .3 .4"), id="colour"),
        pytest.param(vertex("v 1 0 0 .2 .3 .4 1"), id="colour and alpha"),
        pytest.param(vertex("v +1.0e0 0. -.0E-5"), id="spellings of decimals"),
        pytest.param(edited("vt 0.9 0.2", "vt 0.9 0.2 0"), id="three texture components"),
        pytest.param(PLAIN.replace("/1", "/1/9").encode(), id="some normals"),
        pytest.param(
            PLAIN.replace(FIRST, "f 1/1/4 2/2/5 3/3/-6")
            .replace("1 3/3 4/4", "1/1 3/3/2 4/4/3")
            .encode(),
            id="all normals",
        ),
        pytest.param(face("f -4/-4 -3/-3 -2/-2"), id="relative"),
        pytest.param(face("f +1/01 2/2 3/3"), id="spellings of whole numbers"),
        pytest.param(edited(FIRST + "\nf 1/1 3/3 4/4", FIRST + " 4/4"), id="polygon"),
        pytest.param(face("f 1/1 \\\n 2/2\\ \n3/3"), id="continued"),
        pytest.param(
            b"mtllib /etc/passwd\no a\ng b c\ns off\nusemtl x\nvn 0 0 1\nl 1 2\np 1\n"
            + PLAIN.encode(),
            id="passed over",
        ),
        pytest.param(
            PLAIN.replace(FIRST, CURVES + FIRST).encode() + b"p 1 2\nl 1/1 2/2\nbzp 1 2\n",
            id="curves and surfaces",
        ),
    ],
)
def test_accepted_spellings_of_one_mesh(data: bytes) -> None:
    same_mesh(read_obj(data), *SQUARE_ARRAYS)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (vertex("v 1 0"), "line 2: v has 2 numbers: 3, or 4, 6 or 7"),
        (vertex("v 1 0 0 1 1"), "line 2: v has 5 numbers"),
        (vertex("v"), "line 2: v has 0 numbers"),
        (vertex("v 1 nan 0"), "line 2: v has 'nan': not a plain decimal"),
        (vertex("v 1 inf 0"), "'inf'"),
        (vertex("v 1_0 0 0"), "'1_0'"),
        (vertex("v 0x1 0 0"), "'0x1'"),
        (vertex("v 1,5 0 0"), "'1,5'"),
        (vertex("v 1 0 ٣"), r"'\\xd9\\xa3'"),
        (vertex("v 1 0 1d5"), "'1d5'"),
        (vertex("v 1 0 ."), r"'\.'"),
        (vertex("v 1 0 1-2"), "'1-2'"),
        (vertex("v 1 0 0 nan"), "'nan'"),
        (vertex("v 1 0 1e39"), r"line 2: vertex 2 is \[1.0, 0.0, inf\]: not finite"),
        (vertex("v 1 0 1e999"), "line 2: vertex 2"),
        (edited("vt 0.9 0.2", "vt 0.9"), "line 6: vt has 1 number: 2 or 3"),
        (edited("vt 0.9 0.2", "vt 0.9 nan"), "line 6: vt has 'nan'"),
        (edited("vt 0.9 0.2", "vt 0.9 1e999"), "line 6: texture coordinate 2"),
        (edited("vt 0.9 0.2", "vt 0.9 100.5"), "uv 1 is .*100.5"),
        (face("f 1/1 5//3 3/3"), "line 9: face corner 2 '5//3' has no texture coordinate"),
        (
            face("f 1/1 2 3/3"),
            "line 9: face corner 2 '2' has no texture coordinate: unwrap the mesh",
        ),
        (face("f 1/1 2/2 3/"), "line 9: face corner 3 '3/' is not vertex/texture"),
        (face("f 1/1 2/2 3/3.0"), "corner 3 '3/3.0'"),
        (face("f 1/1 2/2 3/3/3/3"), "corner 3 '3/3/3/3'"),
        (face("f 1/1 2/2 3/1_0"), "corner 3 '3/1_0'"),
        (face("f 1/1 2/2 3/٣"), r"corner 3 '3/\\xd9\\xa3'"),
        (face("f 1/1 2/2"), "line 9: face has 2 corners: at least 3"),
        (face("f"), "line 9: face has 0 corners"),
        (face("f 1/1 2/2 5/3"), "line 9: face corner 3 '5/3': no such vertex"),
        (face("f 1/1 2/2 3/5"), "line 9: face corner 3 '3/5': no such texture coordinate"),
        (face("f 1/1 0/2 3/3"), "corner 2 '0/2': no such vertex"),
        (face("f 1/1 2/0 3/3"), "corner 2 '2/0': no such texture coordinate"),
        (face("f 1/1 -5/2 3/3"), r"'-5/2': no such vertex \(4 in the file, 4 before"),
        (face("f 1/1 4294967298/2 3/3"), "'4294967298/2': no such vertex"),
        (face(f"f 1/1 {10**30}/2 3/3"), "10{30}/2': no such vertex"),
        (face(f"f 1/1 -{10**30}/2 3/3"), "-10{30}/2': no such vertex"),
        (edited("f 1/1 3/3 4/4", "f 1/1 3/3 9/4"), "line 10: face corner 3 '9/4'"),
        (vertex("V 1 0 0"), "line 2: 'V' is not a statement"),
        (face("call other.obj"), "line 9: 'call' is not a statement"),
        (face("csh ls"), "line 9: 'csh' is not a statement"),
        (b"\x00\x01\x02", r"line 1: '\\x00"),
        (b"", "no faces"),
        (b"v 0 0 0\n", "no faces"),
        (FIRST.encode(), "line 1: face corner 1 '1/1': no such vertex"),
        (PLAIN.replace("v 1 1 0", "v 2 0 -0.5").replace("4/4", "3/4").encode(), "no triangle has"),
        (PLAIN.replace("0.8", "0.2").encode(), "no triangle has"),
    ],
)
def test_refused(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_obj(data)


def test_a_relative_index_counts_back_from_its_own_line() -> None:
    lines = PLAIN.splitlines()
    early = [*lines[:3], *lines[4:7], "f -3/-3 -2/-2 -1/-1", lines[3], lines[7], lines[9]]
    same_mesh(read_obj("\n".join(early).encode()), *SQUARE_ARRAYS)
    lines.insert(1, "f 1/1 -2/1 1/1")
    with pytest.raises(MeshError, match=r"line 2: face corner 2 '-2/1'.* 1 before this line"):
        read_obj("\n".join(lines).encode())


def test_a_continued_line_does_not_move_the_numbers_of_later_lines() -> None:
    data = vertex("v 1 \\\n 0 \\\n 0").replace(b"2/2", b"9/2")
    with pytest.raises(MeshError, match="line 11: face corner 2 '9/2'"):
        read_obj(data)


def test_unused_vertices_repeated_corners_and_flat_triangles_are_kept() -> None:
    mesh = read_obj(face("v 7 7 7\nvt 0 0\nf 1/1 1/1 2/2\n" + FIRST))
    assert (len(mesh.positions), len(mesh.uv), len(mesh.faces)) == (5, 5, 3)
    assert mesh.faces[0].tolist() == [0, 0, 1]
    assert mesh.usable_triangles().tolist() == [False, True, True]


def test_an_unused_vertex_must_be_finite() -> None:
    with pytest.raises(MeshError, match="line 11: vertex 5"):
        read_obj(PLAIN.encode() + b"v 0 1e40 0\n")


def test_uv_keeps_the_digits_of_a_double() -> None:
    mesh = read_obj(edited("vt 0.9 0.8", "vt 9.123456789012345 0.8"))
    assert mesh.uv[2, 0] == 9.123456789012345


def test_a_polygon_is_cut_as_a_fan_from_its_first_corner() -> None:
    mesh = read_obj(face("f 2/2 3/3 4/4 1/1 2/2"))
    assert mesh.faces.tolist() == [[1, 2, 3], [1, 3, 0], [1, 0, 1], [0, 2, 3]]


def test_a_face_without_end_is_refused_before_it_is_matched() -> None:
    with pytest.raises(LimitError, match=r"line 9: a face of .* characters"):
        read_obj(face("f" + " 1/1" * 300_000))


def test_a_long_run_of_digits_takes_no_long_time() -> None:
    with pytest.raises(MeshError, match="line 2: v has '1111"):
        read_obj(vertex("v " + "1" * 1_000_000 + "x 0 0"))


def test_a_continuation_beside_a_long_line_takes_no_long_time() -> None:
    long = "g " + "x" * 2_000_000
    data = vertex(f"v 1 \\\n 0 \\ \n 0\n{long}\n{long} \\\n y").replace(b"2/2", b"9/2")
    with pytest.raises(MeshError, match="line 14: face corner 2 '9/2'"):
        read_obj(data)
    same_mesh(read_obj(data.replace(b"9/2", b"2/2")), *SQUARE_ARRAYS)


@pytest.mark.parametrize(
    ("data", "texts"),
    [
        (b"v 1\\\n2\nv 3", [(1, b"1 2"), (3, b"3")]),
        (b"v 1\\\n\\\n2", [(1, b"1  2")]),
        (b"v 1 \\\n\nv 2", [(1, b"1  "), (3, b"2")]),
        (b"v 1\\", [(1, b"1\\")]),
        (b"v 1\\\n", [(1, b"1 ")]),
        (b"v 1\\2\nv 3\\x\nv 4", [(1, b"1\\2"), (2, b"3\\x"), (3, b"4")]),
    ],
)
def test_where_continued_statements_stand(data: bytes, texts: list[tuple[int, bytes]]) -> None:
    found = split_statements(data)[b"v"]
    assert list(zip(found.lines, found.texts, strict=True)) == texts


def test_vertices_alone() -> None:
    points = "\n".join(PLAIN.splitlines()[:4])
    np.testing.assert_array_equal(read_obj_positions(points.encode()), SQUARE)
    broken = (PLAIN + "f 1 2 3\nf 9/9\n").encode()
    np.testing.assert_array_equal(read_obj_positions(broken), SQUARE)


finite32 = st.floats(-(2.0**100), 2.0**100, width=32)


@given(
    st.lists(st.tuples(finite32, finite32, finite32), min_size=1, max_size=20),
    st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=1, max_size=20),
    st.data(),
)
def test_what_is_written_is_read_back_to_the_bit(
    points: list[tuple[float, ...]], textures: list[tuple[float, ...]], data: st.DataObject
) -> None:
    positions = np.concatenate([SQUARE, np.array(points, np.float32)])
    uv = np.concatenate([SQUARE_UV, np.array(textures)])
    corner = st.tuples(st.integers(0, len(positions) - 1), st.integers(0, len(uv) - 1))
    drawn = data.draw(st.lists(st.tuples(corner, corner, corner), max_size=20))
    corners = np.array([*drawn, ((0, 0), (1, 1), (2, 2))])
    arrays = (positions, corners[..., 0], uv, corners[..., 1])
    same_mesh(read_obj(obj(*arrays)), *arrays)


@given(st.randoms(use_true_random=False))
def test_statements_may_interleave_while_each_kind_keeps_its_order(shuffler: random.Random) -> None:
    lines = PLAIN.splitlines()
    kinds = [line.split()[0] for line in lines]
    queues = {kind: iter([x for x in lines if x.split()[0] == kind]) for kind in kinds}
    shuffler.shuffle(kinds)
    mixed = "\n".join(next(queues[kind]) for kind in kinds)
    same_mesh(read_obj(mixed.encode()), *SQUARE_ARRAYS)


USUAL = {
    "plain": PLAIN,
    "normals": PLAIN.replace("1/1", "1/1/1").replace("/2 ", "/2/1 ").replace("3/3", "3/3/2")
    .replace("4/4", "4/4/2"),
    "groups": "# of a program\nmtllib x.mtl\no face\n" + PLAIN.replace("f", "vn 0 0 1\nf"),
    "quads": PLAIN.replace(FIRST + "\nf 1/1 3/3 4/4", FIRST + " 4/4"),
    "ends of lines": PLAIN.replace("\n", "\r\n"),
}  # fmt: skip


@pytest.mark.parametrize("text", USUAL.values(), ids=USUAL)
def test_usual_files_are_not_read_statement_by_statement(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "split_statements", None)
    same_mesh(read_obj(text.encode()), *SQUARE_ARRAYS)
    np.testing.assert_array_equal(read_obj_positions(text.encode()), SQUARE)


def found(data: bytes) -> list[object]:
    """The arrays of a mesh, or what is said of the file."""
    try:
        mesh = read_obj(data)
    except (LimitError, MeshError) as error:
        return [type(error), str(error)]
    return [mesh.positions.tolist(), mesh.faces.tolist(), mesh.uv.tolist(), mesh.face_uv.tolist()]


def positions_found(data: bytes) -> list[object]:
    """The vertices of a file that may have no faces, or what is said of it."""
    try:
        return read_obj_positions(data).tolist()
    except (LimitError, MeshError) as error:
        return [type(error), str(error)]


LINES = st.sampled_from(
    [*PLAIN.splitlines(), *USUAL["normals"].splitlines(), "vn 0 0 1", "v 1 2", "v 1e39 0 0",
     "vt 1e39 0", "f 1/1 -1/2 3/3", "f 1/1 2/2 9/9", "f 1/1 2/2 0/1", "f 1//2 2/2 3/3", "", " ",
     "g", "v", "vt", "f", "x 1", "v 1 0 0 1", "f 1/1 2/2 3/3/3", "v\x0b1 0 0", "vn\x0b1", "vtl 1 2"]
)  # fmt: skip


@given(st.lists(LINES, max_size=4), st.lists(LINES, max_size=3))
def test_together_and_one_by_one_are_the_same(before: list[str], after: list[str]) -> None:
    data = "\n".join([*before, *PLAIN.splitlines(), *after]).encode()
    together = found(data), positions_found(data)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_usual_texts", lambda data: None)
        assert (found(data), positions_found(data)) == together


def test_many_lines_are_matched_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_BYTES_AT_ONCE", 20)
    monkeypatch.setattr(module, "split_statements", None)
    same_mesh(read_obj(PLAIN.encode()), *SQUARE_ARRAYS)


def test_what_is_too_much_is_read_statement_by_statement(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("rhytid.formats.obj.MAX_NUMBERS", "rhytid.formats.limits.MAX_NUMBERS"):
        monkeypatch.setattr(name, 11)
    assert module._usual_mesh(PLAIN.encode()) is None
