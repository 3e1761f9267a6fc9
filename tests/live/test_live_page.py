"""docs/live.md says what the code does: sizes of headers, limits, formats."""

from __future__ import annotations

import re
from pathlib import Path

from rhytid.api import admission
from rhytid.api.live import drawing, session, wire
from rhytid.api.server import web_sockets
from rhytid.api.uploads import JSON_LIMIT
from rhytid_client.live_link.receiver import PORT

PAGE = (Path(__file__).parents[2] / "docs" / "live.md").read_text("utf-8")


def sizes(part: str) -> int:
    """Bytes of the header in the first table of binary fields after a heading."""
    table = PAGE.partition(part)[2].partition("| rest |")[0].partition("| bytes | what |")[2]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| ")]
    return sum(int(n) for row in rows for n in re.findall(r"\d+", row))


def test_headers_have_the_size_that_the_page_gives_them() -> None:
    assert sizes("### From the client") == wire.FRAME.size
    assert sizes("### From the server") == wire.TILE.size == 40
    formats = re.search(r"format of the values: (.*) \|", PAGE)
    assert formats is not None
    named = re.findall(r"(\d) `(\w+)`", formats[1])
    assert {name: int(number) for number, name in named} == wire.CODES
    assert f"`{wire.PROTOCOL}`" in PAGE


def test_limits_are_those_of_the_page() -> None:
    vertices = (web_sockets.LARGEST - wire.FRAME.size) // 12
    most = f"{admission.MOST_LIVE}, {admission.MOST_LIVE_EACH}"
    rows = (
        f"| connections in all, and of one caller | {most} |",
        f"| {web_sockets.LARGEST >> 20} MiB: positions of {vertices:,} vertices; the header and "
        f"views {JSON_LIMIT >> 10} KiB |",
        f"| tiles of a list or in view, names of shapes | {wire.MOST_TILES} |",
        f"| texels in view | {drawing.MOST_TEXELS:,},",
        f"| {session.HEADER:g}, {session.IDLE:g}, {session.STALLED:g} |",
        f"| pings | every {web_sockets.PING:g} seconds;",
        f"listens on port {PORT},",
    )
    assert [row for row in rows if row not in PAGE] == []
    assert wire.MOST_TILES == wire.MOST_SHAPES
