"""`binned` made outside: the listings of docs/binned.md on what the HTTP API answers, alone."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from api.asking import NPY, array_of, built, is_problem, npy
from api.live import serving
from meshes import bumpy_grid, deform
from pipeline.scenes import random_graph
from rhytid.domain.graph import WrinkleGraph
from rhytid.engine.engine import Engine
from rhytid.formats.graphs import read_graph, write_graph
from rhytid.support.settings import ServiceSettings

pytestmark = pytest.mark.release

PAGE = Path(__file__).parents[2] / "docs" / "binned.md"
MESH = bumpy_grid(10, 1)
RESOLUTION, SIDE, ROW, COLUMN = 256, 64, 1, 2
TILE = f"1001/0/{ROW}/{COLUMN}"
BAND = 1e-6  # uv: nearer to an edge, float32 may take the triangle beyond it
GREY = np.random.default_rng(5).integers(60, 256, (9, 7)).astype(np.uint8)

CASES: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {"preset": "paper"},
    "flat": {"shape": {"cushion": 0.0, "grain": 0.0, "undulation": 0.0}},
    "cushions alone": {
        "shape": {
            "grain": 0.0, "undulation": 0.0, "cushion_width": 6.0, "cushion_sharpness": 9.0,
        },
    },
    "grain alone": {"shape": {"cushion": 0.0, "grain": 0.3, "undulation": 0.0}},
    "undulation alone": {"shape": {"cushion": 0.0, "grain": 0.0, "undulation": 0.3}},
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


def chained(graph: WrinkleGraph) -> WrinkleGraph:
    """The same with wrinkles that go on in others at some of their ends, and a copy of another."""
    partners = np.random.default_rng(2).integers(-60, graph.wrinkles, (graph.wrinkles, 2))
    copies = np.full(graph.wrinkles, -1, np.int32)
    copies[[5, 9]] = 20, 30
    return replace(
        graph, edge_partners=np.maximum(partners, -1).astype(np.int32), edge_copy_of=copies
    )


def sent(client: httpx.Client, stiff: bool = False, **settings: Any) -> str:
    """The path of an asset with a deformed frame `bent`."""
    mesh = io.BytesIO()
    np.savez(mesh, **MESH._asdict())
    # In millimetres texels are fine enough for all of the grain.
    usual = {"unit": "mm", "depth": 0.03, "resolution": RESOLUTION, "tile_size": SIDE}
    given = {**usual, **settings}
    files = {
        "mesh": ("sheet.npz", mesh.getvalue()),
        "settings": (None, json.dumps(given)),
        "graph": ("graph.safetensors", write_graph(chained(random_graph(7, 150)))),
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


class Grid:
    """Centres of texels, or of samples of the cushion, with their triangles by the page."""

    def __init__(self, page: dict[str, Any], corners: Any, reach: float, centres: Any) -> None:
        self.centres, self.corners, self.reach = centres, corners, reach
        moves = BAND * np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]])
        found = [page["triangles_of"](centres + move, corners, reach) for move in moves]
        self.index = found[0]
        self.sure = (found == found[0]).all(axis=0)
        assert self.sure.mean() > 0.98

    def closest(self, page: dict[str, Any]) -> Any:
        """(P, 2) of the triangle of each centre the point closest to it."""
        found = self.centres.copy()
        for point, triangle in zip(found, self.index, strict=True):
            if triangle >= 0:
                shares = page["weights"](point, self.corners[triangle])
                point[:] = shares @ self.corners[triangle]
        return found

    def jacobian(self, page: dict[str, Any]) -> Any:
        own = page["jacobians"](MESH.positions, MESH.faces, self.corners)[0][self.index]
        return np.where((self.index >= 0)[:, None, None], own, np.eye(3, 2))


class Published:
    """What the API answers of an asset, and a tile by the page."""

    def __init__(self, client: httpx.Client, page: dict[str, Any], path: str) -> None:
        self.client, self.page, self.path = client, page, path
        self.manifest = client.get(f"{path}/bins").json()
        self.settings = client.get(path).json()["settings"]
        self.codes = codes_of(client, path, self.manifest)
        self.stretch = np.load(io.BytesIO(client.get(f"{path}/frames/bent/stretch").content))
        side = self.settings["resolution"]
        corners = MESH.uv.astype(float)[MESH.face_uv]
        self.graph = read_graph(client.get(f"{path}/graph").content).arrays()
        middles = self.graph["node_uv"].astype(float)[self.graph["edge_nodes"]].mean(axis=1)
        centres = page["centres_of"](ROW * SIDE, COLUMN * SIDE, SIDE, side)
        self.fine, self.lines = (
            Grid(page, corners, self.settings["padding"] / side, places)
            for places in (centres, middles)
        )
        assert (self.fine.index < 0).any(), "some texels lie in no triangle"

    def made(self, sampling: str, stiff: bool = False) -> Any:
        """The tile by the page."""
        page, places = self.page, []
        for grid in (self.fine, self.lines):
            after = (grid.corners, grid.reach, self.stretch, self.manifest)
            if sampling == "smooth":
                logs, axes = page["smooth"](grid.centres, MESH.positions, MESH.faces, *after)
            else:
                logs, axes = page["nearest"](grid.centres, *after)
            surface = self.manifest["measured_in"] == "surface"
            at = grid.closest(page) if grid is self.lines else grid.centres
            stiffness = bilinear(GREY / 255, at) if stiff else 1.0
            places.append((logs, axes, grid.jacobian(page) if surface else None, stiffness))
        ends = None
        if self.manifest["cushion"]:
            ends = page["end_stretches"](self.graph, self.settings["response"]["ends"], *places[1])
        return page["displacement"](self.manifest, self.codes, places[0], ends)

    @property
    def sure(self) -> Any:
        """(P,) texels of which it is clear what they and the owners around them take."""
        if not self.manifest["cushion"]:
            return self.fine.sure
        owners = self.codes["cushion_owners"][0][0].astype(int)
        doubt = ~np.append(self.lines.sure, True)[owners]
        side = round(len(doubt) ** 0.5)
        raised = self.page["brought_up"](doubt.reshape(side, side).astype(float), self.manifest)
        assert (raised == 0).mean() > 0.95
        return self.fine.sure & (raised.ravel() == 0)

    def served(self, sampling: str) -> Any:
        query = {"method": "binned", "sampling": sampling}
        answer = self.client.get(f"{self.path}/frames/bent/tiles/{TILE}", params=query)
        return array_of(answer).ravel()

    def worst(self, sampling: str, stiff: bool = False) -> float:
        """The largest difference from the served tile, in the smallest of the codes of wrinkles and
        pores, were these of 8 bits: of 16 bits they are near what float32 rounds to."""
        made = self.made(sampling, stiff)
        away = np.abs(made - self.served(sampling))[self.sure]
        assert np.abs(made).max() > 0.5 * self.settings["depth"]
        steps = self.manifest["steps"]
        least = min(min(steps[layer]) for layer in ("wrinkles", "pores"))
        return float(away.max() / (least * (2 ** (self.manifest["bits"] - 1) - 1) / 127))


@pytest.mark.slow
@pytest.mark.parametrize("changes", CASES.values(), ids=CASES.keys())
def test_the_page_makes_the_served_tile(
    client: httpx.Client, page: dict[str, Any], changes: dict[str, Any]
) -> None:
    assert Published(client, page, sent(client, **changes)).worst("nearest") <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["paper", "best"])
def test_the_page_makes_the_served_tile_with_smooth_sampling(
    client: httpx.Client, page: dict[str, Any], preset: str
) -> None:
    assert Published(client, page, sent(client, preset=preset)).worst("smooth") <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
def test_the_page_makes_the_served_tile_of_stiff_skin(
    client: httpx.Client, page: dict[str, Any], sampling: str
) -> None:
    one = Published(client, page, sent(client, stiff=True))
    assert one.worst(sampling, stiff=True) <= 1e-3


@pytest.mark.slow
def test_the_default_has_cushions_and_grain_that_show(
    client: httpx.Client, page: dict[str, Any]
) -> None:
    """Without one of the two the page is wrong by many codes."""
    one = Published(client, page, sent(client))
    assert one.manifest["cushion"]["factor"] > 1
    assert one.manifest["layers"].keys() == {
        "wrinkles", "pores", "wrinkle_tilts",
        "cushions", "cushion_places", "cushion_owners", "grain",
    }  # fmt: skip
    grain = one.codes["grain"][0][0]
    assert 5 < grain.std() < 32  # 16 codes are the root mean square where swells differ by place
    for name, least in (("cushion", 10), ("grain", 2)):
        whole = one.manifest
        one.manifest = {**whole, name: None}
        assert np.abs(one.made("nearest") - one.served("nearest")).max() > least * min(
            whole["steps"]["wrinkles"]
        )
        one.manifest = whole


def test_tiles_of_cushions_overlap_by_their_aprons(client: httpx.Client) -> None:
    path = sent(client)
    manifest = client.get(f"{path}/bins").json()
    factor, apron = (manifest["cushion"][name] for name in ("factor", "apron"))
    for layer in ("cushions", "cushion_places", "cushion_owners"):
        query = {"layer": layer, "sample": 2 if layer == "cushions" else 0}
        left, right = (
            array_of(client.get(f"{path}/bins/1001/0/1/{column}", params=query))
            for column in (1, 2)
        )
        assert left.dtype == (np.int32 if layer == "cushion_owners" else np.int8)
        assert left.shape == (SIDE // factor + 2 * apron,) * 2
        assert len(np.unique(left)) > 1
        np.testing.assert_array_equal(left[:, -2 * apron :], right[:, : 2 * apron])


@pytest.mark.parametrize(
    ("preset", "layer", "bin", "sample", "told"),
    [
        ("best", "cushions", 4, 0, "bin 4 of layer cushions: 0 to 0"),
        ("best", "cushions", 0, 7, "sample 7 of layer cushions: 0 to 6"),
        ("best", "grain", 1, 0, "bin 1 of layer grain: 0 to 0"),
        ("paper", "cushions", 0, 0, "layer 'cushions': one of wrinkles, pores"),
        ("paper", "grain", 0, 0, "layer 'grain': one of wrinkles, pores"),
    ],
)
def test_maps_that_are_not_there(
    client: httpx.Client, preset: str, layer: str, bin: int, sample: int, told: str
) -> None:
    query = {"layer": layer, "bin": bin, "sample": sample}
    answer = client.get(f"{sent(client, preset=preset)}/bins/{TILE}", params=query)
    assert told in is_problem(answer, 404, "not-found")


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
    names = ("Bins", "TiltLine", "CushionLayer", "GrainLayer")
    fields = {k: v for name in names for k, v in schemas[name]["properties"].items()}
    told = {n for n, f in fields.items() if f.get("description")}
    assert {"pore_samples", "depth", "sharpness", "log_stretch_limit", "scale_limit"} <= told
    assert {"node", "share", "width", "depth_exponents", "measured_in", "layers"} <= told
    assert {"cushion", "factor", "apron", "grain", "exponent"} <= told
    manifest = client.get(f"{sent(client)}/bins").json()
    assert manifest.keys() == schemas["Bins"]["properties"].keys()
    tilt = manifest["tilt"]
    assert (tilt["node"], tilt["share"], tilt["width"]) == (0.6, 0.25, pytest.approx(np.exp(0.25)))
