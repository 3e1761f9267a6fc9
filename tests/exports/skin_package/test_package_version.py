"""The version of packages follows all that they are made of."""

from __future__ import annotations

from pathlib import Path

import pytest

import rhytid_viewer
from rhytid.exports.skin_package.package import package_version
from rhytid.support import build_identity


def test_it_changes_with_shaders_and_with_the_viewer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "runtime").mkdir()
    shader = tmp_path / "runtime" / "skin.glsl"
    shader.write_text("void main() {}\n")
    monkeypatch.setattr(build_identity, "files", lambda package: tmp_path)
    now = package_version.__wrapped__
    first = now()
    assert now() == first
    shader.write_text("void main() { }\n")
    second = now()
    page = {**rhytid_viewer.laid_out(), "index.html": b"<!doctype html>"}
    monkeypatch.setattr(rhytid_viewer, "laid_out", lambda: page)
    assert len({first, second, now()}) == 3


def test_it_reads_what_is_handed_out(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    monkeypatch.setattr(build_identity, "_add", lambda digest, name, data: read.append(name))
    package_version.__wrapped__()
    assert {
        "rhytid.exports/skin_package/runtime/skin.glsl",
        "rhytid.exports/skin_package/package.py",
        "rhytid.formats/ktx2.py",
        "rhytid.exports/meshes.py",
        "index.html",
    } <= set(read)
    assert not any("__pycache__" in name for name in read)
