"""npz meshes: dtypes, byte orders and layouts; damage, bombs and pickles."""

from __future__ import annotations

import re
import tracemalloc
import zipfile
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats.writers import (
    SQUARE,
    SQUARE_ARRAYS,
    SQUARE_FACES,
    SQUARE_UV,
    archive,
    npy,
    npy_header,
    npz,
    same_mesh,
)
from rhytid.domain.notices import ARRAYS_NOT_READ
from rhytid.domain.warnings import ARRAYS_UNUSED, InputWarning
from rhytid.errors import FrameError, LimitError, MeshError, RhytidError
from rhytid.formats import npz_archive
from rhytid.formats.meshes import read_mesh
from rhytid.formats.npz import read_npz, read_npz_expressions

ARRAYS: dict[str, Any] = {
    "positions": SQUARE,
    "faces": SQUARE_FACES,
    "uv": SQUARE_UV,
    "face_uv": SQUARE_FACES,
}
FRAMES = np.stack([SQUARE, SQUARE * 2, SQUARE - 1])


def changed(**arrays: Any) -> bytes:
    return npz(**{**ARRAYS, **arrays})


def with_member(name: str, data: bytes, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """The plain archive with the bytes of one member replaced."""
    members = {f"{n}.npy": npy(a) for n, a in ARRAYS.items()} | {f"{name}.npy": data}
    return archive(list(members.items()), method)


def test_a_mesh_without_frames() -> None:
    found = read_npz(npz(**ARRAYS))
    same_mesh(found.mesh, *SQUARE_ARRAYS)
    assert found.frames is None
    assert found.shapes is None


def test_the_directory_of_an_archive_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    data, opened = changed(frames=FRAMES, shapes=FRAMES, other=SQUARE), []

    class Counted(zipfile.ZipFile):
        def __init__(self, file: Any) -> None:
            opened.append(file)
            super().__init__(file)

    monkeypatch.setattr(npz_archive.zipfile, "ZipFile", Counted)
    read_mesh(data, "a.npz")
    assert len(opened) == 1


def unread(data: bytes) -> tuple[tuple[InputWarning, ...], tuple[str, ...]]:
    """Warnings and the text of notices of arrays that are not read."""
    found = read_npz(data)
    assert all(notice.code == ARRAYS_NOT_READ for notice in found.notices)
    return found.unused, tuple(notice.detail for notice in found.notices)


def test_arrays_whose_names_are_slips_are_warned_of_and_others_are_noted() -> None:
    every = {"frames": FRAMES, "shapes": FRAMES, "names": np.array(["a", "b", "c"])}
    assert unread(changed(**every)) == ((), ())
    (warning,), (note,) = unread(changed(Shape=FRAMES, fps=np.float32(30)))
    assert warning.code == ARRAYS_UNUSED
    assert warning.detail.startswith("not read: 'Shape' (did you mean shapes?); arrays of a mesh")
    assert note == "the mesh file has arrays that are not read: 'fps'"
    (), (note,) = unread(changed(**{f"v{i:02}": SQUARE for i in range(11)}))
    assert note.endswith("'v07' and 3 more")


def test_longer_words_for_shapes_and_their_names_are_slips() -> None:
    (warning,), _ = unread(changed(blendShapes=FRAMES))
    assert "'blendShapes' (did you mean shapes?)" in warning.detail
    (warning,), _ = unread(changed(shapes=FRAMES, shape_names=np.array(["a", "b", "c"])))
    assert "'shape_names' (did you mean names?)" in warning.detail


def test_a_file_of_shapes_without_any_says_what_may_be_meant() -> None:
    for name in ("shape", "blendshapes"):
        with pytest.raises(FrameError, match=rf"neither.*'{name}' \(did you mean shapes\?\)"):
            read_npz_expressions(npz(**{name: FRAMES}), len(SQUARE))
    assert len(read_npz_expressions(npz(frames=FRAMES), len(SQUARE))) == len(FRAMES)


def test_arrays_of_expressions_by_any_name_say_how_they_are_given() -> None:
    told = r"'expr_deltas' \(3 expressions\? give their positions of all 4 vertices as shapes, "
    (warning,), notes = unread(changed(expr_deltas=FRAMES, expr_names=np.array(["a", "b", "c"])))
    assert warning.code == ARRAYS_UNUSED
    assert re.search(told, warning.detail)
    assert notes == ("the mesh file has arrays that are not read: 'expr_names'",)
    assert unread(changed(expr_deltas=FRAMES, shapes=FRAMES))[0] == ()
    assert unread(changed(velocities=FRAMES, frames=FRAMES)) == (
        (), ("the mesh file has arrays that are not read: 'velocities'",),
    )  # fmt: skip
    assert len(unread(changed(expr_deltas=FRAMES[1:], frames=FRAMES))[0]) == 1
    for other in (FRAMES[:, :3], FRAMES[..., :2], SQUARE, np.array([[["a"]]])):
        assert unread(changed(expr_deltas=other))[0] == ()
    with pytest.raises(FrameError, match=told):
        read_npz_expressions(npz(expr_deltas=FRAMES), len(SQUARE))


def test_shapes_that_are_offsets_are_refused() -> None:
    offsets = np.float32(0.01) * np.arange(SQUARE.size).reshape(1, *SQUARE.shape)
    with pytest.raises(FrameError, match="positions of all vertices, not offsets"):
        read_mesh(changed(shapes=offsets), "a.npz")
    with pytest.raises(FrameError, match="not offsets"):
        read_mesh(changed(shapes=np.concatenate([offsets, 0.0 * offsets])), "a.npz")
    assert len(read_mesh(changed(shapes=SQUARE + offsets), "a.npz").shapes or ()) == 1
    one = np.concatenate([offsets, SQUARE[None]])
    assert len(read_mesh(changed(shapes=one), "a.npz").shapes or ()) == 2


def test_slips_are_looked_for_in_few_short_names() -> None:
    far = {f"v{i:04}": SQUARE for i in range(1000)}
    warnings, (note,) = unread(changed(**far, frame=FRAMES))
    assert warnings == ()
    assert note.endswith("'v0007' and 993 more")
    warnings, (note,) = unread(changed(**{"x" * 300 + "shapes": FRAMES}))
    assert warnings == ()
    assert note.endswith("'" + "x" * 39)


def test_names_of_other_programs_are_no_slips() -> None:
    theirs = "quads", "quads_uv", "expr_names", "expr_deltas", "units", "landmarks", "weights"
    warnings, (note,) = unread(changed(**dict.fromkeys(theirs, SQUARE)))
    assert warnings == ()
    assert all(f"'{name}'" in note for name in theirs)


def test_names_like_those_of_arrays_that_are_there_are_no_slips() -> None:
    beside = dict.fromkeys(("uv2", "face_uv2", "positions_world", "frames2", "face"), SQUARE)
    warnings, (note,) = unread(changed(frames=FRAMES, **beside))
    assert warnings == ()
    assert all(f"'{name}'" in note for name in beside)
    (warning,), _ = unread(changed(**beside))
    assert "not read: 'frames2' (did you mean frames?); " in warning.detail


def test_an_animation_with_frames_and_neutral_in_place_of_positions() -> None:
    others = {"names": np.array(["a", "bc"]), "fps": np.float32(30), "any": np.array([None])}
    arrays = {name: array for name, array in ARRAYS.items() if name != "positions"}
    found = read_npz(npz(neutral=SQUARE, frames=FRAMES, **others, **arrays))
    frames = found.frames
    same_mesh(found.mesh, *SQUARE_ARRAYS)
    assert frames is not None
    assert (frames.dtype, frames.flags.writeable) == (np.float32, False)
    np.testing.assert_array_equal(frames, FRAMES)


@pytest.mark.parametrize("real", ["<f2", ">f2", "<f4", ">f4", "<f8", ">f8", "<i2", ">u4"])
@pytest.mark.parametrize("whole", ["|i1", "|u1", "<i2", ">u2", "<u4", ">i8", "<u8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_every_dtype_byte_order_and_layout(real: str, whole: str, order: Any) -> None:
    points = np.array([[0, 0, 1], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    faces = np.asarray(SQUARE_FACES.astype(whole), order=order)
    positions, uv = (np.asarray(a.astype(real), order=order) for a in (points, points[:, :2]))
    frames = np.asarray((FRAMES > 0).astype(real), order=order)
    data = npz(positions=positions, faces=faces, uv=uv, face_uv=faces, frames=frames)
    found = read_npz(data)
    mesh, read = found.mesh, found.frames
    same_mesh(mesh, points, SQUARE_FACES, points[:, :2], SQUARE_FACES)
    np.testing.assert_array_equal(read, FRAMES > 0)


def test_stored_and_deflated_members_and_later_header_versions() -> None:
    header = b"{'shape':(4,3),'fortran_order':False,'descr':'<f4'}"
    for version in (b"\x02", b"\x03"):
        member = b"\x93NUMPY" + version + b"\0" + len(header).to_bytes(4, "little")
        data = with_member("positions", member + header + SQUARE.tobytes(), zipfile.ZIP_STORED)
        same_mesh(read_npz(data).mesh, *SQUARE_ARRAYS)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a readable .npz"),
        (b"PK\x05\x06", "not a readable .npz"),
        (npz(**ARRAYS)[:-30], "not a readable .npz"),
        (npz(faces=SQUARE_FACES), "archive has no 'positions'; it has 'faces'"),
        (npz(**{f"x{i}": [0] for i in range(50)}), "it has 'x0', .*'x9', …"),
        (changed(neutral=SQUARE), "both 'positions' and 'neutral'"),
        (changed(positions=SQUARE.astype(complex)), "positions holds complex numbers"),
        (changed(positions=SQUARE.astype(object)), r"positions holds Python objects \(a pickle\)"),
        (changed(positions=SQUARE.astype("U5")), "positions holds text"),
        (changed(positions=SQUARE.astype("S5")), "positions holds text"),
        (changed(positions=SQUARE > 0), "positions holds truth values"),
        (changed(positions=SQUARE.astype("M8[s]")), "positions holds dates"),
        (changed(positions=SQUARE.view([("x", "f4", 3)])), "positions holds records"),
        (changed(faces=SQUARE_FACES.astype(float)), "faces has dtype float64, not int64"),
        (changed(faces=SQUARE_FACES[:, :2]), r"faces has shape \(2, 2\), not \(N, 3\)"),
        (changed(faces=SQUARE_FACES + 1), r"faces 1 is \[1, 3, 4\]: indices go from 0 to 3"),
        (changed(faces=SQUARE_FACES - 1), r"faces 0 is \[-1, 0, 1\]"),
        (changed(faces=SQUARE_FACES.astype("i8") + 2**32), "faces 0 is"),
        (changed(face_uv=SQUARE_FACES + 1), "face_uv 1 is"),
        (changed(face_uv=SQUARE_FACES[:1]), "2 faces but 1 row of face_uv"),
        (changed(positions=SQUARE + np.inf), "position 0 is .*not finite as float32"),
        (changed(positions=SQUARE.astype(float) * 1e39), "position 0 is .*not finite as float32"),
        (changed(uv=SQUARE_UV * np.nan), "uv 0 is .*not finite"),
        (changed(uv=SQUARE_UV * 1000), r"uv 0 is \[100.0, 200.0\]: beyond"),
        (changed(uv=SQUARE_UV[:, :1]), r"uv has shape \(4, 1\), not \(N, 2\)"),
        (changed(positions=SQUARE * 0), "no triangle has area"),
        (with_member("uv", b""), "uv is not a .npy array"),
        (with_member("uv", b"not an array at all"), "uv is not a .npy array"),
        (with_member("uv", b"\x93NUMPY\x09\0\0\0"), "uv is not a .npy array of version 1, 2 or 3"),
        (with_member("uv", npy(SQUARE_UV)[:20]), "uv ends inside its .npy header"),
        (
            with_member("uv", npy(SQUARE_UV)[:-1]),
            "uv: the header promises 192 bytes, there are 191",
        ),
        (with_member("uv", npy(SQUARE_UV) + b"\0"), "promises 192 bytes, there are 193"),
        (with_member("uv", npy_header("x" * 20_000)), "header is 20011 bytes: at most 10000"),
        (with_member("uv", npy_header("{'descr': 1 +")), "header cannot be read"),
        (with_member("uv", npy_header("__import__('os')")), "header cannot be read"),
        (with_member("uv", npy_header("(" * 5000)), "header cannot be read"),
        (with_member("uv", npy_header("[1, 2]")), "must hold descr, fortran_order and shape"),
        (with_member("uv", npy_header("{'descr': '<f4'}")), "must hold descr, fortran_order and"),
    ],
)
def test_refused(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_npz(data)


@pytest.mark.parametrize(
    ("descr", "fortran_order", "shape", "message"),
    [
        ("'<f4'", "False", "(4, -2)", r"shape \(4, -2\)"),
        ("'<f4'", "False", "(4, 2.0)", r"shape \(4, 2.0\)"),
        ("'<f4'", "False", "(True, 2)", r"shape \(True, 2\)"),
        ("'<f4'", "False", "[4, 2]", r"shape \[4, 2\]"),
        ("'<f4'", "False", "(1,) * 9", "cannot be read"),
        ("'<f4'", "False", "(1, 1, 1, 1, 1)", "shape"),
        ("'<f4'", "False", "(0, 1000000000000000)", "shape"),
        ("'<f4'", "0", "(4, 2)", "fortran_order 0"),
        ("'f1'", "False", "(4, 2)", "'f1', which does not exist"),
        ("'<i16'", "False", "(4, 2)", "'<i16', which does not exist"),
        ("'float64'", "False", "(4, 2)", "only integers and real numbers"),
        ("'<f8,<f8'", "False", "(4, 2)", "only integers and real numbers"),
        ("'|O'", "False", "(4, 2)", "Python objects"),
        ("'|V8'", "False", "(4, 2)", "records"),
        ("['<f8']", "False", "(4, 2)", "records"),
        ("'<f8'", "False", "(5, 2)", "promises 1.. bytes"),
    ],
)
def test_headers_that_promise_something_else(
    descr: str, fortran_order: str, shape: str, message: str
) -> None:
    header = f"{{'descr': {descr}, 'fortran_order': {fortran_order}, 'shape': {shape}}}"
    with pytest.raises(MeshError, match=f"^uv.*{message}"):
        read_npz(with_member("uv", npy_header(header) + SQUARE_UV.tobytes()))


def test_a_header_beyond_the_limit_allocates_nothing() -> None:
    header = npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 1000)}")
    with pytest.raises(LimitError, match="uv holds 1000000000000 numbers: at most 50000000"):
        read_npz(with_member("uv", header))


def test_a_bomb_is_judged_by_its_header_and_not_unpacked() -> None:
    bomb = npy(np.zeros(60_000_000, np.uint8))
    with pytest.raises(LimitError, match="uv holds 60000000 numbers: at most 50000000"):
        read_npz(with_member("uv", bomb))
    bomb = with_member("uv", npy(SQUARE_UV) + bytes(100_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(MeshError, match="promises 192 bytes, there are 100000192"):
            read_npz(bomb)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_a_member_that_lies_about_its_length() -> None:
    data = with_member("uv", npy(SQUARE_UV), zipfile.ZIP_STORED)
    promise = (192).to_bytes(4, "little")
    longer = data.replace(promise, (193).to_bytes(4, "little"))
    with pytest.raises(MeshError, match="uv"):
        read_npz(longer)
    cut = with_member("uv", npy(SQUARE_UV)[:-1]).replace((191).to_bytes(4, "little"), promise)
    with pytest.raises(MeshError, match="uv: the header promises 192 bytes, there are 191"):
        read_npz(cut)


def test_frames_are_aligned_wherever_they_lie_in_their_member() -> None:
    for spaces in range(4):
        header = f"{' ' * spaces}{{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 3)}}"
        data = with_member("frames", npy_header(header) + FRAMES.tobytes())
        frames = read_npz(data).frames
        assert frames is not None
        assert frames.flags.aligned
        np.testing.assert_array_equal(frames, FRAMES)


def test_repeated_members() -> None:
    pairs = [(f"{name}.npy", npy(array)) for name, array in ARRAYS.items()]
    with pytest.warns(UserWarning, match="Duplicate name"):
        twice = archive([*pairs, pairs[0]])
    for data in (twice, archive([*pairs, ("positions", npy(SQUARE))])):
        with pytest.raises(MeshError, match="holds 'positions' more than once"):
            read_npz(data)


def test_packings_that_are_not_read() -> None:
    data = with_member("positions", npy(SQUARE), zipfile.ZIP_BZIP2)
    with pytest.raises(MeshError, match="positions is packed by method 12"):
        read_npz(data)
    data = bytearray(npz(**ARRAYS))
    at = data.find(b"PK\x01\x02")
    data[at + 8] |= 1  # the flag of encryption
    with pytest.raises(MeshError, match="positions cannot be unpacked"):
        read_npz(bytes(data))


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (FRAMES[:, :3], r"frames have shape \(3, 3, 3\), not \(N, 4, 3\)"),
        (SQUARE, r"frames have shape \(4, 3\), not \(N, 4, 3\)"),
        (FRAMES + np.array([0, np.nan, 0])[:, None, None], "frame 0002, vertex 0"),
        (FRAMES.astype(float) * 1e39, "frame 0001, vertex 0 is .*inf.*: not finite as float32"),
    ],
)
def test_refused_frames(frames: Any, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        read_npz(changed(frames=frames))


def test_pickled_frames_are_refused() -> None:
    with pytest.raises(MeshError, match="frames holds Python objects"):
        read_npz(changed(frames=FRAMES.astype(object)))


@given(st.data())
def test_a_damaged_archive_is_read_or_refused_and_nothing_else(data: st.DataObject) -> None:
    damaged = bytearray(changed(frames=FRAMES))
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    with suppress(RhytidError):
        read_npz(bytes(damaged))
