"""Scans sent over HTTP: at rest the skin is the scan, its lines move, and bad parts are named."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from api.live import serving
from api.patch import obj, smile
from engine.engines import running
from exr_images import exr
from reference import tracing as reference
from rhytid.formats.graphs import read_graph
from rhytid.processes.decoding import limits
from rhytid_client import Client, RequestError

SIDE, RANGE = 256, 0.02
HOW = {"scale": RANGE, "unit": "m"}
SETTINGS = {"unit": "m", "resolution": SIDE, "tile_size": 64}


@cache
def relief() -> NDArray[np.float32]:
    """Lines, pores and a swell, mesh units; white is never reached. Not to be written to."""
    rng = np.random.default_rng(1)
    starts = rng.uniform(40, 216, (30, 2))
    lines = np.concatenate([starts, starts + rng.uniform(-25, 25, (30, 2))], axis=1)
    found = reference.relief_of_lines(SIDE, lines, 3.0, 0.003, 1.0)
    heights = (found + 0.001 * np.sin(np.arange(SIDE) / 20.0)).astype(np.float32)
    heights.flags.writeable = False
    return heights


def image(heights: NDArray[np.floating[Any]], kind: str = "TIFF", dtype: Any = np.uint16) -> bytes:
    largest = np.iinfo(dtype).max
    stream = io.BytesIO()
    codes = np.round((heights / RANGE + 0.5) * largest).astype(dtype)
    Image.fromarray(codes).save(stream, kind)
    return stream.getvalue()


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    with (
        running(tmp_path_factory.mktemp("scans")) as engine,
        serving(engine) as served,
        closing(Client(str(served.base_url))) as client,
    ):
        yield client


def created(client: Client, **given: Any) -> Any:
    sent = {"name": "a.obj", "settings": SETTINGS, "scan_settings": HOW, **given}
    return client.create_asset(obj(), **sent)


def test_a_scan_becomes_skin_that_moves(client: Client, tmp_path: Path) -> None:
    file = tmp_path / "head.1001.tif"
    file.write_bytes(image(relief()))
    made = created(client, scan=[file])
    asset = client.wait(made)
    scan = (np.asarray(Image.open(file), np.float64) / 65535 - 0.5) * RANGE
    for method in ("neutral", "redraw"):
        found = client.map(asset, "neutral", 1001, method=method).array
        assert np.abs(found - scan).max() <= 0.5 * RANGE / 65535
    client.put_frame(asset, "smile", smile(0.2))
    for method in ("binned", "redraw"):
        moved = client.map(asset, "smile", 1001, method=method).array
        assert 0.0003 < np.abs(moved - scan).max() < 0.006, method
    graph = read_graph(client.graph(asset))
    assert graph.wrinkles >= asset.wrinkles > 30
    client.change_asset(asset, {"response": {"alpha_d": 2.0}})
    found = client.map(asset, "neutral", 1001, method="redraw").array
    assert np.abs(found - scan).max() <= 0.5 * RANGE / 65535
    assert not np.array_equal(client.map(asset, "smile", 1001).array, moved)
    client.change_asset(asset, {"response": {"alpha_d": 4.0}})
    assert created(client, scan={1001: file}).id == asset.id
    with pytest.raises(RequestError, match="is a scanned skin: precomputed maps"):
        client.bins(asset)


NAN = relief().copy()
NAN[3, 5] = np.nan
COLOURS = np.random.default_rng(1).integers(0, 255, (64, 64, 3)).astype(np.uint8)


def picture(array: NDArray[Any], kind: str = "PNG") -> bytes:
    stream = io.BytesIO()
    Image.fromarray(array).save(stream, kind)
    return stream.getvalue()


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({"scan": b""}, "scan: must be EXR, PNG, TIFF or JPEG"),
    "cut": ({"scan": image(relief())[:-5000]}, "scan"),
    "not finite": ({"scan": exr(NAN)}, "the texel of column 5, row 3 is nan"),
    "colours": ({"scan": picture(COLOURS)}, "scan"),
    "another UDIM": ({"scan": {1002: image(relief())}}, "UDIM 1002, which has no mesh"),
    "no scale": ({"scan": image(relief()), "scan_settings": {}}, "scan.scale"),
    "scale": ({"scan": image(relief()), "scan_settings": {"scale": "2"}}, "scan.scale is '2'"),
    "unknown": ({"scan": image(relief()), "scan_settings": {"depth": 2}}, "scan.depth is unknown"),
    "partial": ({"scan": image(relief()), "scan_settings": {"partial": 1}}, "true or false"),
    "midlevel": ({"scan": image(relief()), "scan_settings": {"midlevel": []}}, "scan.midlevel is"),
    "no scan": ({}, "no such part"),
    "detail": ({"scan": image(relief()), "scan_settings": {**HOW, "detail": 2}}, "from 0 to 1"),
    "fill": ({"scan": image(relief()), "scan_settings": {**HOW, "fill": "2"}}, "scan.fill is '2'"),
    "wide": ({"scan": image(relief()), "scan_settings": {**HOW, "fill": 10**400}}, "scan.fill is"),
    "both": (
        {"scan": image(relief()), "scan_settings": {**HOW, "fill": 0.1, "detail": 1}},
        "use one of them",
    ),
    "mask alone": (
        {"scan_mask": picture(COLOURS[..., 0]), "scan_settings": None},
        "scan_mask says where part scan counts",
    ),
    "misspelt": ({"scan_settings": None, "settings": {"skan": HOW}}, "did you mean scan"),
    "no setting": ({"scan_settings": None, "settings": {"x": HOW}}, "known here: unit, .*, scan"),
    "flat": ({"scan": image(0.0 * relief())}, "there is no relief in the scan"),
    "a graph, too": ({"scan": image(relief()), "graph": b"?"}, "graph"),
    "a map of growth": (
        {"scan": image(relief()), "controls": {"density": picture(COLOURS[..., 0])}},
        "density: maps that guide synthesis; a scan was sent",
    ),
}


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize("kind", BAD)
def test_bad_parts_are_named(client: Client, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "is_light", lambda parts: True)  # else each starts a process
    given, said = BAD[kind]
    with pytest.raises(RequestError, match=said) as raised:
        created(client, **given)
    assert raised.value.status in (413, 422), raised.value


@pytest.mark.parametrize("fill", [0.0, 0.1])
def test_what_is_masked_out_stays_or_grows(client: Client, fill: float) -> None:
    """Left of the middle there are no lines of the scan. With a border skin grows there; from that
    on, 0.1 of 1 m in 0.8 of a map of 256 texels, or 21 of these, the skin at rest is the scan."""
    mask = np.zeros((64, 64), np.uint8)
    mask[:, 32:] = 255
    grown = {**SETTINGS, "graph": {"spacing": 0.04}}
    how = {**HOW, "fill": fill}
    sent = {"scan": image(relief()), "scan_settings": how, "settings": grown}
    asset = client.wait(created(client, scan_mask=picture(mask), **sent))
    scan = np.round((relief() / RANGE + 0.5) * 65535) / 65535 * RANGE - 0.5 * RANGE
    found = client.map(asset, "neutral", 1001, method="redraw").array
    whole = slice(128 + 25, 230) if fill else slice(26, 230)
    rest = np.abs(found - scan)[26:230]
    assert rest[:, whole].max() <= 0.5 * RANGE / 65535 + 1e-8
    graph = read_graph(client.graph(asset))
    left = (graph.node_uv[graph.edge_nodes][..., 0] < 0.49).all(axis=1) & (graph.edge_weight > 0)
    assert left.any() == (fill > 0.0)
    if fill:
        assert np.median(rest[:, 26:110]) > 100 * RANGE / 65535
        grain = asset.settings["shape"]["grain"]
        assert grain > 0.0


def test_strict_refuses_a_scan_with_warnings(client: Client) -> None:
    with pytest.raises(RequestError, match="scan-bits"):
        created(client, scan=image(relief(), "PNG", np.uint8), strict=True)


def test_a_snapshot_has_it(client: Client, tmp_path: Path) -> None:
    made = client.wait(created(client, scan=image(relief())))
    before = client.map(made, "neutral", 1001, method="redraw").array
    snapshot = client.snapshot(made, tmp_path)
    with (
        running(tmp_path / "store") as engine,
        serving(engine) as served,
        closing(Client(str(served.base_url))) as other,
    ):
        restored = other.restore(snapshot)
        assert (restored.id, restored.settings) == (made.id, client.asset(made).settings)
        after = other.map(restored, "neutral", 1001, method="redraw").array
    np.testing.assert_array_equal(after, before)
