"""Packages of scanned skin: the residual as a texture, and all else as of grown skin."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from engine.engines import built, new_asset, running
from exports.skin_package.conftest import write_package
from exports.skin_package.ktx2 import read_ktx2
from pipeline.scenes import sheet
from rhytid.domain.residual import Residual
from rhytid.engine import packages
from rhytid.engine.engine import Engine
from rhytid.engine.messages import Package
from rhytid.exports.skin_package import texture_arrays

UDIMS, SIDE = (1001, 1002, 1011, 1012), 256


def residual() -> Residual:
    """Of two UDIMs of four, of other ranges: 1011 lies above the surface throughout."""
    rng = np.random.default_rng(8)
    found = {1001: 0.004 * rng.normal(size=(SIDE, SIDE)), 1011: rng.uniform(0.2, 0.3, (SIDE, SIDE))}
    return Residual.of({udim: map.astype(np.float32) for udim, map in found.items()})


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Engine, str, str]]:
    """An engine with a scanned skin, and with the same without its residual."""
    new = new_asset(sheet(udims=2))
    with running(tmp_path_factory.mktemp("scanned")) as engine:
        yield engine, built(engine, replace(new, residual=residual())), built(engine, new)


def manifest(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "manifest.json").read_bytes())
    return found


def heights(folder: Path, udim: int) -> NDArray[np.float64]:
    """(pages, n, n) as the shader reads them."""
    described = manifest(folder)["residual"]
    found = read_ktx2(folder / described["textures"]["files"][str(udim)]).levels[0]
    assert found.dtype == np.uint16
    return described["first"] + described["step"] * found.astype(np.float64)


def test_its_texture_is_the_residual(made: tuple[Engine, str, str], tmp_path: Path) -> None:
    engine, scanned, plain = made
    write_package(engine, scanned, tmp_path / "scanned")
    write_package(engine, plain, tmp_path / "plain")
    of = {name: manifest(tmp_path / name) for name in ("scanned", "plain")}
    given, step = residual(), of["scanned"]["residual"]["step"]
    for udim in UDIMS:
        want = np.zeros((SIDE, SIDE))
        if udim in given.codes:
            to, middle = given.steps[udim]
            want = middle + to * given.codes[udim].astype(np.float64)
        assert np.abs(heights(tmp_path / "scanned", udim)[0] - want).max() <= 0.5 * step + 2e-8
    assert step < 0.35 / 65535

    assert [of[name]["version"] for name in of] == [3, 2]
    assert "residual" not in of["plain"]
    grown = of["scanned"]["scale"] - of["plain"]["scale"]
    assert grown == pytest.approx(given.largest)
    more = of["scanned"]["texture_bytes"] - of["plain"]["texture_bytes"]
    assert more == of["scanned"]["residual"]["textures"]["bytes"]
    for file in (tmp_path / "plain").rglob("*"):
        same = file.relative_to(tmp_path / "plain")
        if file.is_file() and same.parts[0] != "shaders" and same.suffix in (".ktx2", ".glb"):
            assert file.read_bytes() == (tmp_path / "scanned" / same).read_bytes(), same


def test_only_its_shaders_know_it(made: tuple[Engine, str, str], tmp_path: Path) -> None:
    engine, *ids = made
    for id, has in zip(ids, (True, False), strict=True):
        write_package(engine, id, tmp_path)  # the second in place of the first
        found = manifest(tmp_path)
        assert ("rhytid_residual" in found["shaders"]["wgsl"]["bindings"]) == has
        for shaders in found["shaders"].values():
            for name, file in shaders["passes"].items():
                text = (tmp_path / file).read_text()
                assert ("rhytid_residual" in text) == (has and name in ("height", "cushion")), file
        for file in found["materialx"]["implementations"].values():
            assert ("rhytid_residual" in (tmp_path / file).read_text()) == has
        assert any((tmp_path / "textures").glob("residual.*")) == has


def test_one_udim_keeps_its_codes_over_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(texture_arrays, "MOST_SIDE", 64)
    monkeypatch.setattr(texture_arrays, "MOST_LAYERS", 1000)
    monkeypatch.setattr(packages, "PATIENCE", 60.0)
    given = Residual.of({1001: residual().heights(1011)})
    with running(tmp_path / "store") as engine:
        asset = built(engine, replace(new_asset(), residual=given))
        write_package(engine, asset, tmp_path / "skin", levels=2)
        served = engine.packages.of(asset)
    file = tmp_path / "skin" / "textures" / "residual.1001.ktx2"
    finest, means = read_ktx2(file).levels
    codes = given.codes[1001].astype(int) + 32768
    assert np.array_equal(finest[4 * 1 + 2], codes[64:128, 128:192])
    assert np.abs(means[0] - codes[:64, :64].reshape(32, 2, 32, 2).mean((1, 3))).max() <= 0.5
    assert isinstance(served, Package)
    assert "textures/residual.1001.ktx2" in served.files
