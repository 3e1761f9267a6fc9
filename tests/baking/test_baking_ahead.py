"""Frames are drawn while others are written, and what is drawn twice is written once."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from baking.bakers import SQUARE, bake, baker, maps
from baking.fake_engine import FakeEngine
from exports.textures.reading import read_texture
from rhytid.baking import file_writers
from rhytid.baking.baker import Baker
from rhytid.baking.file_writers import FileWriters
from rhytid.baking.map_sources import Geometry, once
from rhytid.baking.output import BakeRecord
from rhytid.engine.byte_budget import ByteBudget, Hold
from rhytid.engine.messages import TilePlan
from rhytid.errors import CancelledError, StorageError
from rhytid.exports.textures import profiles
from rhytid.exports.textures.profiles import PROFILES, halves_are_enough, profiles_of
from rhytid.formats.exr import read_exr

FRAMES = [0.25, 0.5, 0.75, 1.0, 1.25]
UDIMS = (1001, 1002)
# What shows nothing that another frame with the same positions would not.
# Here the engine draws no slopes.
_NOT = ("cavity", "slopes", "roughness", "anisotropy")
ONCE = [name for name, one in PROFILES.items() if one.drawn and name not in _NOT]
PATIENCE = 20.0


@pytest.fixture
def engine() -> FakeEngine:
    return FakeEngine()


def with_writer(engine: FakeEngine, folder: Path, write: Any, **changes: Any) -> Baker:
    """A baker whose maps are written by `write`, after which the usual writer writes them."""
    made = baker(engine, folder, FRAMES, **changes)
    plain = PROFILES["float"]

    def both(path: Path, *rest: Any) -> None:
        write(path)
        plain.write(path, *rest)

    made.output = replace(made.output, profiles=(replace(plain, write=both),))
    return made


def test_frames_are_drawn_while_the_first_is_written(engine: FakeEngine, tmp_path: Path) -> None:
    def write(path: Path) -> None:
        if path.name == "face.1001.0001.exr":
            wait_until(lambda: ("0003", 1002) in engine.drawn)

    with_writer(engine, tmp_path, write).run()

    assert len(maps(tmp_path)) == len(FRAMES) * len(UDIMS)


def test_no_more_wait_than_there_are_bytes_for(engine: FakeEngine, tmp_path: Path) -> None:
    engine.memory = ByteBudget(1, "RHYTID_HOST_MEMORY_MB")
    drawn = []

    with_writer(engine, tmp_path, lambda path: drawn.append(len(engine.drawn))).run()

    assert drawn == [*range(1, len(FRAMES) * len(UDIMS) + 1)]


@pytest.mark.parametrize(
    ("profiles", "texel_bytes"),
    [(["half"], 12), (["half", "normal-gl", "png16"], 30), (["png16"], 18)],
)
def test_a_map_holds_what_the_largest_of_its_files_takes(
    profiles: list[str], texel_bytes: int, engine: FakeEngine, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    made, held = baker(engine, tmp_path, [0.5, 0.5], profiles=profiles), []
    hold = FileWriters.hold

    def holding(writers: FileWriters, nbytes: int) -> Hold:
        held.append(nbytes)
        return hold(writers, nbytes)

    monkeypatch.setattr(FileWriters, "hold", holding)
    made.run()

    side = int(made.asset.settings["resolution"])
    assert held == [texel_bytes * side**2] * 4  # copies, too: they may have to be drawn


def test_a_frame_is_done_when_its_files_are_there(engine: FakeEngine, tmp_path: Path) -> None:
    made = baker(engine, tmp_path, FRAMES)
    places = made.output.places(made.frames.places)

    def shown() -> Iterator[Any]:
        for place in places:
            yield place
            for udim in UDIMS:
                assert made.output.file(PROFILES["float"], udim, place).is_file()

    made.write(places, shown())
    assert made.written == len(FRAMES) * len(UDIMS)


def test_a_surface_is_written_with_memory_for_one_map(engine: FakeEngine, tmp_path: Path) -> None:
    engine.memory = ByteBudget(1, "RHYTID_HOST_MEMORY_MB")
    made = baker(engine, tmp_path, FRAMES)
    made.asset = replace(made.asset, udims=(1001,))
    made.geometry = Geometry(SQUARE, "ply", 1)

    made.run()

    assert len(list(tmp_path.glob("*.ply"))) == len(FRAMES)
    assert made.written == 2 * len(FRAMES)


@pytest.mark.parametrize(
    ("profiles", "surface", "halves"),
    [
        (["half"], False, True),
        (["half", "png16"], False, False),
        (["half"], True, False),
    ],
)
def test_maps_of_half_floats_alone_are_drawn_as_such(
    profiles: list[str], surface: bool, halves: bool, engine: FakeEngine, tmp_path: Path
) -> None:
    made = baker(engine, tmp_path, FRAMES, profiles=profiles)
    made.asset = replace(made.asset, udims=(1001,))
    made.geometry = Geometry(SQUARE, "ply", 1) if surface else None

    made.run()

    assert [udim for _, udim in engine.drawn] == [1001] * len(FRAMES)
    assert engine.in_halves == (engine.drawn if halves else [])
    assert halves_are_enough(profiles_of(["half", "weights"]))


class Pool(ThreadPoolExecutor):
    """Has `ended` set when work that waits was cancelled, or when it is all to be done."""

    ended = threading.Event()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        super().shutdown(wait=False, cancel_futures=cancel_futures)
        self.ended.set()
        super().shutdown(wait)


def test_after_an_error_of_a_writer_what_waits_is_not_written(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pool, "ended", threading.Event())
    monkeypatch.setattr(file_writers, "ThreadPoolExecutor", Pool)
    monkeypatch.setattr(file_writers, "core_count", lambda: 1)  # three writers, three frames
    begun = []

    def write(path: Path) -> None:
        begun.append(path.name)
        if path.name == "face.1001.0001.exr":
            wait_until(lambda: ("0003", 1002) in engine.drawn and len(begun) == 3)
            raise StorageError("full")
        assert Pool.ended.wait(PATIENCE)

    with pytest.raises(StorageError, match="full"):
        with_writer(engine, tmp_path, write).run()

    assert len(engine.drawn) == 6
    assert len(begun) in (3, 4)  # the thread that failed may begin one before the bake knows
    assert maps(tmp_path) == sorted({*begun} - {"face.1001.0001.exr"})
    assert engine.held == {}
    rest = bake(engine, tmp_path, FRAMES)
    assert rest.skipped == len(begun) - 1
    assert rest.written == len(FRAMES) * len(UDIMS) - rest.skipped


@pytest.mark.parametrize("profile", ONCE)
def test_frames_with_the_same_positions_are_drawn_once(
    profile: str, engine: FakeEngine, tmp_path: Path
) -> None:
    made = bake(engine, tmp_path, [0.5, 0.5, 0.25], profiles=[profile])

    assert made.written == 6
    again = PROFILES[profile].renamed is None
    assert [label for label, udim in engine.drawn if udim == 1001] == [
        "0001", *(["0002"] if again else []), "0003",
    ]  # fmt: skip
    first, second = (
        read_texture(made.output.file(PROFILES[profile], 1002, place))
        for place in made.frames.places[:2]
    )
    assert (first.texels == second.texels).all()
    assert (first.attributes["frame"], second.attributes["frame"]) == ("0001", "0002")
    assert int(first.attributes["triangles"]) == len(SQUARE.faces)
    del first.attributes["frame"], second.attributes["frame"]
    for texture in (first, second):
        texture.attributes.pop("DateTime", None)  # of `tx`: when OpenImageIO wrote it
    assert first.attributes == second.attributes
    assert bake(engine, tmp_path, [0.5, 0.5, 0.25], profiles=[profile]).skipped == 6


def second_frame(engine: FakeEngine, folder: Path) -> None:
    """Bake the second of two equal frames."""
    engine.drawn.clear()
    made = baker(engine, folder, [0.5, 0.5])
    places = made.frames.places[1:]
    made.write(places, places)
    texels, header = read_exr(folder / "face.1001.0002.exr")
    assert (texels == 0.5).all()
    assert header["frame"] == "0002"


def test_a_copy_is_made_of_what_another_run_wrote(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [0.5])

    second_frame(engine, tmp_path)

    assert engine.drawn == []


@pytest.mark.parametrize("damage", ["removed", "cut"])
def test_no_copy_is_made_of_a_damaged_file(damage: str, engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, [0.5])
    file = tmp_path / "face.1001.0001.exr"
    file.write_bytes(file.read_bytes()[:-1]) if damage == "cut" else file.unlink()

    second_frame(engine, tmp_path)

    assert engine.drawn == [("0002", 1001)]


def test_files_that_are_gone_are_drawn_by_the_thread_that_draws(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bake(engine, tmp_path, FRAMES)
    for file in tmp_path.glob("*.exr"):
        file.unlink()
    places, threads = [], []
    plan_map = engine.tiles.plan_map

    def noting(asset: str, frame: str, *rest: Any) -> TilePlan:
        plan = plan_map(asset, frame, *rest)

        def draw() -> Any:
            threads.append(threading.current_thread())
            places.append(frame in engine.held)
            return plan.draw()

        return replace(plan, draw=draw)

    monkeypatch.setattr(engine.tiles, "plan_map", noting)
    bake(engine, tmp_path, FRAMES)

    assert {*threads} == {threading.current_thread()}
    assert places == [True] * len(FRAMES) * len(UDIMS)


def test_files_that_are_gone_wait_for_bytes(engine: FakeEngine, tmp_path: Path) -> None:
    bake(engine, tmp_path, FRAMES)
    for file in tmp_path.glob("*.exr"):
        file.unlink()
    engine.drawn.clear()
    engine.memory = ByteBudget(1, "RHYTID_HOST_MEMORY_MB")
    drawn: list[int] = []

    with_writer(engine, tmp_path, lambda path: drawn.append(len(engine.drawn))).run()

    assert drawn == [*range(1, len(FRAMES) * len(UDIMS) + 1)]


@pytest.mark.parametrize("error", [PermissionError, OSError, KeyError, ValueError])
def test_a_map_whose_copy_fails_is_drawn(
    error: type[Exception], engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bake(engine, tmp_path, [0.5])

    def fail(*_: Any) -> Any:
        raise error("no")

    if issubclass(error, OSError):
        monkeypatch.setattr(Path, "read_bytes", fail_for(tmp_path / "face.1001.0001.exr", error))
    else:
        monkeypatch.setitem(PROFILES, "float", replace(PROFILES["float"], renamed=fail))
        monkeypatch.setattr(profiles, "_ALL", tuple(PROFILES.values()))

    second_frame(engine, tmp_path)

    # By the threads that write, in any order.
    assert ("0002", 1001) in engine.drawn


def test_a_map_whose_source_cannot_be_read_is_drawn(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bake(engine, tmp_path, [0.5])
    plain = BakeRecord.done

    def done(record: BakeRecord, file: Path, key: str) -> bool:
        if file.name == "face.1001.0001.exr":
            raise PermissionError("no")
        return plain(record, file, key)

    monkeypatch.setattr(BakeRecord, "done", done)
    second_frame(engine, tmp_path)

    assert engine.drawn == [("0002", 1001)]


def fail_for(file: Path, error: type[OSError]) -> Any:
    """`Path.read_bytes` that fails for one file."""
    plain = Path.read_bytes

    def read(path: Path) -> bytes:
        if path == file:
            raise error("no")
        return plain(path)

    return read


def test_a_copy_of_what_could_not_be_written_is_not_drawn(
    engine: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submitted, submit = [], FileWriters.submit

    def noting(writers: FileWriters, *rest: Any) -> Future[int]:
        submitted.append(rest)
        return submit(writers, *rest)

    def write(path: Path) -> None:
        if path.name == "face.1001.0001.exr":
            wait_until(lambda: len(submitted) == 4)
            raise StorageError("full")

    monkeypatch.setattr(FileWriters, "submit", noting)
    made = with_writer(engine, tmp_path, write)
    made.frames = baker(engine, tmp_path, [0.5, 0.5]).frames
    with pytest.raises(StorageError, match="full"):
        made.run()

    assert engine.drawn == [("0001", 1001), ("0001", 1002)]


def test_what_is_made_once_is_made_by_one_thread() -> None:
    calls: list[int] = []

    def make() -> int:
        calls.append(1)
        wait_until(lambda: len(asking) == 4)
        return 7

    found, asking, answers = once(make), [], []

    def ask() -> None:
        asking.append(1)
        answers.append(found())

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (calls, answers) == ([1], [7, 7, 7, 7])


def wait_until(true: Any) -> None:
    """Wait until something is true; fails where it does not become so."""
    ended = threading.Event()
    for _ in range(int(PATIENCE / 0.01)):
        if true():
            return
        ended.wait(0.01)
    raise AssertionError("not within the time that there is")


def test_no_file_of_a_map_is_begun_after_an_error() -> None:
    """Else all its profiles are waited for."""
    writing, written = threading.Event(), []

    def use(writers: FileWriters) -> Future[int]:
        def write() -> int:
            for name in ("float", "cavity"):
                writers.check()
                writing.set()
                wait_until(writers._stopping.is_set)
                written.append(name)
            return 2

        with suppress(KeyboardInterrupt), writers:
            begun = writers.submit(write)
            writing.wait(60)
            raise KeyboardInterrupt
        return begun

    begun = use(FileWriters(1 << 20))
    assert isinstance(begun.exception(), CancelledError)
    assert written == ["float"]


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def test_a_signal_while_the_only_writer_is_waited_for_lets_it_end() -> None:
    """Python takes a thread for ended whose `join` was interrupted (bpo-45274)."""
    ended, writing = list[int](), threading.Event()

    def write() -> int:
        writing.set()
        time.sleep(0.5)
        ended.append(1)
        return 1

    def interrupt_the_wait(main: int) -> None:
        writing.wait(60)
        time.sleep(0.1)  # now it waits, most likely; else the signal is an error in the block
        signal.pthread_kill(main, signal.SIGALRM)

    before = signal.signal(signal.SIGALRM, interrupt)
    sending = threading.Thread(target=interrupt_the_wait, args=(threading.get_ident(),))
    sending.start()
    try:
        with pytest.raises(KeyboardInterrupt), FileWriters(1 << 20) as writers:
            writers.submit(write)
    finally:
        signal.signal(signal.SIGALRM, before)
    found = len(ended)
    sending.join()
    assert found == 1


def test_a_signal_while_writers_are_waited_for_lets_them_end() -> None:
    """Else what they write in is removed under them."""
    ended: list[int] = []
    begun: list[Future[int]] = []
    writing, submitted, may_end = threading.Semaphore(0), threading.Event(), threading.Event()

    def write() -> int:
        writing.release()
        may_end.wait(60)
        ended.append(1)
        return 1

    def interrupt_the_wait(ahead: int, main: int) -> None:
        """Once all writers write; they may end when what waits behind them is cancelled."""
        for _ in range(ahead):
            writing.acquire(timeout=60)
        submitted.wait(60)
        time.sleep(0.1)  # now it waits, most likely; else the signal is an error in the block
        signal.pthread_kill(main, signal.SIGALRM)
        with suppress(AssertionError):
            wait_until(lambda: begun[-1].cancelled())
        may_end.set()

    def use(writers: FileWriters) -> None:
        with writers:
            begun.extend(writers.submit(write) for _ in range(2 * writers.ahead))
            submitted.set()

    before, writers = signal.signal(signal.SIGALRM, interrupt), FileWriters(1 << 20)
    given = writers.ahead, threading.get_ident()
    sending = threading.Thread(target=interrupt_the_wait, args=given)
    sending.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            use(writers)
    finally:
        signal.signal(signal.SIGALRM, before)
    found = len(ended)
    sending.join()
    assert found == writers.ahead
    assert all(one.done() for one in begun)
