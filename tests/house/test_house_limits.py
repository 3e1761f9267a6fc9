"""The page of limits: its numbers are those of the code, and its tests are there."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from house.markdown import table
from house.pages import ROOT
from rhytid.api import (
    access,
    admission,
    encoding,
    events,
    multipart,
    request_memory,
    uploads,
)
from rhytid.api.live import drawing, session, wire
from rhytid.api.server import connections, web_sockets
from rhytid.domain import expressions, painted_maps, view
from rhytid.engine import byte_budget
from rhytid.engine.jobs import LANES
from rhytid.formats import limits as format_limits
from rhytid.formats import npz_archive, obj
from rhytid.processes.decoding import decoder, limits
from rhytid.support.settings import ServiceSettings

PAGE = (ROOT / "docs/reference/limits.md").read_text()
HEADINGS = re.findall(r"^## (.*)$", PAGE, re.MULTILINE)
USUAL = ServiceSettings.from_environment({})
MIB = 1 << 20
# Rows by how they begin, and the numbers of the code that their first two cells have, in order.
NUMBERS: dict[str, tuple[float, ...]] = {
    "connections open": (USUAL.connections,),
    "of one address": (connections.ConnectionLimits.of(USUAL).most_of_one,),
    "time for the head": (USUAL.stall_seconds,),
    "time for each": (connections.PROGRESS, USUAL.stall_seconds),
    "time in which a client": (connections.TAKEN, USUAL.stall_seconds),
    "time for the handshake": (USUAL.stall_seconds,),
    "head of a request": (connections.DEFAULT_MAX_INCOMPLETE_EVENT_SIZE,),
    "requests per second": (USUAL.key_rate,),
    "unfinished jobs": (USUAL.key_jobs,),
    "callers": (access.REMEMBERED,),
    "body": (USUAL.upload_limit / MIB,),
    "uploads and large": (USUAL.spool / MIB,),
    "small answers": (request_memory.SMALL / MIB,),
    "a wait": (byte_budget.PATIENCE,),
    "JSON": (uploads.JSON_LIMIT,),
    "head of a part": (multipart.HEADER_LIMIT,),
    "images": (multipart.MOST_REPEATED,),
    "numbers in one": (format_limits.MAX_NUMBERS,),
    "numbers in all": (format_limits.MAX_FRAME_NUMBERS,),
    "header of a": (npz_archive.MAX_HEADER,),
    "face": (obj._LONGEST_FACE,),
    "side": (format_limits.MOST_SIDE,),
    "texels of all": (painted_maps.MOST_TEXELS,),
    "expressions": (expressions.MOST_EXPRESSIONS,),
    "live connections open": (admission.MOST_LIVE,),
    "live connections of": (admission.MOST_LIVE_EACH,),
    "live message of any": (web_sockets.LARGEST / MIB,),
    "live message to": (wire.largest_message(1),),
    "tiles in a live": (wire.MOST_TILES,),
    "texels in a live": (drawing.MOST_TEXELS,),
    "tiles of a level": (view.MOST_PAIRS,),
    "time for a live": (session.HEADER,),
    "time between live": (session.IDLE,),
    "time in which a live": (session.STALLED,),
    "time between pings": (web_sockets.PING,),
    "decoded in the server itself: bytes sent": (limits.LIGHT,),
    "decoded in the server itself: bytes that": (limits.LIGHT_PROMISED,),
    "uploads decoded at once in": (limits.AT_ONCE,),
    "uploads decoded at once whose": (limits.LARGE / MIB, 1),
    "uploads that wait": (decoder._WAITING, decoder._PATIENCE),
    "memory of a process": (limits.ROOM / MIB, limits.ROOM_A_BYTE, limits.ROOM_A_PROMISED),
    "processor": (limits.SECONDS, 1),
    "time of a process by": (limits.CLOCK,),
    "listeners to jobs": (events.MOST,),
    "listeners of": (events.MOST_EACH,),
    "requests that wait": (USUAL.queue,),
    "jobs that wait": (USUAL.jobs,),
    "answers of": (admission.HUGE / MIB, admission.AT_ONCE, admission.PATIENCE),
    "an answer": (encoding.LARGE / MIB,),
    "time that a build": (USUAL.build_seconds,),
    "lanes that": (len(LANES) - 3, len(LANES) - 2),
    "time that a map": (USUAL.draw_seconds,),
    "time of a call": (USUAL.launch_seconds,),
}


def rows() -> Iterator[dict[str, str]]:
    for heading in HEADINGS:
        yield from table(PAGE, heading)


@pytest.mark.parametrize("begins", NUMBERS)
def test_numbers_are_those_of_the_code(begins: str) -> None:
    (row,) = [row for row in rows() if row["what"].startswith(begins)]
    found = [float(n) for n in re.findall(r"[0-9]+", f"{row['what']} {row['limit']}")]
    assert found[: len(NUMBERS[begins])] == [float(number) for number in NUMBERS[begins]]


def test_every_limit_has_a_test() -> None:
    for row in rows():
        file, _, name = row["test"].strip("`").partition("::")
        assert f"\ndef {name}(" in (ROOT / file).read_text(), row["test"]


def test_variables_are_known() -> None:
    page = (ROOT / "docs/reference/settings.md").read_text()
    for row in rows():
        assert not row["variable"] or f"| {row['variable']} |" in page
