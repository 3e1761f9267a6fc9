"""How long tiles wait beside a synthesis: `PYTHONPATH=tests:$PYTHONPATH python -m
attack.measure_beside 1000000`.

While a real face grows so many wrinkles, a client draws tiles of 512² of another asset, each of a
frame that was not drawn before. The real face is that of the tests, see `face_data`.
"""

from __future__ import annotations

import io
import json
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from api.asking import NPY, built, npy
from api.patch import smile, upload
from attack.served import Attacked, serving
from face_data import load_face


def growing(server: Attacked, wrinkles: int) -> str:
    """The asset of a real face that begins to grow so many wrinkles."""
    mesh, file = load_face(), io.BytesIO()
    np.savez(file, positions=mesh.positions, faces=mesh.faces, uv=mesh.uv, face_uv=mesh.face_uv)
    settings = {"resolution": 4096, "graph": {"wrinkles": wrinkles}}
    files = {"mesh": ("face.npz", file.getvalue())}
    answer = server.client.post("/v1/assets", files=files, data={"settings": json.dumps(settings)})
    answer.raise_for_status()
    asset: str = answer.json()["id"]
    return asset


def waits(server: Attacked, small: str, large: str) -> list[float]:
    """Seconds of each tile of one asset until the other is built."""
    seconds: list[float] = []
    client = server.client
    while client.get(f"/v1/assets/{large}").json()["state"] not in ("ready", "failed"):
        body = npy(smile(len(seconds) % 1000 / 1000))
        client.put(f"/v1/assets/{small}/frames/a", content=body, headers=NPY).raise_for_status()
        began = time.perf_counter()
        path = f"/v1/assets/{small}/frames/a/tiles/1001/0/0/0"
        client.get(path, params={"method": "redraw"}).raise_for_status()
        seconds.append(time.perf_counter() - began)
    return seconds


def main() -> int:
    """Print percentiles of the waits."""
    wrinkles = int(sys.argv[1]) if sys.argv[1:] else 1_000_000
    with TemporaryDirectory() as folder, serving(Path(folder)) as server:
        small = built(server.client, upload(resolution=2048, tile_size=512))
        large, began = growing(server, wrinkles), time.monotonic()
        seconds = waits(server, small, large)
        state = server.client.get(f"/v1/assets/{large}").json()["state"]
        p50, p99, worst = 1000 * np.percentile(seconds, (50, 99, 100))
        sys.stdout.write(
            f"{state} after {time.monotonic() - began:.0f} s, {len(seconds)} tiles beside it: "
            f"p50 {p50:.0f} ms, p99 {p99:.0f}, worst {worst:.0f}\n"
        )
    return 0 if state == "ready" else 1


if __name__ == "__main__":
    sys.exit(main())
