"""The package: what is in it, and that it comes and goes without a trace."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import pytest

from conftest import ADDON


def test_package_holds_the_sdk_and_the_licence(package: Path) -> None:
    with zipfile.ZipFile(package) as archive:
        names = archive.namelist()
        manifest = archive.read("blender_manifest.toml").decode()
    (wheel,) = [name for name in names if name.endswith(".whl")]
    assert wheel.startswith("wheels/rhytid_client-")
    assert wheel.endswith("-py3-none-any.whl")
    assert "LICENSE" in names
    assert f'"./{wheel}"' in manifest


def test_sdk_is_that_of_the_package(installed: None) -> None:
    import rhytid_client

    home = Path(rhytid_client.__file__)
    assert home.is_relative_to(Path(bpy.utils.user_resource("EXTENSIONS")))
    assert "httpx" not in sys.modules


def test_handlers_and_properties_come_and_go(installed: None) -> None:
    def present() -> list[bool]:
        names = ("frame_change_post", "render_pre", "load_post", "save_pre", "save_post")
        handlers = [getattr(bpy.app.handlers, name) for name in names]
        ours = [[h for h in found if h.__module__.startswith(ADDON)] for found in handlers]
        return [hasattr(bpy.types.Object, "rhytid"), *(len(found) == 1 for found in ours)]

    assert all(present())
    bpy.ops.preferences.addon_disable(module=ADDON)
    assert not any(present())
    bpy.ops.preferences.addon_enable(module=ADDON)
    assert all(present())


@pytest.mark.parametrize("end", ["addon_disable", "addon_enable"])
def test_python_ends_as_it_does_without_the_extension(installed: None, end: str) -> None:
    script = f"import bpy; bpy.ops.preferences.{end}(module={ADDON!r}); print('done')"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert "done" in run.stdout, run.stderr
    assert run.returncode == 0


def test_connection(blender: bpy.types.Scene) -> None:
    assert bpy.ops.rhytid.connect() == {"FINISHED"}


def test_server_that_is_gone(nobody: None) -> None:
    with pytest.raises(RuntimeError, match=r"No answer from http://127.0.0.1:.*rhytid serve"):
        bpy.ops.rhytid.connect()


def test_addresses_as_they_are_written(blender: bpy.types.Scene) -> None:
    from conftest import preferences

    preferences().server = f" {preferences().server.removeprefix('http://')}"
    assert bpy.ops.rhytid.connect() == {"FINISHED"}
    for written in ("http://127.0.0.1:8717x", "ftp://127.0.0.1", ""):
        preferences().server = written
        with pytest.raises(RuntimeError, match="is not the address of a server: it is like http"):
            bpy.ops.rhytid.connect()
