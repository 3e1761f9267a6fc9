"""Mixed load on a server for a long time, and what it holds of memory and files meanwhile.

`PYTHONPATH=tests:$PYTHONPATH python -m attack.soak 1200` runs for twenty minutes and writes a line
every half minute. It ends with status 1 where what is resident at least grew by more than MOST a
minute after the first third, or where anything was answered by one of _FAILED.
"""

from __future__ import annotations

import random
import socket
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np

from api.asking import NPY, built, npy
from api.patch import obj, smile, upload
from attack.bombs import grey_png, images, lines, mesh
from attack.clients import not_reading, sending
from attack.served import Attacked, resident, serving

MIB = 1 << 20
# Bytes a minute.
MOST = 2 * MIB
WORKERS = 3
# 503 and 507 say that others hold what it needs.
_FAILED = (500, 502, 504)
METHODS = ("neutral", "redraw", "binned", "convolved")
FORMATS = ("npy", "f16", "exr", "exr16", "png")


class Worker(threading.Thread):
    """Asks for one thing after another, by a seed of its own."""

    def __init__(self, server: Attacked, seed: int, end: threading.Event) -> None:
        super().__init__(name=f"worker{seed}")
        self._server, self._end, self._chance = server, end, random.Random(seed)
        self.answers: Counter[int | str] = Counter()
        self._asset = ""

    def run(self) -> None:
        """Until it is told to end."""
        url = self._server.client.base_url
        with httpx.Client(base_url=url, timeout=120) as client:
            self._client = client
            self._asset = built(client, upload(obj(1.0 + self._chance.random())))
            kinds = (self._tile, self._frame, self._map, self._wrong, self._vanish, self._facts)
            while not self._end.is_set():
                kind = self._chance.choices((*kinds, self._replace), (40, 20, 5, 8, 3, 20, 2))[0]
                try:
                    kind()
                except httpx.TransportError as error:
                    self.answers[type(error).__name__] += 1

    def _count(self, response: httpx.Response) -> None:
        self.answers[response.status_code] += 1

    def _path(self, rest: str) -> str:
        return f"/v1/assets/{self._asset}/{rest}"

    def _query(self) -> dict[str, str]:
        pick = self._chance.choice
        return {"method": pick(METHODS), "format": pick(FORMATS)}

    def _tile(self) -> None:
        name, at = self._chance.choice(("neutral", "a", "b")), self._chance.randrange(4)
        path = self._path(f"frames/{name}/tiles/1001/0/{at}/{self._chance.randrange(4)}")
        self._count(self._client.get(path, params=self._query()))

    def _map(self) -> None:
        self._count(self._client.get(self._path("frames/a/maps/1001"), params=self._query()))

    def _frame(self) -> None:
        body = npy(smile(self._chance.random()))
        path = self._path(f"frames/{self._chance.choice('ab')}")
        self._count(self._client.put(path, content=body, headers=NPY))

    def _facts(self) -> None:
        places = ("graph", "mesh", "frames", "frames/a/stretch", "frames/a")
        self._count(self._client.get(self._path(self._chance.choice(places))))
        self._count(
            self._client.get(self._chance.choice(("/metrics", "/v1/memory", "/v1/devices")))
        )

    def _wrong(self) -> None:
        broken = [
            mesh("m.obj", lines(b"v 0 0 0\n", 2)),
            mesh("m.glb", b"glTF" + self._chance.randbytes(100)),
            mesh("m.npz", self._chance.randbytes(2000)),
            images(1, grey_png(64)[:-30], "png"),
        ]
        self._count(self._client.post("/v1/assets", files=self._chance.choice(broken)))
        nans = np.full((25, 3), np.nan, np.float32)
        self._count(self._client.put(self._path("frames/a"), content=npy(nans), headers=NPY))

    def _vanish(self) -> None:
        with suppress(OSError):
            if self._chance.random() < 0.5:
                gone = not_reading(self._server, self._path("frames/neutral/maps/1001"))
            else:
                gone = sending(self._server, 2 * MIB, 50 * MIB)
            if self._chance.random() < 0.5:
                gone.shutdown(socket.SHUT_RDWR)
            gone.close()
        self.answers["vanished"] += 1

    def _replace(self) -> None:
        self._count(self._client.delete(self._path("")[:-1]))
        self._asset = built(self._client, upload(obj(1.0 + self._chance.random())))


def growth(samples: list[tuple[float, int]]) -> float:
    """Bytes a minute between the middle and the last third, of what it holds while it holds little:
    large answers and builds come and go."""
    thirds = np.array_split(np.array(samples, float), 3)[1:]
    (early, low), (late, high) = ((t[:, 0].mean(), np.percentile(t[:, 1], 10)) for t in thirds)
    return float(60 * (high - low) / (late - early))


def facts(server: Attacked) -> str:
    """Memory of each process, files and threads of all."""
    files = sum(len(list(Path(f"/proc/{pid}/fd").glob("*"))) for pid in server.tree())
    threads = sum(len(list(Path(f"/proc/{pid}/task").glob("*"))) for pid in server.tree())
    parts = " + ".join(f"{resident(pid) / MIB:.0f}" for pid in server.tree())
    return f"{parts} by process, {files} files, {threads} threads"


def watched(server: Attacked, seconds: float) -> list[tuple[float, int]]:
    """Resident memory by time, every second; a line each minute."""
    began, samples = time.monotonic(), []
    while (now := time.monotonic() - began) < seconds:
        samples.append((now, server.resident()))
        if len(samples) % 30 == 1:
            sys.stdout.write(f"{now:5.0f} s: {samples[-1][1] / MIB:.0f} MiB, {facts(server)}\n")
            sys.stdout.flush()
        time.sleep(1)
    return samples


def soak(folder: Path, seconds: float) -> tuple[float, Counter[int | str]]:
    """Run; growth in bytes a minute, and answers by status."""
    with serving(folder) as server:
        end, answers = threading.Event(), Counter[int | str]()
        workers = [Worker(server, seed, end) for seed in range(WORKERS)]
        for worker in workers:
            worker.start()
        try:
            samples = watched(server, seconds)
        finally:
            end.set()
            for worker in workers:
                worker.join()
                answers += worker.answers
        assert server.client.get("/readyz").status_code == 200
    return growth(samples), answers


def main() -> int:
    """For as many seconds as the first argument says."""
    seconds = float(sys.argv[1]) if sys.argv[1:] else 1200.0
    with TemporaryDirectory() as folder:
        grown, answers = soak(Path(folder), seconds)
    counted = ", ".join(f"{status}: {count}" for status, count in sorted(answers.items(), key=str))
    sys.stdout.write(f"{sum(answers.values())} requests: {counted}\n")
    sys.stdout.write(f"{grown / MIB:+.2f} MiB a minute after the first third\n")
    # Beside those that say "later" where too many wait.
    wrong = [status for status in answers if isinstance(status, int) and status in _FAILED]
    return 1 if grown > MOST or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
