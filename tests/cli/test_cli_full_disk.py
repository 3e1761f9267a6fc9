"""`serve` with its store on a full file system: 507 with the reason, and nothing half-written."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import httpx
import numpy as np
import pytest

from cli.running import OWN_MOUNTS
from meshes import SmallMesh
from rhytid_client import Client

MIB = 1 << 20
SIZE = 4 * MIB
SCRIPT = f"""
set -e
mount --make-rprivate /
mount -t tmpfs -o size={SIZE} tmpfs /mnt
exec "$PYTHON" -m rhytid serve --port 0 --store /mnt
"""
WORDS = "the disk of the server is full: free some of it"


class Small(NamedTuple):
    """A server, and its store as this process sees it."""

    url: str
    store: Path

    def free(self) -> int:
        """Bytes that are free."""
        found = os.statvfs(self.store)
        return found.f_bavail * found.f_frsize

    @contextmanager
    def filled(self, left: int) -> Iterator[None]:
        """Within the block, so many bytes are free."""
        ballast = self.store / "ballast"
        ballast.write_bytes(bytes(self.free() - left))
        try:
            yield
        finally:
            ballast.unlink()


@contextmanager
def small_disk() -> Iterator[Small]:
    command = [*OWN_MOUNTS, "bash", "-c", SCRIPT]
    environment = {**os.environ, "PYTHON": sys.executable}
    with subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE) as running:
        try:
            assert running.stdout is not None
            words = running.stdout.readline().split()
            url = words[words.index("on") + 1].rstrip(",")
            yield Small(url, Path(f"/proc/{running.pid}/root/mnt"))
        finally:
            running.kill()


@pytest.fixture(scope="module")
def disk() -> Iterator[Small]:
    with small_disk() as found:
        yield found


def refused(answer: httpx.Response) -> None:
    assert answer.status_code == 507, answer.text
    assert answer.json()["type"] == "urn:rhytid:problem:disk-full"
    assert answer.json()["detail"].startswith(WORDS)
    assert "/mnt" not in answer.text


SETTINGS = {"unit": "ft", "resolution": 256, "tile_size": 64, "graph": {"wrinkles": 200}}


@pytest.mark.slow
@pytest.mark.skipif(not OWN_MOUNTS, reason="needs a mount namespace of its own")
def test_a_full_disk_is_told_and_keeps_nothing(
    disk: Small, small_mesh: SmallMesh, tmp_path: Path
) -> None:
    with Client(disk.url) as client, httpx.Client(base_url=disk.url, timeout=60) as plain:
        asset = client.wait(client.create_asset(small_mesh._asdict(), settings=SETTINGS))
        path = f"/v1/assets/{asset.id}"
        snapshot = plain.get(f"{path}/snapshot").content
        listed, free = plain.get("/v1/assets").json(), disk.free()

        def unchanged() -> None:
            assert plain.get("/v1/assets").json() == listed
            assert disk.free() == free
            assert not any((disk.store / "partial").iterdir())
            assert [home.name for home in (disk.store / "assets").iterdir()] == [asset.id]

        # Uploads whose bodies are larger than the disk.
        np.savez(tmp_path / "large.npz", **small_mesh._asdict(), frames=np.zeros((1, 2**21), "f4"))
        for file in ((tmp_path / "large.npz").read_bytes(), bytes(2 * SIZE)):
            refused(plain.post("/v1/assets", files={"mesh": ("mesh.npz", file)}))
            unchanged()
        moved = {**small_mesh._asdict(), "positions": small_mesh.positions * 2}
        np.savez(tmp_path / "moved.npz", **moved)
        small = {"mesh": ("mesh.npz", (tmp_path / "moved.npz").read_bytes())}
        with disk.filled(left=8192):
            refused(plain.post("/v1/assets", files=small))
            graph = ("graph.safetensors", client.graph(asset))
            refused(plain.post("/v1/assets", files={**small, "graph": graph}))
        unchanged()
        with disk.filled(left=0):
            refused(plain.patch(path, json={"depth": 0.5}))
            assert plain.get(path).json()["settings"] == listed[0]["settings"]
        unchanged()
        client.delete_asset(asset)
        with disk.filled(left=len(snapshot) // 2):
            headers = {"Content-Type": "application/x-tar"}
            refused(plain.post("/v1/snapshots", content=snapshot, headers=headers))
            assert plain.get("/v1/assets").json() == []
            assert not any((disk.store / "assets").iterdir())
            assert not any((disk.store / "partial").iterdir())
        assert plain.post("/v1/snapshots", content=snapshot, headers=headers).status_code == 201
        assert plain.get("/v1/memory").json()["spool"]["used"] == 0
