"""One Blender for all tests, with the built package installed, and one service beside it."""

from __future__ import annotations

import os
import shlex
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Blender reads it when it is imported: nothing of the user's is read or written.
_HOME = tempfile.TemporaryDirectory(prefix="rhytid-blender-")
os.environ["BLENDER_USER_RESOURCES"] = _HOME.name

import bpy  # noqa: E402
import pytest  # noqa: E402

ADDON = "bl_ext.user_default.rhytid"
BUILD = Path(__file__).resolve().parents[1] / "build.py"
PATIENCE_SECONDS = 120.0


@pytest.fixture(scope="session")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package, built and validated as it is released."""
    out = tmp_path_factory.mktemp("package")
    told = subprocess.run(
        [sys.executable, str(BUILD), "--out", str(out)],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    return Path(told.splitlines()[-1])


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a service run by the command of RHYTID_SERVE."""
    with served(tmp_path_factory.mktemp("store")) as url:
        yield url


def command() -> list[str]:
    """That of RHYTID_SERVE."""
    return shlex.split(os.environ.get("RHYTID_SERVE", "rhytid serve"))


@contextmanager
def served(store: Path) -> Iterator[str]:
    """The address of a service over a store; it ends with the block."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    place = ["--host", "127.0.0.1", "--port", str(port), "--store", str(store)]
    with subprocess.Popen([*command(), *place], stderr=subprocess.DEVNULL) as process:
        try:
            _await(port, process)
            yield f"http://127.0.0.1:{port}"
        finally:
            process.terminate()


def _await(port: int, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + PATIENCE_SECONDS
    while time.monotonic() < end:
        assert process.poll() is None, "the command of RHYTID_SERVE ended"
        with socket.socket() as tried:
            if tried.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)
    raise AssertionError("the service does not listen")


@pytest.fixture(scope="session")
def installed(package: Path) -> None:
    """The package, installed from its file and enabled."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        filepath=str(package), repo="user_default", enable_on_install=True
    )
    assert ADDON in bpy.context.preferences.addons


@pytest.fixture
def blender(installed: None, service: str) -> Iterator[bpy.types.Scene]:
    """An empty scene, the extension's server the one beside."""
    from bl_ext.user_default.rhytid import state

    state.forget()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    preferences().server = service
    yield bpy.context.scene
    preferences().server = service


def preferences() -> object:
    """Those of the extension."""
    return bpy.context.preferences.addons[ADDON].preferences


@pytest.fixture
def nobody(blender: bpy.types.Scene) -> None:
    """No server is there."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        preferences().server = f"http://127.0.0.1:{free.getsockname()[1]}"
