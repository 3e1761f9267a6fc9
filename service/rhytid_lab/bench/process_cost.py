"""What the process of the device adds to a tile: `python -m rhytid_lab.bench.process_cost`.

Two real servers on loopback, one with its engine in a process of its own and one without, are asked
for the same tile in turns by one client, so that both meet the same noise of the machine. With
`--ray`: one with its engine in a process of its own, and one over a replica of Ray Serve.
"""

from __future__ import annotations

import argparse
import http.client
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from rhytid_lab.samples.face import procedural_face
from rhytid_lab.server import connected, served

TILE, RESOLUTION, WRINKLES = 512, 2048, 20_000
METHODS = ("redraw", "binned")
WARM_UP = 20
# Of `rhytid serve`, for each of the two.
SERVERS = {"in process": ("--in-process",), "own process": ()}
OF_RAY = {"own process": (), "replica": ("--ray",)}


def main() -> None:
    """Print medians, and the difference, by method."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="0", help="number of the device")
    parser.add_argument("--requests", type=int, default=400, help="of each server and method")
    parser.add_argument("--ray", action="store_true", help="compare with a replica of Ray Serve")
    arguments = parser.parse_args()
    servers = OF_RAY if arguments.ray else SERVERS
    print(f"one tile of {TILE}², npy, milliseconds")  # noqa: T201
    with ExitStack() as stack:
        paths = [
            stack.enter_context(_tile(arguments.device, options)) for options in servers.values()
        ]
        for method in METHODS:
            times = _in_turns(paths, method, arguments.requests)
            listed = [
                f"{name} {_figures(found)}" for name, found in zip(servers, times, strict=True)
            ]
            difference = statistics.median(times[1]) - statistics.median(times[0])
            print(f"{method}: {', '.join(listed)}, p50 {1000 * difference:+.3f}")  # noqa: T201


@contextmanager
def _tile(device: str, options: Sequence[str]) -> Iterator[tuple[http.client.HTTPConnection, str]]:
    """A connection to a new server, and the path of a tile there."""
    face = procedural_face(64)
    arrays = {name: getattr(face.mesh, name) for name in ("positions", "faces", "uv", "face_uv")}
    settings = {"resolution": RESOLUTION, "tile_size": TILE, "graph": {"wrinkles": WRINKLES}}
    with (
        tempfile.TemporaryDirectory() as folder,
        served(Path(folder) / "store", device, *options) as url,
        connected(url) as client,
    ):
        asset = client.wait(client.create_asset(arrays, settings=settings))
        client.put_frame(asset, "smile", face.pose({"smile": 1.0}))
        at = urlsplit(url)
        connection = http.client.HTTPConnection(at.hostname or "", at.port)
        yield connection, f"/v1/assets/{asset.id}/frames/smile/tiles/1001/0/1/1?format=npy"
        connection.close()


def _in_turns(
    paths: Sequence[tuple[http.client.HTTPConnection, str]], method: str, requests: int
) -> list[list[float]]:
    """Seconds of each request, by server."""
    times: list[list[float]] = [[] for _ in paths]
    for turn in range(WARM_UP + requests):
        for (connection, path), found in zip(paths, times, strict=True):
            start = time.perf_counter()
            connection.request("GET", f"{path}&method={method}")
            answer = connection.getresponse()
            answer.read()
            seconds = time.perf_counter() - start
            if answer.status != 200:
                raise SystemExit(f"{method}: status {answer.status}")
            if turn >= WARM_UP:
                found.append(seconds)
    return times


def _figures(seconds: Sequence[float]) -> str:
    p99 = statistics.quantiles(seconds, n=100)[-1]
    return f"p50 {1000 * statistics.median(seconds):.3f} p99 {1000 * p99:.3f}"


if __name__ == "__main__":
    main()
