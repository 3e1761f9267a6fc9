"""The time from weights sent to the first tile received: `python -m rhytid_lab.bench.live`.

One real server on loopback, one live connection, a take of weights at a steady rate: of the sample
face, or of a given face and performance. A thread sends at the times of the frames, whatever comes
back. Times are those of frames that were drawn; dropped ones are counted. With `--beside N`, N
clients in a process of their own ask for tiles of other frames all the while.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from numpy.typing import NDArray

from rhytid_client import LiveAnswer
from rhytid_client.live.blocking import Live
from rhytid_lab.samples.face import procedural_face
from rhytid_lab.server import connected, served

TILE, WARM_UP = 512, 60
# Frames that others ask for.
_OTHERS = 16


@dataclass(frozen=True, eq=False)
class _Take:
    """A face and its animation.  shapes: positions by name.  weights: (N, E)."""

    mesh: dict[str, NDArray[Any]]
    shapes: dict[str, NDArray[np.float32]]
    weights: NDArray[np.float32]


@dataclass
class _Times:
    """When frames were sent, and their first and last tile came; by number."""

    sent: dict[int, float] = field(default_factory=dict)
    first: dict[int, float] = field(default_factory=dict)
    last: dict[int, float] = field(default_factory=dict)
    answers: list[LiveAnswer] = field(default_factory=list)
    # Of processors, of the server and its device's process.
    busy: float = 0.0


def main() -> None:
    """Print percentiles, what was dropped, and how busy the machine was."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="0", help="number of the device")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=30.0, help="frames per second")
    parser.add_argument("--resolution", type=int, default=1024)
    parser.add_argument("--method", default="binned")
    parser.add_argument("--format", default="f16")
    parser.add_argument("--tolerance", type=float, default=0.0, help="mesh units")
    parser.add_argument("--beside", type=int, default=0, help="clients that ask for tiles")
    given = "folder with face.npz and performance.npz, else the sample face"
    parser.add_argument("--face", type=Path, help=given)
    options = parser.parse_args()
    take = _given(options.face) if options.face else _sample()
    with _connection(take, options) as live:
        for warm in (True, False):
            count = WARM_UP if warm else round(options.seconds * options.rate)
            _report(_run(live, take.weights, count, options.rate), take, options, warm=warm)


def _run(live: Live, weights: NDArray[np.float32], count: int, rate: float) -> _Times:
    """Send so many frames at their times, and note what arrives."""
    times, busy = _Times(), _busy()
    start = time.perf_counter() + 0.1

    def send() -> None:
        for index in range(count):
            time.sleep(max(0.0, start + index / rate - time.perf_counter()))
            began = time.perf_counter()
            number = live.send(weights=weights[index % len(weights)])
            times.sent[number] = began

    sending = threading.Thread(target=send)
    sending.start()
    while sending.is_alive() or not _all_in(times, count):
        for tile in live.receive(30.0):
            times.first.setdefault(tile.frame, time.perf_counter())
        assert live.answer is not None
        times.last[live.answer.frame] = time.perf_counter()
        times.answers.append(live.answer)
    sending.join()
    times.busy = _busy() - busy
    return times


def _busy() -> float:
    """Processor seconds of the processes that this one started, and of their children."""
    found, ticks, ids = set[int](), 0, [os.getpid()]
    while ids:
        of = Path(f"/proc/{ids.pop()}/task").glob("*/children")
        ids += (more := [int(id) for file in of for id in file.read_text().split()])
        found.update(more)
    for id in found:
        fields = Path(f"/proc/{id}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def _all_in(times: _Times, count: int) -> bool:
    """Whether the last frame, which nothing drops, is answered."""
    return len(times.sent) == count and max(times.sent) in times.last


def _report(times: _Times, take: _Take, options: argparse.Namespace, *, warm: bool) -> None:
    if warm:
        return
    dropped = sum(answer.dropped for answer in times.answers)
    tiles = sum(answer.sent for answer in times.answers)
    length = max(times.last.values()) - min(times.sent.values())
    said = f"{options.resolution}², {options.method}, {options.format}, {options.rate:g} frames/s"
    lines = [
        f"{said}, {take.weights.shape[1]} weights, {length:.0f} s, tolerance {options.tolerance}",
        f"sent {len(times.sent)}, drawn {len(times.answers)}, dropped {dropped}, tiles {tiles}",
        f"to the first tile: {_percentiles(times.sent, times.first)}",
        f"to the last tile:  {_percentiles(times.sent, times.last)}",
        f"drawing: p50 {1000 * statistics.median(a.seconds for a in times.answers):.1f} ms",
        f"processor time of the server: {1000 * times.busy / len(times.answers):.1f} ms a frame",
        f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors",
    ]
    print("\n".join(lines))  # noqa: T201


def _percentiles(sent: dict[int, float], came: dict[int, float]) -> str:
    found = sorted(1000 * (came[number] - sent[number]) for number in came)
    cuts = statistics.quantiles(found, n=100)
    return f"p50 {cuts[49]:.1f} ms, p99 {cuts[98]:.1f} ms, worst {found[-1]:.1f} ms"


@contextmanager
def _connection(take: _Take, options: argparse.Namespace) -> Iterator[Live]:
    count = max(options.resolution // TILE, 1)
    tiles = [(1001, 0, row, column) for row in range(count) for column in range(count)]
    settings = {"resolution": options.resolution}
    with (
        tempfile.TemporaryDirectory() as folder,
        served(Path(folder) / "store", options.device) as url,
        connected(url) as client,
    ):
        few = take.weights[:: max(len(take.weights) // _OTHERS, 1)][:_OTHERS]
        made = client.create_asset(take.mesh, settings=settings, shapes=take.shapes)
        asset = client.wait(made)
        neutral = take.mesh["positions"]
        for number, weights in enumerate(few):
            moves = zip(weights, take.shapes.values(), strict=True)
            posed = neutral + sum(weight * (shape - neutral) for weight, shape in moves)
            client.put_frame(asset, f"{number:04d}", posed.astype(np.float32))
        print(f"{asset.vertices} vertices, {asset.wrinkles} wrinkles")  # noqa: T201
        query = {"method": options.method, "format": options.format}
        with (
            client.live(asset, tiles=tiles, tolerance=options.tolerance, **query) as live,
            _asking(url, asset.id, tiles, options.beside),
        ):
            yield live


@contextmanager
def _asking(url: str, asset: str, tiles: Sequence[tuple[int, ...]], count: int) -> Iterator[None]:
    """So many clients ask for one tile after the other; prints how many were answered."""
    context = multiprocessing.get_context("spawn")
    over, answered = context.Event(), context.Value("q", 0)
    process = context.Process(target=_ask_all, args=(url, asset, tiles, count, over, answered))
    process.start()
    began = time.perf_counter()
    try:
        yield
    finally:
        over.set()
        process.join()
    seconds = time.perf_counter() - began
    print(f"tiles of {count} others: {answered.value} in {seconds:.0f} s")  # noqa: T201


def _ask_all(
    url: str, asset: str, tiles: Sequence[tuple[int, ...]], count: int, over: Any, answered: Any
) -> None:
    def ask(first: int) -> None:
        with httpx.Client(base_url=url, timeout=600) as client:
            for number in itertools.count(first):
                udim, level, row, column = tiles[number % len(tiles)]
                place = f"tiles/{udim}/{level}/{row}/{column}"
                path = f"/v1/assets/{asset}/frames/{number % _OTHERS:04d}/{place}"
                good = client.get(path, params={"method": "redraw"}).status_code == 200
                with answered.get_lock():
                    answered.value += good
                if over.is_set():
                    return

    with ThreadPoolExecutor(max(count, 1)) as pool:
        for first in range(count):
            pool.submit(ask, first)


def _sample() -> _Take:
    """The sample face, whose expressions come and go at rates of their own."""
    face = procedural_face(64)
    arrays = {name: getattr(face.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    shapes = {name: face.pose({name: 1.0}) for name in face.expressions}
    phase = np.arange(3000)[:, None] * (0.05 + 0.013 * np.arange(len(shapes)))
    return _Take(arrays, shapes, (0.5 - 0.5 * np.cos(phase)).astype(np.float32))


def _given(folder: Path) -> _Take:
    face, performance = np.load(folder / "face.npz"), np.load(folder / "performance.npz")
    arrays = {name: face[name] for name in ("positions", "faces", "uv", "face_uv")}
    moves = dict(zip(face["expr_names"].tolist(), face["expr_deltas"], strict=True))
    shapes = {name: face["positions"] + moves[name] for name in performance["names"].tolist()}
    return _Take(arrays, shapes, performance["weights"])


if __name__ == "__main__":
    main()
