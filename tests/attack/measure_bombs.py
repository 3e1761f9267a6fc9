"""What bombs take of a server: `PYTHONPATH=tests:$PYTHONPATH python tests/attack/measure_bombs.py`.

A row for each bomb: bytes sent, the most memory above what the server held before, processor time,
the answer. Then four of one at once.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx

from attack.bombs import BOMBS, MIB, Files
from attack.served import Attacked, Peak, serving


def sent(server: Attacked, files: Files) -> str:
    """What a server says of an upload."""
    try:
        with httpx.Client(base_url=server.client.base_url, timeout=600) as client:
            response = client.post("/v1/assets", files=files)
    except httpx.TransportError as exc:
        return type(exc).__name__
    detail = response.json().get("detail", "")
    return f"{response.status_code} {detail[:90]}"


def row(server: Attacked, name: str, files: Files, times: int = 1) -> str:
    """A row of the table."""
    size = sum(len(data) for _, (_, data) in files)
    with Peak(server) as peak, ThreadPoolExecutor(times) as pool:
        answers = list(pool.map(lambda _: sent(server, files), range(times)))
    seconds, more = f"{peak.seconds:.1f} s", f"{peak.more / MIB:,.0f} MiB"
    said = " / ".join(sorted(set(answers)))
    return f"| {name} | {size / MIB:.2f} MiB | {more} | {seconds} | {said} |"


def main() -> None:
    """Measure those whose names begin with an argument; all without."""
    wanted = tuple(sys.argv[1:]) or ("",)
    with TemporaryDirectory() as folder:
        for name, make in BOMBS.items():
            if name.startswith(wanted):
                files = make()
                with serving(Path(folder)) as server:
                    sys.stdout.write(row(server, name, files) + "\n")
                    sys.stdout.flush()
        if "" in wanted or "four" in wanted:
            for name in ("obj: 64 MiB of vertices", "npz: 16.6 million vertices of zeros"):
                files = BOMBS[name]()
                with serving(Path(folder)) as server:
                    sys.stdout.write(row(server, f"{name}, four at once", files, 4) + "\n")


if __name__ == "__main__":
    main()
