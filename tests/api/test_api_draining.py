"""The end of a server: what runs finishes, what comes is sent away, and it is bounded."""

from __future__ import annotations

import signal
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest

from api.asking import NPY, built, is_problem, npy
from api.fake_engine import FakeEngine
from api.patch import obj, smile, upload
from api.test_api_memory import connected, map_path, soon
from rhytid.api.server import http_server
from rhytid.api.server.http_server import LAST_GRACE, server_of
from rhytid.api.server.listening import LOOPBACK, address_of, listen
from rhytid.support.settings import ServiceSettings


@dataclass
class Slow:
    """A server whose tiles wait for `go`."""

    url: str
    engine: Any
    server: Any
    client: httpx.Client
    tile: str = ""
    drawing: threading.Event = field(default_factory=threading.Event)
    go: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)
    told: list[str] = field(default_factory=list)

    def end(self) -> None:
        self.server.handle_exit(signal.SIGTERM, None)


@contextmanager
def running(seconds: int, log_level: str = "critical") -> Iterator[Slow]:
    engine: Any = FakeEngine()
    told: list[str] = []
    settings = ServiceSettings(drain_seconds=seconds)
    with closing(listen(LOOPBACK, 0)) as listening:
        server = server_of(engine, settings, log_level, lambda: told.append("begun"))
        url = address_of(listening)
        with closing(httpx.Client(base_url=url, timeout=20)) as client:
            slow = Slow(url, engine, server, client, told=told)

            def serve() -> None:
                server.run([listening])
                slow.ended.set()

            thread = threading.Thread(target=serve)
            thread.start()
            draw = engine.tiles.tile

            def wait(*arguments: Any) -> Any:
                slow.drawing.set()
                assert slow.go.wait(20)
                return draw(*arguments)

            engine.tiles.tile = wait
            try:
                frame = f"/v1/assets/{built(client, upload())}/frames/smile"
                client.put(frame, content=npy(smile()), headers=NPY).raise_for_status()
                slow.tile = f"{frame}/tiles/1001/0/0/0"
                yield slow
            finally:
                slow.go.set()
                server.should_exit = True
                thread.join()


@pytest.fixture
def slow() -> Iterator[Slow]:
    with running(20) as found:
        yield found


def test_a_second_interrupt_is_no_error(slow: Slow, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("ERROR", "uvicorn.error")
    for _ in range(2):
        slow.server.handle_exit(signal.SIGINT, None)
    assert slow.ended.wait(10)
    assert slow.server.force_exit
    assert caplog.text == ""


def test_a_drain_lets_finish_what_runs_and_refuses_what_comes(slow: Slow) -> None:
    with ThreadPoolExecutor(1) as pool:
        answer: Future[httpx.Response] = pool.submit(httpx.get, slow.url + slow.tile, timeout=20)
        assert slow.drawing.wait(20)
        slow.end()
        assert slow.told == ["begun"]
        for path in ("/readyz", "/v1/assets", slow.tile):
            refused = slow.client.get(path)
            is_problem(refused, 503, "draining")
            assert refused.headers["connection"] == "close"
            assert int(refused.headers["retry-after"]) > 0
        assert slow.client.get("/healthz").json() == {"status": "alive"}
        figures = slow.client.get("/metrics").text
        assert "rhytid_draining 1.0" in figures
        assert "rhytid_requests_running 1.0" in figures
        assert not slow.ended.is_set()
        slow.go.set()
        found = answer.result()
    assert (found.status_code, found.headers["connection"]) == (200, "close")
    assert slow.ended.wait(10)


def test_a_drain_of_an_idle_server_ends_it_at_once(slow: Slow) -> None:
    slow.end()
    assert slow.ended.wait(10)


def test_a_second_signal_does_not_wait(slow: Slow) -> None:
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(httpx.get, slow.url + slow.tile, timeout=20)
        assert slow.drawing.wait(20)
        slow.end()
        slow.end()
        assert slow.server.config.timeout_graceful_shutdown == LAST_GRACE
        is_problem(answer.result(), 503, "draining")
        slow.go.set()
    assert slow.ended.wait(10)


def test_a_drain_has_an_end() -> None:
    with running(1) as slow, ThreadPoolExecutor(1) as pool:
        answer = pool.submit(httpx.get, slow.url + slow.tile, timeout=20)
        assert slow.drawing.wait(20)
        slow.end()
        cut_off = answer.result()
        is_problem(cut_off, 503, "draining")
        assert cut_off.headers["connection"] == "close"
        slow.go.set()
        assert slow.ended.wait(10)


def test_a_sigterm_after_an_interrupt_sets_a_bound_to_the_end(slow: Slow) -> None:
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(httpx.get, slow.url + slow.tile, timeout=20)
        assert slow.drawing.wait(20)
        slow.server.handle_exit(signal.SIGINT, None)
        soon(lambda: slow.server.should_exit and slow.server._drain.begun)
        slow.end()
        assert slow.told == ["begun"]
        slow.go.set()
        assert answer.result().status_code == 200
    assert slow.ended.wait(10)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_an_answer_that_nobody_reads_is_broken_off_in_one_line(
    how: signal.Signals, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    monkeypatch.setattr(http_server, "GRACE", 1)
    with running(1, "info") as slow:
        slow.go.set()
        path = f"{map_path(slow.client, 2048)}?format=npy"
        with connected(slow.client) as reader:
            reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
            reader.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
            assert reader.recv(4) == b"HTTP"
            slow.server.handle_exit(how, None)
            assert slow.ended.wait(20)
    assert not [record for record in caplog.records if record.exc_info]
    lines = [record.getMessage() for record in caplog.records]
    broken = [line for line in lines if "broken off" in line]
    assert broken == [f"GET {path.partition('?')[0]}: broken off, the server ends"]
    assert [line for line in lines if "ASGI" in line] == []
    said = "SIGTERM: new requests are refused, 1 finish"
    assert lines.count(said) == (how == signal.SIGTERM)


def test_a_stream_of_events_ends_with_the_drain() -> None:
    with running(20) as slow:
        slow.engine.state.polls = 10**6
        made = slow.client.post("/v1/assets", files=upload(obj(2.0))).json()
        with slow.client.stream("GET", f"/v1/jobs/{made['job']}/events") as events:
            lines = events.iter_lines()
            next(lines)
            slow.end()
            assert not any("end" in line for line in lines)
        assert slow.ended.wait(10)
