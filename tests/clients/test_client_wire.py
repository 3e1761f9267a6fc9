"""Laws of what goes over the wire: forms, mixed answers, event streams, arrays."""

from __future__ import annotations

import io
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from rhytid_client import npy
from rhytid_client.errors import BadAnswer
from rhytid_client.events import Event, EventReader
from rhytid_client.multipart_form import CHUNK, Form, Part
from rhytid_client.multipart_mixed import boundary_of, read_mixed

CONTENT = st.binary(max_size=200) | st.sampled_from([b"\r\n--b", b"--b--\r\n", b"\r\n", b"--b"])


def mixed(contents: list[bytes], counted: bool, preamble: bytes = b"") -> bytes:
    body = preamble
    for i, content in enumerate(contents):
        body += f"--b\r\nX-Part: {i}\r\n".encode()
        body += f"Content-Length: {len(content)}\r\n".encode() if counted else b""
        body += b"\r\n" + content + b"\r\n"
    return body + b"--b--\r\n"


@given(st.lists(CONTENT))
def test_mixed_parts_come_back_whatever_they_hold(contents: list[bytes]) -> None:
    parts = read_mixed(mixed(contents, counted=True), "b")
    assert [bytes(part.content) for part in parts] == contents
    assert [part.headers["x-part"] for part in parts] == [str(i) for i in range(len(contents))]


@given(st.lists(st.binary(max_size=200).filter(lambda c: b"\r\n--b" not in b"\r\n" + c)))
def test_mixed_parts_are_found_by_the_boundary_too(contents: list[bytes]) -> None:
    parts = read_mixed(mixed(contents, counted=False, preamble=b"preamble\r\n"), "b")
    assert [bytes(part.content) for part in parts] == contents


@given(st.lists(st.binary(max_size=50), min_size=1, max_size=3), st.data())
def test_cut_mixed_answer_is_never_read(contents: list[bytes], data: st.DataObject) -> None:
    whole = mixed(contents, counted=True)
    cut = data.draw(st.integers(0, len(whole) - len("--\r\n") - 1))
    with pytest.raises(BadAnswer, match="multipart answer"):
        read_mixed(whole[:cut], "b")


@given(st.binary(max_size=300), st.sampled_from([b"", b"--b\r\n", b"--b\r\nContent-Length: 5\r\n"]))
def test_any_bytes_are_read_or_refused(body: bytes, start: bytes) -> None:
    try:
        parts = read_mixed(start + body, "b")
    except BadAnswer:
        return
    assert sum(len(part.content) for part in parts) <= len(body)


def test_part_without_headers() -> None:
    (part,) = read_mixed(b"--b  \r\n\r\nx\r\n--b--", "b")
    assert (part.headers, bytes(part.content)) == ({}, b"x")


def test_boundary_may_be_quoted() -> None:
    assert boundary_of('multipart/mixed; boundary="a:b c"') == "a:b c"
    assert boundary_of("Multipart/Mixed;boundary=xyz") == "xyz"


# What the value of a field may hold: no end of a line.
LINE = st.text(st.characters(exclude_characters="\r\n", exclude_categories=["Cs"]), max_size=20)


@given(
    st.lists(st.tuples(LINE, st.lists(LINE, min_size=1, max_size=3))),
    st.sampled_from(["\n", "\r", "\r\n"]),
    st.lists(st.integers(0, 400)),
)
def test_events_come_back_in_any_chunking(
    events: list[tuple[str, list[str]]], end: str, cuts: list[int]
) -> None:
    text = ""
    for name, lines in events:
        text += f": comment{end}" + (f"event: {name}{end}" if name else "")
        text += "".join(f"data: {line}{end}" for line in lines) + end
    stream = text.encode()
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    wanted = [Event(name or "message", "\n".join(lines)) for name, lines in events]
    for places in (edges, range(len(stream) + 1)):
        reader = EventReader()
        chunks = [stream[a:b] for a, b in pairwise(places)]
        assert [event for chunk in chunks for event in reader.feed(chunk)] == wanted


def test_event_is_known_before_the_next_byte() -> None:
    assert list(EventReader().feed(b"data:x\r\n\r")) == [Event("message", "x")]


def test_event_without_data_is_none() -> None:
    found = list(EventReader().feed(b"event: a\n\ndata: b\nid: 1\nretry\n\n"))
    assert found == [Event("message", "b")]


DTYPES = st.sampled_from(["<f4", ">f4", "<f2", "<f8", "i1", "<i2", ">i4", "?"])


@given(DTYPES.flatmap(lambda d: arrays(d, array_shapes(min_dims=0, min_side=0, max_side=5))))
def test_npy_roundtrip(array: np.ndarray) -> None:
    for made in (npy.encode(array), npy.encode(array.copy(order="F"))):
        for data in (made, memoryview(made)):
            again = npy.decode(data)
            assert (again.dtype, again.shape) == (array.dtype, array.shape)
            assert again.tobytes() == array.tobytes()


def test_npy_is_not_copied() -> None:
    array = npy.decode(npy.encode(np.zeros((8, 8), np.float32)))
    assert not array.flags.writeable
    assert not array.flags.owndata


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_newer_headers_are_read(version: tuple[int, int]) -> None:
    file = io.BytesIO()
    np.lib.format.write_array(file, np.ones((2, 3), np.float32), version=version)
    assert npy.decode(file.getvalue()).shape == (2, 3)


@given(st.lists(st.binary(max_size=500) | st.just(bytes(CHUNK + 1)), max_size=4))
def test_form_has_the_size_it_says(contents: list[bytes]) -> None:
    parts = tuple(Part(f"p{i}", c, filename='ä"\r\n.obj') for i, c in enumerate(contents))
    told: list[tuple[int, int]] = []
    form = Form(parts, lambda sent, total: told.append((sent, total)))
    chunks = list(form.chunks())
    body = b"".join(chunks)
    assert len(body) == form.size() == int(form.headers()["Content-Length"])
    assert told[-1] == (len(body), len(body))
    assert [sent for sent, _ in told] == np.cumsum([len(chunk) for chunk in chunks]).tolist()
    assert b"".join(form.chunks()) == body


def test_form_reads_a_file_piece_by_piece(tmp_path: Path) -> None:
    mesh = tmp_path / "face.obj"
    mesh.write_bytes(bytes(3 * CHUNK + 5))
    form = Form((Part("mesh", mesh, filename=mesh.name),))
    sizes = [len(chunk) for chunk in form.chunks()]
    assert max(sizes) == CHUNK
    assert sum(sizes) == form.size()


def test_filename_cannot_end_its_header() -> None:
    head = Part("mesh", b"", filename='a"\r\nX-Evil: 1.obj').head()
    assert head.count(b"\r\n") == 3
    assert b'filename="a%22%0D%0AX-Evil: 1.obj"' in head
