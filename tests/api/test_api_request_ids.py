"""Request ids: taken over or made, in answers, problems and the log."""

from __future__ import annotations

import json
import logging
import re

import httpx
import pytest

from api.fake_engine import FakeEngine
from api.live import serving
from rhytid.support.logs import JsonLines, TextLines, request_id

ID = "X-Request-Id"
MADE = re.compile(r"[0-9a-f]{32}")


@pytest.mark.parametrize("given", ["a", "Farm-7/frame:12", "0" * 128])
def test_what_the_client_calls_its_request_comes_back(client: httpx.Client, given: str) -> None:
    assert client.get("/healthz", headers={ID: given}).headers[ID] == given


@pytest.mark.parametrize("given", ["", "a b", "a\tb", "0" * 129, 'quote"', "naïve", "{id}"])
def test_what_is_not_well_formed_is_replaced(client: httpx.Client, given: str) -> None:
    answer = client.get("/healthz", headers={ID: given.encode()})
    assert MADE.fullmatch(answer.headers[ID])


def test_of_two_ids_none_is_taken(client: httpx.Client) -> None:
    answer = client.get("/healthz", headers=[(ID, "one"), (ID, "two")])
    assert MADE.fullmatch(answer.headers[ID])


def test_every_request_has_another(client: httpx.Client) -> None:
    assert len({client.get("/healthz").headers[ID] for _ in range(9)}) == 9


@pytest.mark.parametrize("path", ["/v1/assets/none", "/nowhere", "/v1/devices?wrong=1"])
def test_a_problem_has_the_id_of_its_request(client: httpx.Client, path: str) -> None:
    answer = client.get(path, headers={ID: "mine"})
    assert (answer.json()["request_id"], answer.headers[ID]) == ("mine", "mine")


def test_what_is_refused_by_its_head_has_one(client: httpx.Client) -> None:
    answer = client.get("/healthz", headers={ID: "mine", "Host": "evil.example"})
    assert (answer.status_code, answer.json()["request_id"]) == (400, "mine")


def test_a_failure_that_nobody_foresaw_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = FakeEngine()

    def fail() -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(engine.assets, "all", fail)
    with serving(engine) as client:
        answer = client.get("/v1/assets", headers={ID: "mine"})
    assert (answer.status_code, answer.headers[ID]) == (500, "mine")
    assert answer.json()["request_id"] == "mine"


class Keeping(logging.Handler):
    """Formats as it goes, where the id of the request is known."""

    def __init__(self, formatter: logging.Formatter) -> None:
        super().__init__()
        self.setFormatter(formatter)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(self.format(record))


def logged(formatter: logging.Formatter, path: str) -> list[str]:
    """The log of one request."""
    logger, keeping = logging.getLogger("rhytid.api.metrics"), Keeping(formatter)
    before = logger.level
    logger.addHandler(keeping)
    logger.setLevel(logging.INFO)
    try:
        with serving(FakeEngine()) as client:
            client.get(path, headers={ID: "mine"})
    finally:
        logger.removeHandler(keeping)
        logger.setLevel(before)
    return keeping.lines


def test_a_line_of_json_says_all_of_a_request() -> None:
    (line,) = logged(JsonLines("server"), "/v1/assets/a%0Ab?x=1")
    found = json.loads(line)
    assert "\n" not in line
    assert re.fullmatch(r"2\d{3}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", found.pop("time"))
    assert found.pop("milliseconds") > 0
    assert found.pop("message").startswith("GET /v1/assets/a\\nb 422 ")
    assert found == {
        "level": "info", "process": "server", "logger": "rhytid.api.metrics", "request_id": "mine",
        "method": "GET", "path": "/v1/assets/a\\nb", "route": "/v1/assets/{asset}", "status": 422,
        "caller": "address 127.0.0.1",
    }  # fmt: skip


def test_a_line_of_text_has_the_id() -> None:
    (line,) = logged(TextLines("server"), "/v1/assets")
    assert re.match(r"\S+Z INFO server \[mine\] GET /v1/assets 200 [\d.]+ ms address ", line)


def test_a_trace_is_part_of_the_line() -> None:
    try:
        raise ValueError("first\nsecond")
    except ValueError as error:
        about = (ValueError, error, error.__traceback__)
    record = logging.LogRecord("rhytid.x", logging.ERROR, "", 1, "it %s", ("failed",), about)
    token = request_id.set("")
    try:
        line = JsonLines("device").format(record)
    finally:
        request_id.reset(token)
    found = json.loads(line)
    assert "\n" not in line
    assert (found["message"], found["level"], found["process"]) == ("it failed", "error", "device")
    assert found["exception"].endswith("ValueError: first\nsecond")
    assert "request_id" not in found
