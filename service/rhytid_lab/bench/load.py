"""Many clients that ask a server for tiles at once, each on a connection of its own.

HTTP/1.1 by hand: a client library would take longer than the server.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from urllib.parse import urlsplit

import numpy as np

from rhytid.errors import RhytidError

_TIMEOUT = 60.0


@dataclass(frozen=True)
class Load:
    """Times of a server.  seconds: of each answer.  span: from the first request to the last
    answer."""

    seconds: tuple[float, ...]
    span: float

    @property
    def per_second(self) -> float:
        """Answers per second."""
        return len(self.seconds) / self.span

    def percentile(self, share: float) -> float:
        """Seconds within which that share of the answers came, in percent."""
        return float(np.percentile(self.seconds, share))


def merged(parts: Sequence[Load]) -> Load:
    """Several loads as one."""
    return Load(tuple(s for one in parts for s in one.seconds), sum(one.span for one in parts))


def load(
    url: str, paths: Sequence[str], clients: int, requests: int, seconds: float = math.inf
) -> Load:
    """Send requests by several clients, which take the paths in turn; fewer if they take longer
    than the given seconds.

    Raises RhytidError where an answer is not 200, and where the last does not come in a minute.
    """
    return asyncio.run(_load(url, paths, clients, requests, seconds))


async def _load(
    url: str, paths: Sequence[str], clients: int, requests: int, seconds: float
) -> Load:
    start = time.perf_counter()
    asked = takewhile(lambda turn: time.perf_counter() < start + seconds, range(requests))
    tasks = [asyncio.create_task(_client(url, paths, asked)) for _ in range(clients)]
    try:
        spent = await asyncio.wait_for(asyncio.gather(*tasks), min(seconds, _TIMEOUT) + _TIMEOUT)
    except TimeoutError as error:
        raise RhytidError(f"{url}: {clients} clients were not served in a minute") from error
    span = time.perf_counter() - start
    return Load(tuple(seconds for one in spent for seconds in one), span)


async def _client(url: str, paths: Sequence[str], asked: Iterator[int]) -> list[float]:
    place = urlsplit(url)
    reader, writer = await asyncio.open_connection(place.hostname, place.port, limit=1 << 22)
    spent = []
    try:
        for turn in asked:
            start = time.perf_counter()
            await _get(reader, writer, place.netloc, paths[turn % len(paths)])
            spent.append(time.perf_counter() - start)
    finally:
        writer.close()
    return spent


async def _get(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, host: str, path: str
) -> bytes:
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
    head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
    fields = dict(line.lower().split(": ", 1) for line in head[1:] if line)
    body = await reader.readexactly(int(fields["content-length"]))
    if head[0].split(" ")[1] != "200":
        raise RhytidError(f"GET {path}: {head[0]}: {body[:200].decode(errors='replace')}")
    return body
