"""Drivers start, and compile, where the user's own cache folder cannot be written."""

from __future__ import annotations

import json
import os
import pwd
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.release

# `rhytid devices`, and a small kernel; of a user whom the password file does not know.
CHILD = """
import os, pwd, sys
def unknown(uid):
    raise KeyError(uid)
if sys.argv[1] == "unknown":
    pwd.getpwuid = unknown
from rhytid.cli import main
assert main(["devices", "--json"]) == 0
import numpy as np
from rhytid.device.runtime import Device
from rhytid.device.select import choose
device = Device(choose(os.environ.get("RHYTID_DEVICE")), 1 << 20)
text = "__kernel void twice(__global float *x) { x[get_global_id(0)] *= 2.0f; }"
buffer = device.full(4, np.float32(2.0))
device.programs.build(text, []).twice(device._queue, (4,), None, buffer.handle)
print(device.read(buffer, (4,), np.float32).tolist(), os.environ.get("XDG_CACHE_HOME"))
"""
HERE = object()  # a folder that can be written


def started(tmp_path: Path, user: str = "known", **changes: str | object | None) -> str | None:
    """XDG_CACHE_HOME as it was for the drivers of a process that found a device and computed."""
    (tmp_path / "file").touch()
    (tmp_path / "work").mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path), "RHYTID_CACHE": str(tmp_path / "own")}
    for name in ("HOME", "XDG_CACHE_HOME", "POCL_CACHE_DIR"):
        environment.pop(name, None)
        value = changes.get(name)
        if value is not None:
            text = str(tmp_path / "here" if value is HERE else value)
            environment[name] = text.replace("FILE", str(tmp_path / "file"))
    child = subprocess.run(
        [sys.executable, "-c", CHILD, user], env=environment, cwd=tmp_path / "work",
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert child.returncode == 0, child.stderr
    assert "failed with an exception" not in child.stderr
    assert not any((tmp_path / "work").iterdir())
    *listed, computed = child.stdout.splitlines()
    assert any(device["used"] for device in json.loads("".join(listed)))
    values, folder = computed.split("] ")
    assert values == "[4.0, 4.0, 4.0, 4.0"
    return None if folder == "None" else folder


# Each test starts a process that compiles.
UNWRITABLE = {
    "home that is missing": {"HOME": "/proc/missing"},
    "home below a file": {"HOME": "FILE/home"},
    "cache folder that is missing": {"HOME": HERE, "XDG_CACHE_HOME": "/proc/missing"},
    "cache folder below a file": {"HOME": HERE, "XDG_CACHE_HOME": "FILE/cache"},
    "unknown user": {"user": "unknown"},
}


@pytest.mark.slow
@pytest.mark.parametrize("changes", UNWRITABLE.values(), ids=UNWRITABLE)
def test_a_folder_of_our_own_serves(tmp_path, changes):
    found = started(tmp_path, **changes)
    assert found == str(tmp_path / f"rhytid-cache-{os.getuid()}")
    assert Path(found).stat().st_mode & 0o777 == 0o700


@pytest.mark.slow
def test_what_can_be_written_is_left_alone(tmp_path):
    assert started(tmp_path, HOME=HERE) is None


@pytest.mark.slow
def test_the_cache_folder_of_the_user_goes_before_the_home(tmp_path):
    found = started(tmp_path, HOME="/proc/missing", XDG_CACHE_HOME=HERE)
    assert found == str(tmp_path / "here")


@pytest.mark.slow
def test_without_a_home_in_the_environment_the_user_still_has_one(tmp_path):
    found = started(tmp_path)
    assert found == str(Path(pwd.getpwuid(os.getuid()).pw_dir) / ".cache")


@pytest.mark.slow
def test_a_folder_that_others_can_write_is_not_taken(tmp_path):
    taken = tmp_path / f"rhytid-cache-{os.getuid()}"
    taken.mkdir()
    taken.chmod(0o777)
    found = started(tmp_path, HOME="/proc/missing")
    assert found is not None
    assert found != str(taken)
    assert found.startswith(str(tmp_path))
    assert not Path(found).exists()  # it went with the process
    assert not any(taken.iterdir())


def test_with_nowhere_to_write_pyopencl_goes_without(monkeypatch):
    from rhytid.device import caches

    monkeypatch.setattr(caches, "_own_folder", lambda: None)
    for name, value in (("PYOPENCL_NO_CACHE", "0"), ("XDG_CACHE_HOME", "/proc/missing")):
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("PYOPENCL_NO_CACHE")
    caches.provide_cache_folder()
    assert os.environ["PYOPENCL_NO_CACHE"] == "1"
    assert os.environ["XDG_CACHE_HOME"] == "/proc/missing"
