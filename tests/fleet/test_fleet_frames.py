"""Frames between a replica and the board: each has what the other knows, and nothing comes back
that was removed."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rhytid.errors import DeviceLostError, FrameMemoryError, NotFoundError
from rhytid.fleet import frame_sync
from rhytid.fleet.frame_registry import FrameRegistry
from rhytid.fleet.frame_sync import FrameSync
from rhytid.fleet.frame_versions import MOST, FrameVersions, Removals

ASSET, OTHER, THIRD = "0123456789abcdef", "1" * 16, "2" * 16
POSITIONS = np.ones((4, 3), np.float32)
ROOM = 1 << 20


def _result(answer: Any) -> Any:
    """Of a coroutine that waits for nothing."""
    try:
        answer.send(None)
    except StopIteration as ended:
        return ended.value
    raise AssertionError("it waits")


class LocalBoard:
    """The board in this process, which may not answer.

    asked: how often it was asked for versions.
    """

    def __init__(self) -> None:
        self.board, self.limit = FrameRegistry(), ROOM
        self.asked, self.answers, self.given = 0, True, 0

    def start_again(self) -> None:
        self.board = FrameRegistry()

    def __getattr__(self, name: str) -> Any:
        def ask(*arguments: Any) -> Any:
            self.asked += name == "versions"
            self.given += name == "give"
            if not self.answers:
                raise DeviceLostError("away")
            if name in ("keep", "give"):
                before, after = arguments[: 3 + (name == "give")], arguments[3 + (name == "give") :]
                arguments = (*before, self.limit, *after)
            return _result(getattr(self.board, name)(*arguments))

        return ask

    def put(self, name: str, positions: Any = POSITIONS, asset: str = ASSET) -> int:
        """A frame came through another replica; its version."""
        return int(self.keep(asset, name, positions, 0).version)

    def names(self, asset: str = ASSET) -> set[str]:
        """Of the frames that it has."""
        return {
            name
            for name, kept in self.board._frames.get(asset, {}).items()
            if kept.positions is not None
        }


class OneEngine:
    """Frames of a replica.  most: that it has room for."""

    def __init__(self, most: int = 1000) -> None:
        self.has: dict[tuple[str, str], Any] = {}
        self.most, self.lost = most, False

    def put(self, asset: str, name: str, positions: Any) -> None:
        if len(self.has) >= self.most:
            raise FrameMemoryError("full")
        self.has[asset, name] = positions

    def delete(self, asset: str, name: str) -> None:
        if self.lost:
            raise DeviceLostError("the process of the device was restarted")
        if self.has.pop((asset, name), None) is None:
            raise NotFoundError(name)

    def positions(self, asset: str, name: str) -> Any:
        return self.has[asset, name]

    def all(self, asset: str) -> list[Any]:
        return [SimpleNamespace(name=name) for one, name in self.has if one == asset]

    def names(self, asset: str = ASSET) -> set[str]:
        return {name for one, name in self.has if one == asset}


class Replica:
    """An engine, and its frames kept in step with the board."""

    def __init__(self, board: Any) -> None:
        self.engine: Any = OneEngine()
        self.sync = FrameSync(self.engine, board)

    def put(self, name: str, positions: Any = POSITIONS, asset: str = ASSET) -> int:
        with self.sync.changing(asset):
            self.engine.put(asset, name, positions)
            return self.sync.keep(asset, name, positions)

    def remove(self, name: str, asset: str = ASSET) -> int:
        self.sync.bring(asset, name, 0)
        with self.sync.changing(asset):
            return self.sync.remove(asset, name)

    def remove_asset(self, asset: str = ASSET) -> None:
        """The engine has it no more, and none of its frames."""
        for name in self.engine.names(asset):
            self.engine.delete(asset, name)
        self.sync.remove_all(asset)
        self.sync.forget(asset)

    def shows(self, name: str, asset: str = ASSET) -> bool:
        """Whether a caller finds the frame here."""
        self.sync.bring(asset, name, 0)
        return (asset, name) in self.engine.has


@pytest.fixture
def board() -> Any:
    return LocalBoard()


@pytest.fixture
def first(board: Any) -> Replica:
    return Replica(board)


@pytest.fixture
def second(board: Any) -> Replica:
    return Replica(board)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was found a moment ago is asked for again."""
    monkeypatch.setattr(frame_sync, "FRESH", 0.0)


def test_a_frame_is_fetched_once_and_when_it_is_newer(
    board: Any, first: Replica, monkeypatch: pytest.MonkeyPatch
) -> None:
    version = board.put("a")
    first.sync.bring(ASSET, "a", 0)
    first.sync.bring(ASSET, "a", version)
    assert (first.engine.names(), board.asked) == ({"a"}, 1)
    newer = board.put("a", 2 * POSITIONS)
    first.sync.bring(ASSET, "a", version)
    assert first.engine.has[ASSET, "a"][0, 0] == 1, "what was found is taken for a second"
    first.sync.bring(ASSET, "a", newer)
    assert first.engine.has[ASSET, "a"][0, 0] == 2
    board.remove(ASSET, "a", 0)
    monkeypatch.setattr(frame_sync, "FRESH", 0.0)
    first.sync.bring(ASSET, "a", 0)
    assert first.engine.has == {}
    board.put("b")
    first.sync.bring_all(ASSET)
    assert first.engine.names() == {"b"}


def test_without_a_board_frames_are_as_they_are_here(
    board: Any, first: Replica, at_once: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    version = first.put("a")
    board.answers = False
    first.sync.bring(ASSET, "a", version)
    with pytest.raises(DeviceLostError):
        first.sync.bring(ASSET, "a", version + 1)
    with pytest.raises(DeviceLostError):
        first.sync.bring_all(ASSET)
    first.sync.bring(ASSET, "neutral", 0)
    assert board.asked == 1, "the others need not wait for it"
    monkeypatch.setattr(frame_sync, "AWAY", 0.0)
    board.answers = True
    newer = board.put("a", 2 * POSITIONS)
    first.sync.bring(ASSET, "a", newer)
    assert first.engine.has[ASSET, "a"][0, 0] == 2


def test_calls_for_one_frame_ask_the_board_once(board: Any, first: Replica) -> None:
    version = board.put("a")
    with ThreadPoolExecutor(4) as pool:
        with first.sync.changing(ASSET):
            bringing = [pool.submit(first.sync.bring, ASSET, "a", version) for _ in range(4)]
            time.sleep(0.1)
        for one in bringing:
            one.result(10)
    assert board.asked == 1


def test_a_frame_without_room_on_the_board_is_refused(board: Any, first: Replica) -> None:
    first.put("a")
    board.limit = 0
    with pytest.raises(FrameMemoryError, match=r"frame a of .* does not fit"):
        first.put("a", 2 * POSITIONS)
    assert first.shows("a")
    assert first.engine.has[ASSET, "a"][0, 0] == 1


def test_frames_of_assets_that_nobody_uses_make_room(
    board: Any, first: Replica, monkeypatch: pytest.MonkeyPatch
) -> None:
    first.engine.most = 2
    board.put("a")
    board.put("c", asset=THIRD)
    first.sync.bring(ASSET, "a", 0)
    board.answers = False
    with pytest.raises(DeviceLostError):
        first.put("local", asset=OTHER)
    board.answers = True
    with pytest.raises(FrameMemoryError, match="full"):
        first.sync.bring(THIRD, "c", 0)
    monkeypatch.setattr(frame_sync, "IDLE", -1.0)
    first.sync.bring(THIRD, "c", 0)
    assert set(first.engine.has) == {(OTHER, "local"), (THIRD, "c")}, "the board lacks the first"
    first.sync.bring(ASSET, "a", 0)
    assert set(first.engine.has) == {(OTHER, "local"), (ASSET, "a")}, "what went comes again"


def test_a_new_board_is_given_every_frame(board: Any, first: Replica, second: Replica) -> None:
    versions = {name: first.put(name, number * POSITIONS) for number, name in enumerate("abc")}
    first.sync.exchange()
    assert not first.sync.only_here(ASSET)
    board.start_again()
    assert board.names() == set()
    first.sync.exchange()
    assert (board.names(), board.given) == (set("abc"), 3)
    assert board.versions(ASSET) == versions
    first.sync.exchange()
    assert board.given == 3, "each is given once"
    second.sync.bring(ASSET, "c", versions["c"])
    assert second.engine.has[ASSET, "c"][0, 0] == 2, "the replica may end now"


def test_the_latest_of_two_replicas_is_kept(board: Any, first: Replica, second: Replica) -> None:
    first.put("a")
    assert second.shows("a")
    newest = first.put("a", 2 * POSITIONS)
    for order in ((first, second), (second, first)):
        board.start_again()
        for replica in order:
            replica.sync.exchange()
        stamp, positions = board.frame(ASSET, "a")
        assert (stamp.version, positions[0, 0]) == (newest, 2)


def test_a_board_takes_nothing_that_is_older(board: Any) -> None:
    """Between what it said that it lacks and what it is given, others may come."""
    kept, removed = board.put("a"), board.remove(ASSET, "b", 0)
    board.forget(OTHER, 0)
    for asset, name, version in (
        (ASSET, "a", kept - 1),
        (ASSET, "b", removed - 1),
        (OTHER, "c", 5),
    ):
        assert board.give(asset, name, version, 5 * POSITIONS)
    assert board.frame(ASSET, "a")[1][0, 0] == 1
    assert (board.names(), board.names(OTHER)) == ({"a"}, set())


def test_what_comes_while_a_board_starts_is_newer_than_what_it_is_given(
    board: Any, first: Replica, second: Replica
) -> None:
    first.put("a")
    assert second.shows("a")
    board.start_again()
    newest = first.put("a", 3 * POSITIONS)
    second.sync.exchange()
    assert board.versions(ASSET) == {"a": newest}


def test_a_clock_that_is_behind_makes_no_older_versions(
    board: Any, first: Replica, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = first.put("a")
    first.sync.exchange()
    board.start_again()
    monkeypatch.setattr("rhytid.fleet.frame_registry.time.time_ns", lambda: 1000)
    assert first.put("a", 2 * POSITIONS) > before
    first.sync.exchange()
    assert board.put("b") > before
    assert first.remove("a") > before


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_removed_frame_does_not_come_back_with_a_new_board(
    board: Any, first: Replica, second: Replica, order: tuple[int, int]
) -> None:
    """The second replica has it still: nobody asked it meanwhile."""
    first.put("a")
    first.put("b")
    assert second.shows("a")
    first.remove("a")
    board.start_again()
    for number in order:
        (first, second)[number].sync.exchange()
    assert board.names() == {"b"}
    second.sync.exchange()
    assert second.engine.names() == set()


def test_a_removed_frame_does_not_come_back_when_its_replica_ends_first(
    board: Any, first: Replica, second: Replica
) -> None:
    first.put("a")
    assert second.shows("a")
    first.remove("a")
    second.sync.exchange()
    assert second.engine.names() == set(), "it is dropped without being asked for"
    late = Replica(board)  # in place of the first, which has ended
    late.sync.exchange()
    board.start_again()
    late.sync.exchange()
    second.sync.exchange()
    assert (board.names(), second.shows("a"), late.shows("a")) == (set(), False, False)


@pytest.mark.parametrize("answers", [True, False])
def test_frames_of_a_removed_asset_do_not_come_back(
    board: Any, first: Replica, second: Replica, answers: bool
) -> None:
    """Its id is that of its content: it may be sent again."""
    first.put("a")
    assert second.shows("a")
    first.sync.exchange()
    board.answers = answers
    first.remove_asset()
    board.answers = True
    first.sync.exchange()
    assert board.names() == set()
    board.start_again()
    second.sync.exchange()
    first.sync.exchange()
    assert board.names() == set()
    version = first.put("b")
    second.sync.exchange()
    assert second.engine.names() == set()
    assert board.versions(ASSET) == {"b": version}


def test_a_frame_that_the_board_did_not_take_is_given_later(board: Any, first: Replica) -> None:
    first.put("a")
    first.sync.exchange()
    board.answers = False
    with pytest.raises(DeviceLostError):
        first.put("a", 2 * POSITIONS)
    board.answers = True
    assert first.sync.only_here(ASSET)
    first.sync.exchange()
    _, positions = board.frame(ASSET, "a")
    assert positions[0, 0] == 2
    assert not first.sync.only_here(ASSET)


def test_a_removal_that_fails_half_way_is_a_removal_or_none(
    board: Any, first: Replica, at_once: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_sync, "AWAY", 0.0)
    first.put("a")
    board.answers = False
    with pytest.raises(DeviceLostError):
        first.remove("a")
    board.answers = True
    assert first.shows("a")
    first.engine.lost = True
    with pytest.raises(DeviceLostError):
        first.remove("a")
    first.engine.lost = False
    assert not first.shows("a")


def test_a_frame_that_the_engine_stores_later_is_given_later(board: Any, first: Replica) -> None:
    """Frames that come with an upload, while the asset is built."""
    with first.sync.changing(ASSET):
        first.sync.keep(ASSET, "0000", POSITIONS)
    board.start_again()
    first.sync.exchange()
    assert board.names() == set()
    first.engine.put(ASSET, "0000", POSITIONS)
    first.sync.exchange()
    assert board.names() == {"0000"}


def test_a_board_without_room_is_given_the_rest_later(board: Any, first: Replica) -> None:
    for name in "ab":
        first.put(name)
    board.start_again()
    board.limit = POSITIONS.nbytes
    first.sync.exchange()
    assert len(board.names()) == 1
    assert first.sync.only_here(ASSET)
    board.limit = ROOM
    first.sync.exchange()
    assert board.names() == {"a", "b"}


def test_a_replica_that_missed_removals_compares(board: Any, first: Replica) -> None:
    """The board knows of the last ones alone."""
    first.put("a")
    first.put("b")
    first.sync.exchange()
    board.remove(ASSET, "a", 0)
    for number in range(MOST + 1):
        board.remove(OTHER, f"{number}", 0)
    assert "a" not in board.versions(ASSET)
    first.sync.exchange()
    assert first.engine.names() == {"b"}


def test_names_that_were_stored_and_removed_are_forgotten(board: Any, first: Replica) -> None:
    """A viewer invents a name for each pose."""
    kept, known = board.board, FrameVersions()
    for number in range(MOST + 2000):
        name = f"pose{number}"
        version = first.put(name)
        known.note(ASSET, name, version)
        known.note(ASSET, name, first.remove(name), removed=True)
    assert first.sync._held == {}
    assert len(first.sync._removed) == len(kept._removed) == len(known) == MOST
    assert len(board.versions(ASSET)) == MOST
    assert kept._used == 0


def test_an_ingress_knows_the_newest_version() -> None:
    known = FrameVersions()
    assert known.version(ASSET, "a") == 0
    known.note(ASSET, "a", 7)
    known.note(ASSET, "a", 5)
    assert known.version(ASSET, "a") == 7
    known.note(ASSET, "a", 9, removed=True)
    known.note(ASSET, "a", 8)
    assert known.version(ASSET, "a") == 9
    known.note(ASSET, "a", 10)
    known.forget(ASSET, "a")
    assert known.version(ASSET, "a") == 10, "replicas that have it look for a later one"
    known.forget(ASSET)
    assert (known.version(ASSET, "a"), len(known)) == (0, 0)


def test_the_oldest_removals_are_forgotten() -> None:
    known = Removals(2)
    assert known.note(ASSET, "a", 1) is None
    assert known.note(ASSET, "b", 2) is None
    assert known.since(0) == ({(ASSET, "a"): 1, (ASSET, "b"): 2}, True)
    assert known.note(ASSET, "c", 3) == (ASSET, "a")
    assert known.since(0) == ({(ASSET, "b"): 2, (ASSET, "c"): 3}, False)
    assert known.since(2) == ({(ASSET, "c"): 3}, True)
    known.undo(ASSET, "c")
    assert known.version(ASSET, "c") == 0
    known.note(ASSET, "", 9)
    assert known.version(ASSET, "c") == 9
