"""Maps by a fleet beside those of one server: `python -m rhytid_lab.bench.fleet_maps shot.npz`.

Both servers run at once on loopback and are asked in turns, by clients of this process: as many
heads as there are replicas, each on one of its own, share the frames of the shot. Each turn sends
the frames anew and asks for the map of each. Every map of the fleet is compared with that of the
server.

Time beyond kernels is what the maps took beyond the sum of kernel time by the devices that drew:
all of Ray, HTTP, queues and encoding. Processor time is of the whole machine. Linux alone.
POCL_MAX_PTHREAD_COUNT=1 gives each device one core.
"""

from __future__ import annotations

import argparse
import http.client
import io
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray
from prometheus_client.parser import text_string_to_metric_families

from rhytid.device.figures import STAGES
from rhytid.errors import RhytidError
from rhytid_client import Client, RhytidWarning
from rhytid_lab.bench.timed_command import machine_seconds
from rhytid_lab.server import connected, served

# Seconds until a replica has said what it has done; heads that are tried for one on each replica.
_REPORTED, _TRIES = 5.0, 40
Shot = Mapping[str, NDArray[np.generic]]


@dataclass
class Side:
    """A server.  devices: that draw.  heads: ids of assets, in the order of their numbers."""

    name: str
    client: Client
    url: str
    devices: int
    heads: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Turn:
    """Maps of all frames.

    sent, maps, processor, kernels: seconds.  frames, nbytes: of what was sent, and of the maps.
    digests: of each map.
    """

    sent: float
    maps: float
    processor: float
    kernels: float
    frames: int
    nbytes: int
    digests: tuple[bytes, ...]


def main() -> None:
    """Print a line for each server and turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shot", type=Path, help="npz with neutral, faces, uv, face_uv and frames")
    parser.add_argument("--resolution", type=int, default=2048)
    parser.add_argument("--wrinkles", type=int, default=60_000)
    parser.add_argument("--method", default="redraw")
    parser.add_argument("--replicas", type=int, default=2, help="and heads")
    parser.add_argument("--clients", type=int, default=4)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--device", default="0", help="number of the device")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", RhytidWarning)  # of the UV, once for each head and server
    with np.load(arguments.shot) as file:
        shot = dict(file)
    with ExitStack() as stack:
        sides = list(_sides(stack, arguments))
        _build(sides, shot, arguments)
        wanted: tuple[bytes, ...] = ()
        for turn in range(arguments.turns):
            for side in sides:
                found = _turn(side, shot, arguments)
                wanted = wanted or found.digests
                print(f"turn {turn}, {side.name}: {_words(side, found, wanted)}")  # noqa: T201


def _sides(stack: ExitStack, arguments: argparse.Namespace) -> Iterator[Side]:
    replicas = arguments.replicas
    options = {"one server": (), f"{replicas} replicas": ("--ray", "--replicas", str(replicas))}
    for name, more in options.items():
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="rhytid-bench-"))
        url = stack.enter_context(served(Path(folder) / "store", arguments.device, *more))
        client = stack.enter_context(connected(url))
        yield Side(name, client, url, replicas if more else 1)


def _build(sides: list[Side], shot: Shot, arguments: argparse.Namespace) -> None:
    """The same heads on every server, each on a replica of its own."""
    fleet = sides[-1]
    graph = {"wrinkles": arguments.wrinkles}
    settings = {"resolution": arguments.resolution, "graph": graph}
    taken: set[str] = set()
    for number in range(_TRIES):
        made = fleet.client.create_asset(_head(shot, number), settings=settings)
        replica = (made.job or "").rpartition("-")[2]
        if replica in taken:
            fleet.client.delete_asset(made)
            continue
        taken.add(replica)
        for side in sides:
            own = side.client.create_asset(_head(shot, number), settings=settings)
            side.heads.append(side.client.wait(own).id)
        if len(taken) == arguments.replicas:
            return
    raise RhytidError(f"{_TRIES} heads lie on {len(taken)} of {arguments.replicas} replicas")


def _head(shot: Shot, number: int) -> dict[str, NDArray[np.generic]]:
    """The face of the shot, a little larger for each number: another asset."""
    positions = np.asarray(shot["neutral"], np.float32) * np.float32(1 + number / 1000)
    return {"positions": positions, **{name: shot[name] for name in ("faces", "uv", "face_uv")}}


def _turn(side: Side, shot: Shot, arguments: argparse.Namespace) -> Turn:
    query = f"method={arguments.method}&format=npy"
    frames = shot["frames"]
    paths = [
        f"/v1/assets/{side.heads[number % len(side.heads)]}/frames/{number:04d}"
        for number in range(len(frames))
    ]
    start = time.perf_counter()
    for path, positions in zip(paths, frames, strict=True):
        _asked(side.url, "PUT", path, _npy(positions))
    sent = time.perf_counter() - start
    time.sleep(_REPORTED)
    before, busy, start = _kernels(side), machine_seconds(), time.perf_counter()
    with ThreadPoolExecutor(arguments.clients) as pool:
        maps = [f"{path}/maps/1001?{query}" for path in paths]
        found = list(pool.map(lambda path: _digest(side.url, path), maps))
    took, computed = time.perf_counter() - start, machine_seconds() - busy
    time.sleep(_REPORTED)
    nbytes = sum(size for _, size in found)
    digests = tuple(digest for digest, _ in found)
    kernels = _kernels(side) - before
    return Turn(sent, took, computed, kernels, frames.nbytes, nbytes, digests)


def _npy(positions: NDArray[np.generic]) -> bytes:
    file = io.BytesIO()
    np.save(file, np.asarray(positions, np.float32))
    return file.getvalue()


def _digest(url: str, path: str) -> tuple[bytes, int]:
    body = _asked(url, "GET", path)
    return sha256(body).digest(), len(body)


def _asked(url: str, method: str, path: str, body: bytes | None = None) -> bytes:
    headers = {} if body is None else {"Content-Type": "application/x-npy"}
    place = urlsplit(url)
    connection = http.client.HTTPConnection(place.hostname or "", place.port)
    with closing(connection):
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
    if answer.status >= 300:
        raise RhytidError(f"{method} {path}: status {answer.status}, {content[:200]!r}")
    return content


def _kernels(side: Side) -> float:
    """Seconds that the devices of a server have spent in kernels."""
    text = _asked(side.url, "GET", "/metrics").decode()
    return sum(
        sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.name == "rhytid_stage_seconds_sum" and sample.labels["stage"] == STAGES[3]
    )


def _words(side: Side, turn: Turn, wanted: tuple[bytes, ...]) -> str:
    beyond = turn.maps - turn.kernels / side.devices
    same = sum(one == other for one, other in zip(turn.digests, wanted, strict=True))
    return (
        f"{turn.maps:.2f} s, kernels {turn.kernels:.2f} s, beyond kernels {beyond:.2f} s "
        f"({100 * side.devices * beyond / turn.kernels:.0f} %), processor {turn.processor:.1f} s; "
        f"{turn.frames / 1e6:.1f} MB of frames sent in {turn.sent:.2f} s, "
        f"{turn.nbytes / 1e6:.1f} MB of maps came; {same} of {len(wanted)} equal"
    )


if __name__ == "__main__":
    main()
