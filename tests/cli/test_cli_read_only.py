"""`serve` where nothing but the store can be written, as in a container with a read-only root."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np
import pytest

from cli.running import OWN_MOUNTS
from exr_images import exr
from meshes import SmallMesh
from rhytid_client import Client

pytestmark = pytest.mark.release

# The store is at /mnt; every other place that is a file system for temporary files is read-only.
SCRIPT = """
set -e
mount --make-rprivate /
mount --bind "$STORE" /mnt
for place in /tmp /var/tmp /usr/tmp /dev/shm /run /home /root; do
  if mountpoint -q "$place"; then mount -o remount,bind,ro "$place"; fi
done
mount -o remount,bind,ro /
cd /
for place in / /tmp /var/tmp /dev/shm; do
  if touch "$place/rhytid-test" 2>/dev/null; then echo "$place can be written"; exit 9; fi
done
exec "$PYTHON" -m rhytid serve --port 0 --store /mnt
"""


@contextmanager
def read_only(store: Path, **changes: str) -> Iterator[str]:
    """The address of a server that can write to its store alone."""
    kept = ("PATH", "PYTHONPATH", "RHYTID_DEVICE", "OCL_ICD_VENDORS", "LD_LIBRARY_PATH")
    environment = {name: os.environ[name] for name in kept if name in os.environ}
    environment |= {"STORE": str(store), "PYTHON": sys.executable, **changes}
    command = [*OWN_MOUNTS, "bash", "-c", SCRIPT]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, env=environment, text=True, stdout=pipe, stderr=subprocess.STDOUT
    ) as running:
        try:
            assert running.stdout is not None
            words = running.stdout.readline().split()
            assert "on" in words, " ".join(words) + running.stdout.read()
            yield words[words.index("on") + 1].rstrip(",")
        finally:
            running.kill()


@pytest.mark.slow
@pytest.mark.skipif(not OWN_MOUNTS, reason="needs a mount namespace of its own")
@pytest.mark.parametrize(
    "changes",
    [{}, {"HOME": "/nonexistent", "TMPDIR": "/nowhere", "XDG_CACHE_HOME": "/proc/none"}],
    ids=["no home", "homes that are not there"],
)
def test_serve_starts_builds_and_draws(
    tmp_path: Path, small_mesh: SmallMesh, changes: dict[str, str]
) -> None:
    painted = {1001: exr(np.full((64, 64), 0.5, np.float32))}
    settings = {"unit": "ft", "resolution": 256, "tile_size": 64, "graph": {"wrinkles": 200}}
    with read_only(tmp_path, **changes) as url, Client(url) as client:
        assert httpx.get(f"{url}/readyz", timeout=120).json() == {"status": "ready"}
        mesh = small_mesh._asdict()
        asset = client.wait(client.create_asset(mesh, settings=settings, stiffness=painted))
        assert client.tile(asset, "neutral", 1001, 0, 0, 0).array.any()
    assert {place.name for place in tmp_path.iterdir()} >= {"assets", "cache", "partial"}
    assert any((tmp_path / "cache" / "pocl").rglob("*.so"))
