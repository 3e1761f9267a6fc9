"""Reading multipart bodies, whatever the chunks."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.exceptions import HTTPException

from rhytid.api.multipart import (
    HEADER_LIMIT,
    MOST_REPEATED,
    MixedPart,
    Part,
    PartReader,
    boundary,
    write,
)
from rhytid.api.spool import PIECE, Spool
from rhytid.engine.byte_budget import ByteBudget
from rhytid.errors import HostBusyError, InputError, LimitError, StorageError

NAMED = b'Content-Disposition: form-data; name="%s"'
FILE = NAMED + b'; filename="%s"\r\nContent-Type: model/obj'


def body(*parts: tuple[bytes, bytes]) -> bytes:
    joined = b"".join(b"--xyz\r\n" + head + b"\r\n\r\n" + data + b"\r\n" for head, data in parts)
    return joined + b"--xyz--\r\n"


def read(data: bytes, size: int = 1 << 20) -> dict[str, Part]:
    reader = PartReader(b"xyz", Spool())
    for start in range(0, len(data), size):
        reader.feed(data[start : start + size])
    return reader.finish()


@given(st.binary(max_size=80), st.binary(max_size=80), st.integers(1, 40))
def test_parts_survive_any_cut(mesh: bytes, graph: bytes, size: int) -> None:
    sent = body((FILE % (b"mesh", "kö.obj".encode()), mesh), (NAMED % b"graph", graph))
    if b"\r\n--xyz" in mesh or b"\r\n--xyz" in graph:
        return
    found = read(sent, size)
    assert {name: (part.name, part.filename, part.data) for name, part in found.items()} == {
        "mesh": ("mesh", "kö.obj", mesh),
        "graph": ("graph", None, graph),
    }


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


@given(st.lists(st.binary(max_size=9), max_size=30), st.integers(1, 8))
def test_a_spool_reads_what_was_written_wherever_it_is(written: list[bytes], piece: int) -> None:
    """piece: thousands of bytes that stand for each."""
    whole, spool = b"", Spool(ByteBudget(1 << 40, "X").hold("uploads"))
    for data in written:
        much = data * 1000 * piece * (PIECE // 40000)
        whole += much
        spool.write(much)
        asyncio.run(spool.settle())
    ends = sorted({0, len(whole), len(whole) // 2, len(whole) // 3})
    for start in ends:
        for end in ends:
            size = max(end - start, 0)
            assert spool.read(start, size) == whole[start : start + size]
    spool.close()


def test_a_spool_is_counted_and_waits_for_room_no_longer_than_it_must(tmp_path: Path) -> None:
    budget = ByteBudget(2 * PIECE, "RHYTID_SPOOL_MB", patience=0.02)
    one, two = (Spool(budget.hold("uploads"), tmp_path) for _ in range(2))
    one.write(bytes(2 * PIECE))
    asyncio.run(one.settle())
    assert budget.used == 2 * PIECE
    two.write(bytes(PIECE))
    with pytest.raises(HostBusyError, match="RHYTID_SPOOL_MB"):
        asyncio.run(two.settle())
    one.close()
    assert budget.used == 0
    assert list(tmp_path.iterdir()) == []


def test_a_spool_without_a_folder_to_write_to_is_an_error_of_the_store(tmp_path: Path) -> None:
    spool = Spool(ByteBudget(1 << 30, "X").hold("uploads"), tmp_path / "missing")
    spool.write(bytes(PIECE))
    with pytest.raises(StorageError, match="cannot be written to disk"):
        asyncio.run(spool.settle())


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
