"""The shaders of a package, in OpenGL, draw what `binned` draws. Run by `pytest -m peers`."""

from __future__ import annotations

import json
import logging
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import face_data
import rhytid_viewer
from engine.engines import BINNED, built, new_asset, running
from exports.skin_package.conftest import Written, write_package
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.events import MOST_KIND
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.residual import Residual
from rhytid.engine.engine import Engine
from rhytid.engine.messages import NewAsset
from rhytid.exports.skin_package import texture_arrays
from rhytid.exports.skin_package.runtime import stretch
from rhytid.exports.skin_package.runtime.folds import Folds

pytestmark = pytest.mark.peers
log = logging.getLogger(__name__)
DIALECTS = ("glsl-es-300", "glsl-410", "hlsl", "wgsl")
# Codes of 8 bits: what float32 rounds, and codes of grain below -127.
CLOSE = 1.0
ONE_BIN = {"count": 1, "samples": 5, "merge": "soft"}
MANY_BINS = {"count": 8, "samples": 5, "merge": "signed", "depth_factored": True, "tilt": True}
SCENES: list[tuple[dict[str, Any], float]] = [
    ({"preset": "paper"}, 1e-3),
    ({"preset": "best"}, CLOSE),
    ({"preset": "paper", "bins": ONE_BIN}, 1e-3),
    ({"preset": "best", "bins": MANY_BINS}, CLOSE),
]


def worst(
    engine: Engine,
    asset: str,
    mesh: Mesh,
    package: Path,
    dialect: str,
    moved: NDArray[np.float32],
    udim: int = 1001,
) -> float:
    """The largest difference of a frame, codes of the neutral sample of a bin."""
    engine.frames.put(asset, "f", moved)
    want = engine.tiles.plan_map(asset, "f", BINNED, udim, 0).draw()
    rest = stretch.read_rest(package / "triangles.bin")
    numbers = json.loads((package / "manifest.json").read_text())["stretch"]["folds"]
    taken: Any = 0.0
    if numbers is not None:
        taken = Folds(mesh.positions, mesh.faces, rest, numbers).shares(moved)
    found = stretch.log_stretch(moved, mesh.faces, rest, folds=taken)
    renderer = renderer_of(package, udim, dialect)
    try:
        described = renderer.manifest
        got = renderer.heights(stretch.texture(found, described["stretch"]["triangles_a_row"]))
    finally:
        renderer.release()
    layer = described["layers"][0]
    assert np.abs(want).max() > 10 * layer["steps"][0]
    return float(np.abs(got - want).max() / layer["steps"][len(layer["samples"]) // 2])


def renderer_of(package: Path, udim: int, dialect: str) -> Any:
    """The plain run has neither moderngl nor wgpu."""
    if dialect.startswith("glsl"):
        from exports.skin_package.rendering import Renderer

        return Renderer(package, udim, dialect)
    from exports.skin_package.rendering_wgpu import WebGpuRenderer

    return WebGpuRenderer(package, udim, dialect)


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize(("settings", "close"), SCENES)
def test_it_draws_the_map_of_the_service(
    tmp_path: Path, settings: dict[str, Any], close: float, dialect: str
) -> None:
    new = new_asset(**settings)
    with running(tmp_path / "store") as engine:
        asset = built(engine, new)
        write_package(engine, asset, tmp_path / "skin")
        moved = deform(new.mesh.positions, 3, 0.1)
        assert worst(engine, asset, new.mesh, tmp_path / "skin", dialect, moved) < close


@pytest.mark.parametrize("dialect", DIALECTS)
def test_it_draws_events_where_nothing_is_stretched(tmp_path: Path, dialect: str) -> None:
    new = new_asset(preset="best")
    assert isinstance(new.graph, WrinkleGraph)
    kinds = np.zeros(new.graph.pores, np.int32)
    kinds[::20] = 1 + np.arange(len(kinds[::20])) % MOST_KIND  # few, so that none overlap
    eventful = replace(new, graph=replace(new.graph, node_kind=kinds))
    with running(tmp_path / "store") as engine:
        asset = built(engine, eventful)
        write_package(engine, asset, tmp_path / "skin")
        still = new.mesh.positions
        assert worst(engine, asset, new.mesh, tmp_path / "skin", dialect, still) < CLOSE


@pytest.mark.parametrize("dialect", DIALECTS)
def test_it_adds_the_residual_of_scanned_skin(tmp_path: Path, dialect: str) -> None:
    new = new_asset(sheet(udims=2), preset="best")
    rng = np.random.default_rng(8)
    found = {udim: rng.uniform(0.1, 0.2, (256, 256)).astype(np.float32) for udim in (1002, 1012)}
    with running(tmp_path / "store") as engine:
        asset = built(engine, replace(new, residual=Residual.of(found)))
        write_package(engine, asset, tmp_path / "skin")
        moved = deform(new.mesh.positions, 3, 0.1)
        for udim in (1001, 1002):
            close = worst(engine, asset, new.mesh, tmp_path / "skin", dialect, moved, udim)
            assert close < CLOSE, udim


def test_it_finds_its_way_over_pages(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(texture_arrays, "MOST_SIDE", 64)
    monkeypatch.setattr(texture_arrays, "MOST_LAYERS", 1000)
    write_package(written.engine, written.asset, tmp_path)
    moved = deform(written.mesh.positions, 4, 0.1)

    for dialect in DIALECTS:
        found = worst(written.engine, written.asset, written.mesh, tmp_path, dialect, moved)
        assert found < CLOSE, dialect


def test_every_udim_has_its_textures(tmp_path: Path) -> None:
    new = new_asset(sheet(udims=2), preset="best")
    with running(tmp_path / "store") as engine:
        asset = built(engine, new)
        write_package(engine, asset, tmp_path / "skin")
        moved = deform(new.mesh.positions, 3, 0.1)
        for udim in (1002, 1011):
            package = tmp_path / "skin"
            for dialect in DIALECTS:
                found = worst(engine, asset, new.mesh, package, dialect, moved, udim)
                assert found < CLOSE, dialect


@pytest.mark.face
@pytest.mark.parametrize("preset", ["paper", "best"])
def test_it_draws_the_real_face(tmp_path: Path, face: face_data.Face, preset: str) -> None:
    mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
    graph = {"wrinkles": 20_000, "events": 0.0}  # which the package does not widen
    settings = AssetSettings.parse({"preset": preset, "resolution": 1024, "graph": graph})
    with running(tmp_path / "store") as engine:
        asset = built(engine, NewAsset(mesh, settings))
        write_package(engine, asset, tmp_path / "skin")
        for name in ("smile", "jaw_open", "brow_furrow"):
            moved = face.composite(name)
            for dialect in DIALECTS:
                found = worst(engine, asset, mesh, tmp_path / "skin", dialect, moved)
                log.info("%s, %s, %s: within %.4f codes", preset, name, dialect, found)
                assert found < CLOSE


def test_javascript_gives_the_bits_of_numpy(written: Written, tmp_path: Path) -> None:
    node = shutil.which("node")
    assert node is not None, "needs Node.js"
    moved = deform(written.mesh.positions, 5)
    moved.astype("<f4").tofile(tmp_path / "positions")
    written.mesh.faces.astype("<u4").tofile(tmp_path / "indices")
    (tmp_path / "stretch.mjs").write_bytes(rhytid_viewer.read("stretch.js"))
    (tmp_path / "run.mjs").write_text(
        f"""
import {{ readFileSync, writeFileSync }} from "node:fs";
import {{ logStretch, readRest, stretchTexture }} from "./stretch.mjs";
const bytes = (file) => new Uint8Array(readFileSync(file)).buffer;
const rest = readRest(bytes({str(written.folder / "triangles.bin")!r}));
const out = stretchTexture(rest.length / 8, 512);
logStretch(new Float32Array(bytes("positions")), new Uint32Array(bytes("indices")), rest, out);
writeFileSync("out", out);
""",
        encoding="utf-8",
    )
    subprocess.run([node, "run.mjs"], cwd=tmp_path, check=True)

    rest = stretch.read_rest(written.folder / "triangles.bin")
    found = stretch.log_stretch(moved, written.mesh.faces, rest)
    want = stretch.texture(found, 512)
    got = np.fromfile(tmp_path / "out", "<f4").reshape(want.shape)
    assert np.abs(got - want).max() < 2e-7
