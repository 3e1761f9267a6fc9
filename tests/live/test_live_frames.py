"""Frames in, tiles out: what is drawn, what is sent, what is dropped."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import httpx
import numpy as np
import pytest

from api.asking import built
from api.live import serving
from api.patch import positions, smile, upload
from live.gated import NAMES, TILE, GatedEngine, shapes
from live.speaker import Speaker, speaking
from rhytid.api.live import session
from rhytid.errors import DeviceLostError


def drawn(server: httpx.Client, asset: str, frame: Any, tile: str = "1001/0/1/2") -> Any:
    """The tile of positions by the call that needs no connection."""
    kind = {"Content-Type": "application/octet-stream"}
    path = f"/v1/assets/{asset}/tiles?tile={tile}&format=f16&method=binned"
    answer = server.post(path, content=np.asarray(frame, "<f4").tobytes(), headers=kind)
    body = answer.raise_for_status().content.partition(b"\r\n\r\n")[2]
    return np.frombuffer(body[: 2 * 64 * 64], "<f2").reshape(64, 64)


def test_positions_in_tiles_out(server: httpx.Client, asset: str, speaker: Speaker) -> None:
    ready = speaker.open(tiles=[TILE, [1001, 1, 0, 0]], method="binned")
    assert (ready["vertices"], ready["tile_size"], ready["udims"]) == (25, 64, [1001])
    speaker.positions(7, smile())
    tiles, end = speaker.answer()
    assert [tile.address for tile in tiles] == [tuple(TILE), (1001, 1, 0, 0)]
    assert {(t.frame, t.codes, t.dropped, t.values.shape) for t in tiles} == {(7, 1, 0, (64, 64))}
    assert np.array_equal(tiles[0].values.astype("<f2"), drawn(server, asset, smile()))
    assert {**end, "seconds": 0} == {
        "message": "frame", "frame": 7, "sent": 2, "unchanged": 0, "dropped": 0, "seconds": 0,
    }  # fmt: skip


def test_a_full_queue_refuses_no_frame() -> None:
    """Live connections have places of their own, and tell the engine that they are live."""
    engine = GatedEngine()
    with serving(engine, queue=1) as server, ThreadPoolExecutor(1) as pool:
        asset = built(server, upload())
        with speaking(server, asset) as speaker:
            speaker.open(tiles=[TILE])
            engine.gate.clear()
            try:
                other = pool.submit(drawn, server, asset, smile())
                assert engine.began.acquire(timeout=60)
                speaker.positions(1, smile())
                assert engine.began.acquire(timeout=60)
            finally:
                engine.gate.set()
            tiles, end = speaker.answer()
            assert (len(tiles), end["message"]) == (1, "frame")
            other.result(60)
    assert engine.live == [False, True]


def test_nothing_is_stored(server: httpx.Client, asset: str, speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    speaker.positions(1, smile())
    speaker.answer()
    frames = server.get(f"/v1/assets/{asset}/frames").json()
    assert [frame["name"] for frame in frames] == ["neutral"]


@pytest.mark.parametrize(("format", "scale"), [("f16", None), ("u16", None), ("u16", 0.5)])
def test_formats_hold_the_same(
    server: httpx.Client, asset: str, speaker: Speaker, format: str, scale: float | None
) -> None:
    speaker.open(tiles=[TILE], method="binned", format=format, scale=scale)
    speaker.positions(1, smile())
    (tile,), _ = speaker.answer()
    exact = drawn(server, asset, smile()).astype(float)
    if format == "f16":
        assert np.array_equal(tile.values, exact)
        return
    assert tile.scale == np.float32(scale or tile.scale)
    found = (tile.values.astype(float) - 32768) / 32767 * tile.scale
    assert tile.values.min() < 32768
    assert np.abs(found - exact).max() <= tile.scale / 65534 + np.abs(exact).max() / 2048


# The weights of ARKit: one name without a side, one that the asset has not, another spelling.
ARKIT = ["browInnerUp", "tongueOut", "JawOpen"]


def test_weights_move_the_shapes_that_their_names_mean(
    server: httpx.Client, asset: str, speaker: Speaker
) -> None:
    ready = speaker.open(tiles=[TILE], method="binned", shapes=ARKIT)
    assert (ready["shapes"], ready["unknown"]) == (ARKIT, ["tongueOut"])
    speaker.weights(1, [0.5, 9.0, 0.25])
    (tile,), _ = speaker.answer()
    moves = shapes().astype(float) - positions()
    frame = positions() + np.tensordot([0.5, 0.5, 0.25], moves, 1)
    assert np.array_equal(tile.values.astype("<f2"), drawn(server, asset, frame))


def test_weights_are_in_the_order_of_the_shapes_unless_they_are_named(speaker: Speaker) -> None:
    assert speaker.open(tiles=[TILE])["shapes"] == NAMES
    speaker.weights(1, [0, 0, np.nan])
    _, end = speaker.answer()
    assert (end["message"], end["frame"], end["status"]) == ("problem", 1, 422)
    assert "jawOpen" in end["detail"]
    speaker.weights(2, [0, 0, 1])
    assert speaker.answer()[1]["sent"] == 1


def test_a_vertex_that_is_not_finite_is_named_and_the_connection_goes_on(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    frame = smile()
    frame[3, 1] = np.inf
    speaker.positions(1, frame)
    tiles, end = speaker.answer()
    assert (tiles, end["type"]) == ([], "urn:rhytid:problem:frame")
    assert "vertex 3" in end["detail"]
    speaker.positions(2, smile())
    assert speaker.answer()[1]["frame"] == 2


def test_only_the_newest_frame_is_drawn_and_the_dropped_are_counted(
    engine: GatedEngine, speaker: Speaker
) -> None:
    speaker.open(tiles=[TILE])
    engine.began = threading.Semaphore(0)
    engine.gate.clear()
    speaker.positions(1, smile(0.1))
    assert engine.began.acquire(timeout=10)
    for number in (2, 3, 4, 9):
        speaker.positions(number, smile(0.1 * number))

    pong = speaker.socket.ping()
    assert pong.wait(10)
    engine.gate.set()
    first, second = speaker.answer(), speaker.answer()
    assert (first[1]["frame"], first[1]["dropped"]) == (1, 0)
    assert (second[1]["frame"], second[1]["dropped"]) == (9, 3)
    assert [tile.dropped for tile in second[0]] == [3]


def test_metrics_have_connections_and_dropped_frames(
    engine: GatedEngine, server: httpx.Client, speaker: Speaker
) -> None:
    def dropped() -> tuple[float, float]:
        lines = dict(line.rsplit(" ", 1) for line in server.get("/metrics").text.splitlines())
        names = ("rhytid_live_connections", "rhytid_live_frames_dropped_total")
        return float(lines[names[0]]), float(lines[names[1]])

    before = dropped()
    assert before[0] >= 1
    speaker.open(tiles=[TILE])
    engine.began = threading.Semaphore(0)
    engine.gate.clear()
    speaker.positions(1, smile(0.1))
    assert engine.began.acquire(timeout=10)
    for number in (2, 3, 4):
        speaker.positions(number, smile(0.1 * number))
    assert speaker.socket.ping().wait(10)
    engine.gate.set()
    for _ in range(2):
        speaker.answer()
    assert dropped()[1] - before[1] == 2


def test_a_connection_asks_the_engine_for_one_tile_at_a_time() -> None:
    engine = GatedEngine()
    with serving(engine) as client:
        asset = built(client, upload())
        with speaking(client, asset) as speaker:
            speaker.open(tiles=[[1001, 0, 0, column] for column in range(4)])
            for number in range(50):
                speaker.positions(number, smile(0.01 * number))
            while speaker.answer()[1]["frame"] < 49:
                assert engine.most == 1


class Paused:
    """Lets three messages through, and others once it is told to."""

    def __init__(self) -> None:
        self.left, self.go = 3, threading.Event()

    def take(self, *_: Any) -> int:
        self.left -= 1
        return int(self.left < 0 and not self.go.is_set())


def test_who_sends_too_often_is_read_later(
    server: httpx.Client, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    paused = Paused()
    monkeypatch.setattr(session, "RateLimiter", lambda: paused)
    with speaking(server, asset) as speaker:
        speaker.open(tiles=[TILE])
        for number in range(1, 6):
            speaker.positions(number, smile(0.01 * number))
        while speaker.answer()[1]["frame"] < 4:
            pass
        with pytest.raises(TimeoutError):
            speaker.socket.recv(0.05)
        paused.go.set()
        assert speaker.answer()[1]["frame"] == 5


def test_a_tile_that_changed_too_little_is_not_sent_again(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE, [1001, 0, 0, 0]], tolerance=1e-4)
    speaker.positions(0, smile(0.1))
    first, end = speaker.answer()
    assert (end["sent"], end["unchanged"]) == (2, 0)
    # Slowly: each step is below the tolerance, their sum is not.
    found = []
    for number in range(1, 9):
        speaker.positions(number, smile(0.1 + 0.05 * number))
        tiles, end = speaker.answer()
        assert end["sent"] == len(tiles) == 2 - end["unchanged"]
        found += [tile for tile in tiles if tile.address == first[0].address]
    assert 0 < len(found) < 7
    for before, after in zip([first[0], *found], found, strict=False):
        assert np.abs(after.values - before.values).max() > 1e-4


def test_a_frame_that_is_as_before_sends_nothing(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    for number, sent in ((1, 1), (2, 0)):
        speaker.positions(number, smile())
        assert speaker.answer()[1]["sent"] == sent


def test_what_was_sent_is_not_what_the_engine_draws_into_next() -> None:
    engine = GatedEngine()
    place = np.empty((64, 64), np.float32)
    gated = engine._gated

    def reusing(*arguments: Any) -> Any:
        drawn = gated(*arguments)
        place[:] = drawn.tile
        return replace(drawn, tile=place)

    engine.tiles.draw = reusing  # type: ignore[method-assign]
    with serving(engine) as client:
        asset = built(client, upload())
        with speaking(client, asset) as speaker:
            speaker.open(tiles=[TILE])
            for number in (1, 2):
                speaker.positions(number, smile(0.1 * number))
                assert speaker.answer()[1]["sent"] == 1


def test_a_device_that_is_busy_is_told_and_the_connection_goes_on(
    engine: GatedEngine, speaker: Speaker
) -> None:
    speaker.open(tiles=[TILE])
    engine.error = DeviceLostError("it is restarted")
    try:
        speaker.positions(1, smile())
        _, end = speaker.answer()
    finally:
        engine.error = None
    assert (end["status"], end["retry_after"], end["frame"]) == (503, 5, 1)
    assert end["detail"] == "it is restarted"
    speaker.positions(2, smile())
    assert speaker.answer()[1]["sent"] == 1


def test_memory_is_held_while_it_is_open_and_no_longer() -> None:
    engine = GatedEngine()
    with serving(engine) as client:
        asset = built(client, upload())
        wait_until_free(engine)  # of the requests before
        with speaking(client, asset) as speaker:
            speaker.open(tiles=[TILE])
            little = engine.memory.used
            assert little >= 2 * 4 * 64 * 64
            speaker.tell("view", tiles=[[1001, 0, row, 0] for row in range(4)])
            speaker.positions(1, smile())
            speaker.answer()
            assert engine.memory.used == little + 4 * 4 * 64 * 64
        wait_until_free(engine)


def wait_until_free(engine: GatedEngine) -> None:
    """Fails where memory is still held after twenty seconds."""
    deadline = time.monotonic() + 20
    while engine.memory.used:
        assert time.monotonic() < deadline
        time.sleep(0.01)
