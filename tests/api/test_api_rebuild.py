"""`binned` made outside: the listings of docs/binned.md on what the HTTP API answers, alone."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from api.asking import NPY, array_of, built, npy
from api.live import serving
from meshes import bumpy_grid, deform
from pipeline.scenes import random_graph
from rhytid.engine.engine import Engine
from rhytid.formats.graphs import write_graph
from rhytid.settings import ServiceSettings

PAGE = Path(__file__).parents[2] / "docs" / "binned.md"
MESH = bumpy_grid(10, 1)
RESOLUTION, SIDE, ROW, COLUMN = 256, 64, 1, 2
TILE = f"1001/0/{ROW}/{COLUMN}"
BAND = 1e-6  # uv: nearer to an edge, float32 may take the triangle beyond it
GREY = np.random.default_rng(5).integers(60, 256, (9, 7)).astype(np.uint8)

CASES: dict[str, dict[str, Any]] = {
    "paper": {"preset": "paper"},
    "best": {"preset": "best"},
    "far stretched": {"preset": "best", "bins": {"r_max": 0.03}},
    "16 bits, 8 bins, pores 7": {
        "preset": "best", "bins": {"count": 8, "bits": 16, "pore_samples": 7},
    },
    "one bin": {"preset": "best", "bins": {"count": 1}},
    "signed": {"preset": "best", "bins": {"merge": "signed"}},
    "mellow": {"preset": "best", "bins": {"merge": "mellow"}, "shape": {"pore_bulge": 3.0}},
    "soft where all is near": {"preset": "best", "shape": {"sharpness": 1.5}},
    "surface": {"preset": "best", "angles": "surface"},
    "exponents": {"preset": "best", "response": {"alpha_d": 6.0, "log_stretch_limit": 0.3}},
    "hard limits": {"preset": "best", "response": {"soft_limits": False, "pore_depth_limit": 1.2}},
}  # fmt: skip


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """What the listings of the page define."""
    listings = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec("\n".join(listings), names)
    return names


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """Of a server over the real engine."""
    from_environment = ServiceSettings.from_environment()
    settings = {**vars(from_environment), "store": tmp_path_factory.mktemp("rebuild")}
    engine = Engine(ServiceSettings(**settings))
    try:
        with serving(engine) as client:
            yield client
    finally:
        engine.close()


def sent(client: httpx.Client, stiff: bool = False, **settings: Any) -> str:
    """The path of an asset with a deformed frame `bent`."""
    mesh = io.BytesIO()
    np.savez(mesh, **MESH._asdict())
    given = {"depth": 0.03, "resolution": RESOLUTION, "tile_size": SIDE, **settings}
    # Their maps are not published, as the page says.
    given["shape"] = {"cushion": 0.0, "grain": 0.0, **given.get("shape", {})}
    files = {
        "mesh": ("sheet.npz", mesh.getvalue()),
        "settings": (None, json.dumps(given)),
        "graph": ("graph.safetensors", write_graph(random_graph(7, 150))),
    }
    if stiff:
        image = io.BytesIO()
        Image.fromarray(GREY).save(image, "PNG")
        files["stiffness"] = ("skin.1001.png", image.getvalue())
    path = f"/v1/assets/{built(client, files)}"
    bent = deform(MESH.positions, 3, 0.15)
    client.put(f"{path}/frames/bent", content=npy(bent), headers=NPY).raise_for_status()
    return path


def codes_of(client: httpx.Client, path: str, manifest: Any) -> dict[str, list[Any]]:
    """codes[layer][bin]: (samples, P)."""
    found = {}
    for layer, count in manifest["layers"].items():
        samples = range(len(manifest["steps"][layer]))
        found[layer] = [
            np.stack([
                array_of(client.get(
                    f"{path}/bins/{TILE}", params={"layer": layer, "bin": n, "sample": m}
                )).ravel()
                for m in samples
            ]).astype(float)
            for n in range(count)
        ]  # fmt: skip
    return found


class Published:
    """What the API answers of an asset, its centres and triangles by the page."""

    def __init__(self, client: httpx.Client, page: dict[str, Any], path: str) -> None:
        self.client, self.path = client, path
        self.manifest = client.get(f"{path}/bins").json()
        self.settings = client.get(path).json()["settings"]
        self.codes = codes_of(client, path, self.manifest)
        self.stretch = np.load(io.BytesIO(client.get(f"{path}/frames/bent/stretch").content))
        side = self.settings["resolution"]
        rows, columns = np.mgrid[ROW * SIDE : (ROW + 1) * SIDE, COLUMN * SIDE : (COLUMN + 1) * SIDE]
        self.centres = np.stack([columns + 0.5, side - rows - 0.5], axis=-1).reshape(-1, 2) / side
        self.corners = MESH.uv.astype(float)[MESH.face_uv]
        self.reach = self.settings["padding"] / side
        moves = BAND * np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]])
        found = [page["triangles_of"](self.centres + m, self.corners, self.reach) for m in moves]
        self.index = found[0]
        self.sure = (found == found[0]).all(axis=0)
        assert self.sure.mean() > 0.98
        assert (self.index < 0).any(), "some texels lie in no triangle"

    def served(self, sampling: str) -> Any:
        query = {"method": "binned", "sampling": sampling}
        answer = self.client.get(f"{self.path}/frames/bent/tiles/{TILE}", params=query)
        return array_of(answer).ravel()

    def worst(self, sampling: str, made: Any) -> float:
        """The largest difference from the served tile, in the smallest of its codes, were these
        of 8 bits: of 16 bits they are near what float32 rounds to."""
        away = np.abs(made - self.served(sampling))[self.sure]
        assert np.abs(made).max() > 0.5 * self.settings["depth"]
        steps = [s for layer, s in self.manifest["steps"].items() if layer != "wrinkle_tilts"]
        eight = (2 ** (self.manifest["bits"] - 1) - 1) / 127
        return float(away.max() / (eight * min(map(min, steps))))


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES.keys())
def test_the_page_makes_the_served_tile(
    client: httpx.Client, page: dict[str, Any], changes: dict[str, Any]
) -> None:
    one = Published(client, page, sent(client, **changes))
    logs, axes = page["nearest"](one.centres, one.corners, one.reach, one.stretch, one.manifest)
    jacobian = None
    if one.manifest["measured_in"] == "surface":
        own = page["jacobians"](MESH.positions, MESH.faces, one.corners)[0][one.index]
        jacobian = np.where((one.index >= 0)[:, None, None], own, np.eye(3, 2))
    made = page["blend"](one.manifest, one.codes, logs, axes, jacobian)
    assert one.worst("nearest", made) <= 1e-3


@pytest.mark.parametrize("preset", ["paper", "best"])
def test_the_page_makes_the_served_tile_with_smooth_sampling(
    client: httpx.Client, page: dict[str, Any], preset: str
) -> None:
    one = Published(client, page, sent(client, preset=preset))
    mesh = (MESH.positions, MESH.faces, one.corners, one.reach)
    logs, axes = page["smooth"](one.centres, *mesh, one.stretch, one.manifest)
    made = page["blend"](one.manifest, one.codes, logs, axes)
    assert one.worst("smooth", made) <= 1e-3


def test_the_page_makes_the_served_tile_of_stiff_skin(
    client: httpx.Client, page: dict[str, Any]
) -> None:
    one = Published(client, page, sent(client, stiff=True))
    logs, axes = page["nearest"](one.centres, one.corners, one.reach, one.stretch, one.manifest)
    stiffness = bilinear(GREY / 255, one.centres)
    made = page["blend"](one.manifest, one.codes, logs, axes, stiffness=stiffness)
    assert one.worst("nearest", made) <= 1e-3


def bilinear(image: Any, uv: Any) -> Any:
    """(P,) of an image with row 0 at v = 1, constant beyond its outermost centres."""
    height, width = image.shape
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    left, top = (np.minimum(a.astype(int), n - 2) for a, n in ((x, width), (y, height)))
    x, y = x - left, y - top
    rows = [image[top + i, left] * (1 - x) + image[top + i, left + 1] * x for i in (0, 1)]
    return rows[0] * (1 - y) + rows[1] * y


def test_the_openapi_document_tells_of_every_number(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    fields = {**schemas["Bins"]["properties"], **schemas["TiltLine"]["properties"]}
    told = {n for n, f in fields.items() if f.get("description")}
    assert {"pore_samples", "depth", "sharpness", "log_stretch_limit", "scale_limit"} <= told
    assert {"node", "share", "width", "depth_exponents", "measured_in", "layers"} <= told
    manifest = client.get(f"{sent(client)}/bins").json()
    assert manifest.keys() == schemas["Bins"]["properties"].keys()
    tilt = manifest["tilt"]
    assert (tilt["node"], tilt["share"], tilt["width"]) == (0.6, 0.25, pytest.approx(np.exp(0.25)))
