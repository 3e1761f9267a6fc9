"""The load test: what it asks, what it counts, and what it does where a server fails."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from rhytid.cli import main
from rhytid.errors import RhytidError
from rhytid_lab.bench import service
from rhytid_lab.bench.service import Load, load, merged
from rhytid_lab.server import served

pytestmark = pytest.mark.release


class Counting(BaseHTTPRequestHandler):
    """Answers with the path, and 404 where it is /missing."""

    protocol_version = "HTTP/1.1"
    asked: list[str]

    def do_GET(self) -> None:
        self.asked.append(self.path)
        self.send_response(404 if self.path == "/missing" else 200)
        self.send_header("Content-Length", str(len(self.path)))
        self.end_headers()
        self.wfile.write(self.path.encode())

    def log_message(self, *about: object) -> None:
        pass


@contextmanager
def counting() -> Iterator[tuple[str, list[str]]]:
    """The URL of a server, and what it was asked."""
    handler = type("Handler", (Counting,), {"asked": []})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", handler.asked
        finally:
            server.shutdown()
            thread.join()


def test_every_path_is_asked_in_turn() -> None:
    with counting() as (url, asked):
        found = load(url, ["/a", "/b", "/c"], 3, 7)

    assert sorted(asked) == ["/a"] * 3 + ["/b"] * 2 + ["/c"] * 2
    assert len(found.seconds) == 7
    assert 0 < max(found.seconds) <= found.span


def test_time_ends_a_load() -> None:
    with counting() as (url, asked):
        assert load(url, ["/a"], 1, 5, seconds=-1.0).seconds == ()
    assert asked == []


def test_an_answer_that_is_not_200_is_an_error() -> None:
    with counting() as (url, _), pytest.raises(RhytidError, match=r"GET /missing: .* 404 "):
        load(url, ["/a", "/missing"], 2, 8)


def test_loads_add_up() -> None:
    found = merged([Load((1.0, 2.0), 2.0), Load((3.0,), 4.0)])

    assert found == Load((1.0, 2.0, 3.0), 6.0)
    assert (found.per_second, found.percentile(50)) == (0.5, 2.0)


@pytest.mark.slow
def test_a_server_that_does_not_start_says_why(tmp_path: Path) -> None:
    with (
        pytest.raises(RhytidError, match="no OpenCL device matches"),
        served(tmp_path / "store", "no such device"),
    ):
        pass


@pytest.mark.slow
def test_the_service_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(service, "_REQUESTS", 5)
    monkeypatch.setattr(service, "_FIRST", 1)
    small = ["bench", "--service", "--size", "256", "--wrinkles", "300"]

    assert main([*small, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["first_tile"]["ratio"] == pytest.approx(
        figures["first_tile"]["seconds"] / figures["first_tile"]["kernel_seconds"]
    )
    measured = [(row["method"], row["clients"], row["requests"]) for row in figures["results"]]
    assert measured == [(m, c, 15) for m in ("redraw", "binned") for c in (1, 8, 64)]
    for row in figures["results"]:
        assert 0 < row["p50_seconds"] <= row["p99_seconds"]
        assert 0 <= row["not_kernel"] < 1
        assert row["tiles_per_second"] > 0

    assert main(small) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("frame in, first tile out: ")
    assert [line.split()[:2] for line in told[3:]] == [[m, str(c)] for m, c, _ in measured]
