"""The cost of a tile through the service: latency, tiles per second, and the share that is not the
kernel. A real server on loopback is asked by another process."""

from __future__ import annotations

import asyncio
import math
import statistics
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from rhytid.domain.graph import GraphOrigin
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.mesh import RECENT_FRAMES
from rhytid.errors import RhytidError
from rhytid.formats.graphs import write_graph
from rhytid.support.temporary_folders import temporary_folder
from rhytid_client import Asset, Client
from rhytid_lab.bench.frame import FrameBench
from rhytid_lab.server import connected, served

METHODS = ("redraw", "binned")
CLIENTS = (1, 8, 64)
_FRAME = "frame"
# Frames that are timed, once as many went before as the service keeps: from then on the memory of
# an old one is taken.
_FIRST, _BEFORE = 9, RECENT_FRAMES + 1
# Of each of a few rounds, at most.
_REQUESTS, _SECONDS, _ROUNDS = 400, 2.0, 3
_ARRAYS = ("positions", "faces", "uv", "face_uv")
# Seconds that the last answer of a load may take.
_TIMEOUT = 60.0


@dataclass(frozen=True)
class Latency:
    """Times of the tiles of a method that so many clients ask for at once.

    kernel_seconds: of one tile, drawn alone.  not_kernel: the share of the time between two answers
    of the server that a kernel does not fill.
    """

    method: str
    clients: int
    requests: int
    p50_seconds: float
    p99_seconds: float
    tiles_per_second: float
    kernel_seconds: float
    not_kernel: float


@dataclass(frozen=True)
class FirstTile:
    """Times from sending a frame to receiving its first tile, one after the other on one
    connection.

    kernel_seconds: of stretch, the response of every wrinkle to it, and one tile.
    """

    seconds: float
    kernel_seconds: float
    ratio: float


class ServiceBench:
    """Times a server that has the frame of a bench."""

    def __init__(self, bench: FrameBench, url: str, client: Client) -> None:
        self._bench, self._url, self._client = bench, url, client
        arrays = {name: getattr(bench.mesh, name) for name in _ARRAYS}
        settings = bench.settings
        wanted: dict[str, Any] = {
            k: getattr(settings, k) for k in ("resolution", "tile_size", "preset")
        }
        lengths = settings.lengths(bench.spacing)
        origin = GraphOrigin.of(bench.mesh, settings.length_unit, lengths, settings.graph.start)
        graph = write_graph(replace(bench.graph, origin=origin))
        asset = self._client.create_asset(arrays, settings=wanted, graph=graph)
        self._asset: Asset = self._client.wait(asset)
        self._client.put_frame(self._asset, _FRAME, bench.deformed)
        self._paths = [self._path(a) for a in settings.grid.addresses(bench.udim, 0)]

    def latency(self, method: str, clients: int) -> Latency:
        """Ask for every tile of level 0 in turn, as npy."""
        paths = [f"{path}?method={method}" for path in self._paths]
        load(self._url, paths, 1, len(paths))  # what is made once per frame or per tile
        found, kernels = [], []
        for _ in range(_ROUNDS):  # in turn: what else the machine does meets both
            kernels.append(self._bench.tile_seconds(method))
            found.append(load(self._url, paths, clients, _REQUESTS, _SECONDS))
        return _latency(method, clients, merged(found), statistics.median(kernels))

    def first_tile(self) -> FirstTile:
        """Ask for the tile in the middle by `redraw`, of frames that were not sent before."""
        bench = self._bench
        side = bench.settings.tile_size
        middle = bench.settings.resolution // 2 // side
        answers, kernels = [], []
        for turn in range(_BEFORE + _FIRST):
            positions = bench.deformed * (1.0 + 1e-6 * (turn + 1))
            start = time.perf_counter()
            self._client.put_frame(self._asset, _FRAME, positions)
            self._client.tile(self._asset, _FRAME, bench.udim, 0, middle, middle, method="redraw")
            answers.append(time.perf_counter() - start)
            kernels.append(bench.seconds("stretch") + bench.seconds("tile"))
        seconds, kernel = (statistics.median(times[_BEFORE:]) for times in (answers, kernels))
        return FirstTile(seconds, kernel, seconds / kernel)

    def _path(self, at: TileAddress) -> str:
        return f"/v1/assets/{self._asset.id}/frames/{_FRAME}/tiles/{at}"


@contextmanager
def service_bench(bench: FrameBench) -> Iterator[ServiceBench]:
    """Serve the frame of a bench within the block."""
    with temporary_folder("rhytid-bench-") as folder:
        device = str(bench.device.info.index)
        with served(folder / "store", device) as url, connected(url) as client:
            yield ServiceBench(bench, url, client)


def _latency(method: str, clients: int, found: Load, kernel: float) -> Latency:
    return Latency(
        method,
        clients,
        len(found.seconds),
        found.percentile(50),
        found.percentile(99),
        found.per_second,
        kernel,
        max(1.0 - kernel * found.per_second, 0.0),
    )


@dataclass(frozen=True)
class Load:
    """Times of a server that many clients ask at once.

    seconds: of each answer.  span: from the first request to the last answer.
    """

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
    """Return several loads as one."""
    return Load(tuple(s for one in parts for s in one.seconds), sum(one.span for one in parts))


def load(
    url: str, paths: Sequence[str], clients: int, requests: int, seconds: float = math.inf
) -> Load:
    """Send requests by several clients, each on a connection of its own, which take the paths in
    turn; fewer if they take longer than the given seconds.

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


# HTTP/1.1 by hand: a client library would take longer than the server.
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
