"""Encoded answers are made once for all who ask, and leave memory when others need it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from rhytid.api import encoding
from rhytid.api.encoded_tiles import EncodedTiles
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.errors import QueryError
from rhytid.formats.tiles import Encoded, encode

PATIENCE = 20.0


def made(body: bytes, calls: list[bytes]) -> Callable[[], Encoded]:
    def make() -> Encoded:
        calls.append(body)
        return Encoded(body, "image/png", ".png")

    return make


def tiles(limit: int = 6400) -> tuple[EncodedTiles, ByteBudget]:
    budget = ByteBudget(limit, "RHYTID_HOST_MEMORY_MB", 0.1)
    return EncodedTiles(budget), budget


def test_an_answer_is_made_once() -> None:
    kept, budget = tiles()
    calls: list[bytes] = []

    found = [kept.get(tag, made(tag.encode(), calls)).body for tag in ("a", "b", "a", "a")]

    assert found == [b"a", b"b", b"a", b"a"]
    assert calls == [b"a", b"b"]
    assert budget.used_for("encoded") == 2


def test_who_asks_meanwhile_gets_the_same() -> None:
    kept, _ = tiles()
    asked, found, begun = threading.Event(), [], threading.Barrier(5)

    def make() -> Encoded:
        begun.wait(PATIENCE)
        time.sleep(0.1)  # the others ask now
        assert not asked.is_set()
        asked.set()
        return Encoded(b"x", "image/png", ".png")

    def ask() -> None:
        begun.wait(PATIENCE)
        found.append(kept.get("a", make))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    found.append(kept.get("a", make))
    for thread in threads:
        thread.join()
    assert len(found) == 5
    assert all(one is found[0] for one in found)


def test_what_fails_is_made_again() -> None:
    kept, budget = tiles()

    def fail() -> Encoded:
        raise QueryError("no")

    for _ in range(2):
        with pytest.raises(QueryError):
            kept.get("a", fail)
    assert kept.get("a", made(b"x", [])).body == b"x"
    assert budget.used == 1


def test_nobody_waits_for_an_answer_that_cannot_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, budget = tiles()

    def fails(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as given:
        given.setattr(budget, "taken", fails)
        with pytest.raises(MemoryError):
            kept.get("a", made(b"a", []))
    assert kept.get("a", made(b"a", [])).body == b"a"


def test_what_was_used_longest_ago_leaves_first() -> None:
    kept, budget = tiles()
    calls: list[bytes] = []
    bodies = [bytes([n]) * 200 for n in range(20)]  # 200 is the largest that is kept
    for body in bodies:
        kept.get(str(body[0]), made(body, calls))
        kept.get("0", made(bodies[0], calls))

    assert budget.used_for("encoded") == 3200  # half of the budget
    assert len(calls) == len(bodies)  # the first was asked for again and again
    calls.clear()
    for n in (0, 19, 18, 1):
        kept.get(str(n), made(bodies[n], calls))
    assert calls == [bodies[1]]


def test_large_answers_are_not_kept() -> None:
    kept, budget = tiles()
    calls: list[bytes] = []
    for _ in range(2):
        kept.get("a", made(bytes(201), calls))

    assert (len(calls), budget.used) == (2, 0)


def test_they_leave_when_a_request_waits_for_memory() -> None:
    kept, budget = tiles()
    kept.get("a", made(bytes(200), []))

    budget.hold("answers").grow(6300)

    assert budget.used == 6300
    calls: list[bytes] = []
    kept.get("a", made(bytes(200), calls))
    assert (len(calls), budget.used) == (1, 6300)


def test_who_begins_to_wait_while_one_is_kept_gets_its_bytes() -> None:
    budget = ByteBudget(6400, "RHYTID_HOST_MEMORY_MB", 1.0)
    kept = EncodedTiles(budget)
    held, cleared = budget.hold("answers"), threading.Event()
    asking = threading.Thread(target=held.grow, args=(6400,))
    take, clear = budget.taken, budget.on_shortage

    def taken(purpose: str, nbytes: int) -> Hold | None:
        found = take(purpose, nbytes)
        asking.start()
        cleared.wait(0.1)  # not while the answer is being kept
        return found

    def clearing() -> None:
        clear()
        cleared.set()

    budget.taken, budget.on_shortage = taken, clearing  # type: ignore[method-assign]
    kept.get("a", made(bytes(200), []))
    asking.join()

    assert (held.nbytes, budget.used) == (6400, 6400)


@pytest.mark.parametrize(("format", "times"), [("exr", 1), ("exr16", 1), ("png", 1), ("npy", 3)])
def test_a_tile_is_encoded_once(
    format: str, times: int, client: httpx.Client, frame: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def counted(tile: Any, format: str, header: Any) -> Encoded:
        calls.append(format)
        return encode(tile, format, header)

    monkeypatch.setattr(encoding, "encode", counted)
    path = f"{frame}/tiles/1001/0/3/3"
    found = [client.get(path, params={"format": format}).content for _ in range(3)]

    assert found[0] == found[1] == found[2]
    assert calls == [format] * times
    client.get(f"{frame}/tiles/1001/0/3/2", params={"format": format})
    assert len(calls) == times + 1
