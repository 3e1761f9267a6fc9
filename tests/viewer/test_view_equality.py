"""What the viewer computes in Chromium beside what the service computes of the same frame."""

from __future__ import annotations

import base64
import json
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

import face_data
from engine.engines import BINNED, REDRAW, built, draw, running
from exports.skin_package.conftest import write_package
from reference.stretch import stretch as reference
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.domain.methods import SLOPES
from rhytid.domain.residual import Residual
from rhytid.domain.tiles import TileAddress
from rhytid.engine.engine import Engine
from rhytid.engine.messages import NewAsset
from rhytid.exports.textures.frame_map import local_edges, texels_inside
from rhytid_lab.samples.face import procedural_face
from viewer.looking import Look

pytestmark = pytest.mark.browser
Opened = Callable[..., Look]
UDIM = 1001
# In codes of 8 bits: what float32 rounds.
CLOSE = 0.01
READ = """(what) => {
  const view = rhytid.face.view;
  const bytes = new Uint8Array(Float32Array.from(view[what.name](...what.given)).buffer);
  let text = '';
  for (let i = 0; i < bytes.length; i += 32768)
    text += String.fromCharCode(...bytes.subarray(i, i + 32768));
  return btoa(text);
}"""
SET_TILE = """({address, size, texels}) => {
  const text = atob(texels), bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  rhytid.face.view.setExactTile(address, size, new Float32Array(bytes.buffer));
}"""
PIXELS = """() => {
  const view = rhytid.face.view, { width, height } = view.canvas;
  view.draw();
  const gl = view.canvas.getContext('webgl2'), out = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, out);
  let text = '';
  for (let i = 0; i < out.length; i += 32768)
    text += String.fromCharCode(...out.subarray(i, i + 32768));
  return btoa(text);
}"""


@dataclass(frozen=True)
class Both:
    """The engine with an asset, and a page that shows its package."""

    engine: Engine
    asset: str
    mesh: Mesh
    look: Look
    step: float

    def pose(self, weights: list[float]) -> NDArray[np.float32]:
        """Pose both; the positions that the view gives, (V, 3)."""
        self.look.page.evaluate("(weights) => rhytid.face.view.setWeights(weights)", weights)
        positions = self.read("positions").reshape(-1, 3)
        self.engine.frames.put(self.asset, "f", positions)
        return positions

    def read(self, name: str, *given: Any) -> NDArray[np.float32]:
        """What a method of the view gives."""
        text = self.look.page.evaluate(READ, {"name": name, "given": given})
        return np.frombuffer(base64.b64decode(text), "<f4")

    def worst(self) -> float:
        """The largest difference of heights, codes of the neutral sample of a bin."""
        want = self.engine.tiles.plan_map(self.asset, "f", BINNED, UDIM, 0).draw()
        got = self.read("heights", UDIM).reshape(want.shape)
        assert np.abs(want).max() > 10 * self.step
        return float(np.abs(got - want).max() / self.step)


def step_of(package: Path) -> float:
    layer = json.loads((package / "manifest.json").read_text())["layers"][0]
    return float(layer["steps"][len(layer["samples"]) // 2])


@pytest.fixture(scope="module")
def both(
    store: Path, package: str, open_lasting: Opened, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Both]:
    """On a copy of the store, which a server may have open."""
    copy = tmp_path_factory.mktemp("equality") / "store"
    shutil.copytree(store, copy)
    asset = json.loads((store.parent / "package" / "manifest.json").read_text())["asset"]
    look = open_lasting(package).ready()
    with running(copy) as engine:
        mesh = procedural_face(48).mesh
        yield Both(engine, asset, mesh, look, step_of(store.parent / "package"))


@pytest.mark.parametrize("shape", [0, 1, 2, 3])
def test_heights_are_those_of_the_service(both: Both, shape: int) -> None:
    both.pose([float(i == shape) for i in range(8)])
    assert both.worst() < CLOSE


def test_stretch_is_that_of_the_reference(both: Both) -> None:
    positions = both.pose([0.7, 0.0, 0.6, 0.0, 0.3, 0.0, 0.0, 0.0])
    mesh = both.mesh
    ratios, axes = reference(mesh.positions, mesh.faces, mesh.uv, mesh.face_uv, positions)
    found = both.read("stretch").reshape(-1, 8)[: len(mesh.faces)]

    assert np.abs(found[:, 4:6] - np.log(ratios)).max() < 2e-6
    clear = ratios[:, 0] / ratios[:, 1] > 1.001  # else any axes will do
    along = np.abs((found[:, :4].reshape(-1, 2, 2) * axes).sum(-1))[clear]
    assert clear.sum() > 1000
    assert (1 - along).max() < 1e-4


def test_moments_are_those_of_the_service(both: Both) -> None:
    """Of texels within one triangle and off the border of the chart, by the triangle's metric: what
    does not change with the tangent frame, and the direction beside dP/du, from which T turns."""
    positions = both.pose([0.7, 0.0, 0.6, 0.0, 0.3, 0.0, 0.0, 0.0]).astype(float)
    level, side = 2, 128
    query = replace(BINNED, layer=SLOPES)
    wanted = both.engine.tiles.plan_map(both.asset, "f", query, UDIM, level).draw()
    mine = both.read("moments", UDIM, level).reshape(side, side, 5).astype(float)
    triangles = both.engine.tiles.triangles(both.asset, UDIM)
    inside = texels_inside(
        triangles.clip(0, len(both.mesh.faces) - 1), local_edges(both.mesh, UDIM)
    )
    triangles = np.where(minimum_filter(inside, 3), triangles, -1)
    blocks = triangles.reshape(side, 4, side, 4).swapaxes(1, 2).reshape(side, side, 16)
    whole = (blocks == blocks[..., :1]).all(-1) & (blocks[..., 0] >= 0)
    assert whole.sum() > 500

    got = on_triangles(mine[whole], both.mesh, positions, blocks[whole][:, 0])
    want = [np.moveaxis(wanted[whole], -1, 0)[k] for k in range(5)]
    largest = np.abs(wanted[whole]).max(axis=0)
    # Half floats round by 2^-11 on each of three levels, and four products make up an invariant.
    # They are rounded by their own sizes: where they cancel, an invariant is smaller than these.
    rounded = 4 * 3 * 2**-11
    every = zip(invariants(*got), invariants(*want), sizes(*want), strict=True)
    for mine_is, theirs, size in every:
        assert np.abs(mine_is - theirs).max() < rounded * size.max()
    assert largest.min() > 0.002
    turn = [np.angle(x + 1j * y) for x, y in (got[:2], want[:2])]
    off = np.abs(np.angle(np.exp(1j * (turn[0] - turn[1]))))
    assert np.median(off[np.hypot(*want[:2]) > 0.02]) < np.radians(1)


def on_triangles(
    moments: NDArray[np.float64], mesh: Mesh, positions: Any, triangles: Any
) -> list[NDArray[np.float64]]:
    """Moments (n, 5) by column and row, over the side of the map, along dP/du and across it."""
    corners, uv = positions[mesh.faces[triangles]], mesh.uv[mesh.face_uv[triangles]]
    edges = (corners[:, 1:] - corners[:, :1]), (uv[:, 1:] - uv[:, :1])
    du, dv = np.moveaxis(np.linalg.solve(edges[1], edges[0]), 1, 0)
    along = du / np.linalg.norm(du, axis=1, keepdims=True)
    lean = (dv * along).sum(1)
    across = np.linalg.norm(dv - lean[:, None] * along, axis=1)
    first, rows = np.linalg.norm(du, axis=1), np.zeros((len(du), 2, 2))
    rows[:, 0, 0] = 1 / first
    rows[:, 1] = np.stack([-lean / first / across, -1 / across], axis=1)  # rows go down
    mean = np.einsum("nij,nj->ni", rows, moments[:, :2])
    products = moments[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    xx, xy, _, yy = (rows @ products @ rows.swapaxes(1, 2)).reshape(-1, 4).T
    return [*mean.T, xx, xy, yy]


def invariants(x: Any, y: Any, xx: Any, xy: Any, yy: Any) -> tuple[Any, ...]:
    """Of moments: what a turn of the axes leaves. The determinant, not its root, which magnifies
    what is rounded where it is small."""
    by = x * x * xx + 2 * x * y * xy + y * y * yy
    return x * x + y * y, xx + yy, xx * yy - xy * xy, by


def sizes(x: Any, y: Any, xx: Any, xy: Any, yy: Any) -> tuple[Any, ...]:
    """Of `invariants`: the sums of their products without signs."""
    by = x * x * xx + 2 * np.abs(x * y * xy) + y * y * yy
    return x * x + y * y, xx + yy, xx * yy + xy * xy, by


def test_a_probe_reads_the_map_and_the_stretch(both: Both) -> None:
    both.pose([1.0, 0, 0, 0, 0, 0, 0, 0])
    found = both.look.page.evaluate(
        "(() => { const v = rhytid.face.view, c = v.canvas;"
        " return v.probe(c.clientWidth / 2, c.clientHeight / 2); })()"
    )
    want = both.engine.tiles.plan_map(both.asset, "f", BINNED, UDIM, 0).draw()
    column, row = found["texel"]
    stretch = both.read("stretch").reshape(-1, 8)[found["triangle"]]

    assert found["udim"] == UDIM
    assert found["displacement"] == pytest.approx(want[row, column], abs=CLOSE * both.step)
    assert found["ratios"] == pytest.approx(np.exp(stretch[4:6]))


def test_exact_tiles_take_the_place_of_fast_ones(both: Both) -> None:
    look = both.look
    both.pose([1.0, 0, 0, 0, 0, 0, 0, 0])
    look.page.evaluate("rhytid.face.view.camera.zoom(0.3)")
    look.page.evaluate("rhytid.face.view.setOptions({method: 'exact', strength: 4})")
    before = look.page.evaluate(PIXELS)
    tiles = look.page.evaluate("rhytid.face.view.tilesInView().tiles")
    assert tiles

    for address in tiles:
        place = TileAddress(**address)
        tile = draw(both.engine, both.asset, "f", REDRAW, place)
        texels = base64.b64encode(np.ascontiguousarray(tile, "<f4").tobytes()).decode()
        look.page.evaluate(SET_TILE, {"address": address, "size": len(tile), "texels": texels})
    after = look.page.evaluate(PIXELS)
    assert after != before
    look.page.evaluate("rhytid.face.view.setWeights([1, 0, 0, 0, 0, 0, 0, 0])")
    assert look.page.evaluate(PIXELS) == before, "a new pose forgets the tiles"
    assert [line for line in look.said if "error" in line or "GL_" in line] == []


def test_the_picture_is_the_same_on_every_way_there(both: Both) -> None:
    """Only cells in view are drawn: all at once, or some and then others."""
    page = both.look.page
    page.evaluate("rhytid.face.view.setOptions({method: 'fast', strength: 4})")
    weights = [0.0, 1.0, 0, 0, 0, 0, 0, 0]
    away, back = (f"rhytid.face.view.camera.zoom({factor})" for factor in (4.0, 0.25))
    both.pose(weights)
    page.evaluate(away)
    page.evaluate(PIXELS)
    page.evaluate(back)
    want = page.evaluate(PIXELS)

    both.pose(weights)
    page.evaluate("rhytid.face.view.camera.pan(200, 100)")
    page.evaluate(PIXELS)
    page.evaluate("rhytid.face.view.camera.pan(-200, -100)")
    got, want = (
        np.frombuffer(base64.b64decode(t), np.uint8) for t in (page.evaluate(PIXELS), want)
    )
    # Levels have texels of cells that are out of view in them: the last bit may be another.
    assert (np.abs(got.astype(int) - want) > 2).mean() < 1e-3


def test_scanned_skin_has_its_residual(both: Both, tmp_path: Path, open_page: Opened) -> None:
    engine, assets = both.engine, both.engine.assets
    rows, columns = np.mgrid[:512, :512] / 512.0
    swells = 0.03 * np.sin(60.0 * columns) * np.cos(40.0 * rows) + 0.1
    settings = AssetSettings.parse(assets.info(both.asset).settings)
    residual = Residual.of({UDIM: swells.astype(np.float32)})
    graph = assets.graph(both.asset)
    asset = built(engine, NewAsset(both.mesh, settings, graph, residual=residual))
    write_package(engine, asset, tmp_path / "skin", assets.shapes(both.asset))
    with web_server(tmp_path / "skin") as url:
        look = open_page(url).ready()
        scanned = Both(engine, asset, both.mesh, look, step_of(tmp_path / "skin"))
        scanned.pose([1.0, 0, 0, 0, 0.5, 0, 0, 0])
        assert scanned.worst() < CLOSE
        found = scanned.read("heights", UDIM)
        look.keep("scanned")
    assert [line for line in look.said if "error" in line or "GL_" in line] == []
    both.pose([1.0, 0, 0, 0, 0.5, 0, 0, 0])
    grown = both.read("heights", UDIM)
    assert np.abs(found - grown - swells.reshape(-1)).max() < CLOSE * both.step


@pytest.mark.slow
@pytest.mark.face
def test_heights_of_the_real_face(tmp_path: Path, face: face_data.Face, open_page: Opened) -> None:
    mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
    poses = np.stack([face.positions + delta for delta in face.deltas.values()])
    names = list(face.expression_names)
    shapes = Expressions.checked(poses, len(face.positions), names)
    settings = AssetSettings.parse({"resolution": 2048, "graph": {"events": 0.0}})
    with running(tmp_path / "store") as engine:
        asset = built(engine, NewAsset(mesh, settings, shapes=shapes))
        write_package(engine, asset, tmp_path / "skin", shapes)
        with web_server(tmp_path / "skin") as url:
            look = open_page(url).ready()
            both = Both(engine, asset, mesh, look, step_of(tmp_path / "skin"))
            for composite in ("smile", "jaw_open", "brow_furrow"):
                weights = face.composites[composite]
                both.pose([float(weights.get(name, 0.0)) for name in names])
                assert both.worst() < CLOSE


@contextmanager
def web_server(folder: Path) -> Iterator[str]:
    """The URL of a folder."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()
        thread.join()
