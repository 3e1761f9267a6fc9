"""Reading multipart bodies, whatever the chunks."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.exceptions import HTTPException

from rhytid.api.multipart import MixedPart, write
from rhytid.api.parts import HEADER_LIMIT, MOST_REPEATED, Part, PartReader, boundary
from rhytid.errors import InputError, LimitError

NAMED = b'Content-Disposition: form-data; name="%s"'
FILE = NAMED + b'; filename="%s"\r\nContent-Type: model/obj'


def body(*parts: tuple[bytes, bytes]) -> bytes:
    joined = b"".join(b"--xyz\r\n" + head + b"\r\n\r\n" + data + b"\r\n" for head, data in parts)
    return joined + b"--xyz--\r\n"


def read(data: bytes, size: int = 1 << 20) -> dict[str, Part]:
    reader = PartReader(b"xyz")
    for start in range(0, len(data), size):
        reader.feed(data[start : start + size])
    return reader.finish()


@given(st.binary(max_size=80), st.binary(max_size=80), st.integers(1, 40))
def test_parts_survive_any_cut(mesh: bytes, graph: bytes, size: int) -> None:
    sent = body((FILE % (b"mesh", "kö.obj".encode()), mesh), (NAMED % b"graph", graph))
    if b"\r\n--xyz" in mesh or b"\r\n--xyz" in graph:
        return
    found = read(sent, size)
    assert found == {"mesh": Part("mesh", "kö.obj", mesh), "graph": Part("graph", None, graph)}


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"", "before its closing boundary"),
        (body((NAMED % b"mesh", b"v"))[:-6], "before its closing boundary"),
        (body((NAMED % b"mesh", b"v"))[:40], "before its closing boundary"),
        (b"hello there", "multipart body"),
        (body((b"Content-Type: model/obj", b"v")), "no name"),
        (body((NAMED % b"mesh" + b"; x=" + b"y" * HEADER_LIMIT, b"v")), "header"),
        (body((NAMED % b"../etc", b"v")), "unknown part '../etc'"),
    ],
)
def test_malformed_bodies_are_refused(data: bytes, what: str) -> None:
    with pytest.raises(InputError, match=what):
        read(data)


def test_a_repeated_part_keeps_its_order_and_has_a_limit() -> None:
    name = FILE % (b"stiffness", b"a")
    sent = [(name, str(i).encode()) for i in range(MOST_REPEATED)]
    first = read(body(*sent))["stiffness"]
    assert [part.data for part in (first, *first.again)] == [data for _, data in sent]
    with pytest.raises(LimitError, match="part stiffness was sent 513 times: at most 512"):
        read(body(*sent, (name, b"one more")))


def test_the_boundary_is_read_from_the_content_type() -> None:
    assert boundary('multipart/form-data; boundary="a b"') == b"a b"
    for wrong in ("", "; boundary=", "; boundary=" + 71 * "x"):
        with pytest.raises(InputError, match="1 to 70 characters"):
            boundary("multipart/form-data" + wrong)
    with pytest.raises(HTTPException, match="text/plain"):
        boundary("text/plain")


def test_mixed_parts_are_written_as_rfc_2046_has_it() -> None:
    parts = [MixedPart({"Content-Type": "a/b"}, b"\r\n--"), MixedPart({}, b"")]
    assert write(parts, "xyz") == (
        b"--xyz\r\nContent-Type: a/b\r\nContent-Length: 4\r\n\r\n\r\n--\r\n"
        b"--xyz\r\nContent-Length: 0\r\n\r\n\r\n--xyz--\r\n"
    )
