"""A whole session with the real application, over a real socket, on an engine without a device."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from api import patch
from api.fake_engine import FakeEngine
from api.live import serving
from rhytid_client import (
    AsyncClient,
    Client,
    Conflict,
    Job,
    NotFound,
    NotReady,
    PlainClient,
    RequestError,
    RhytidWarning,
    TooLarge,
)

Call = Callable[..., Any]
LIMIT = 1 << 20
MADE = {"name": "patch.obj", "settings": patch.SETTINGS}


@pytest.fixture(scope="module", params=["sync", "plain", "async"])
def call(request: pytest.FixtureRequest) -> Iterator[Call]:
    """`call(method, ...)` calls a method of a client of a server of its own."""
    with serving(FakeEngine(polls=3), upload_limit=LIMIT) as http:
        url = str(http.base_url)
        if request.param == "sync":
            with Client(url, max_wait=0.3) as client:
                yield lambda method, /, *args, **kwargs: getattr(client, method)(*args, **kwargs)
        elif request.param == "plain":
            plain = PlainClient(url, max_wait=0.3)
            yield lambda method, /, *args, **kwargs: getattr(plain, method)(*args, **kwargs)
        else:
            yield from _awaited(url)


def _awaited(url: str) -> Iterator[Call]:
    with closing(asyncio.new_event_loop()) as loop:
        client = loop.run_until_complete(AsyncClient(url, max_wait=0.3).__aenter__())
        yield lambda method, /, *args, **kwargs: loop.run_until_complete(
            getattr(client, method)(*args, **kwargs)
        )
        loop.run_until_complete(client.__aexit__())


@pytest.fixture
def asset(call: Call) -> str:
    return str(call("wait", call("create_asset", patch.obj(), **MADE), timeout=30).id)


def test_server(call: Call) -> None:
    assert call("health") is True
    assert call("ready") is True
    assert call("devices")[0].compute_units == 2
    assert "rhytid" in call("metrics")


def test_build_is_followed(call: Call, tmp_path: Path) -> None:
    mesh = tmp_path / "patch.obj"
    mesh.write_bytes(patch.obj(3.0))
    sent: list[tuple[int, int]] = []
    told: list[Job] = []
    made = call(
        "create_asset",
        mesh,
        settings=patch.SETTINGS,
        progress=lambda done, total: sent.append((done, total)),
    )
    assert made.state == "building"
    assert sent[-1][0] == sent[-1][1] > mesh.stat().st_size
    built = call("wait", made, progress=told.append, timeout=30)
    assert built.state == "ready"
    assert built.wrinkles > 0
    assert built.settings["resolution"] == patch.SETTINGS["resolution"]
    assert (told[-1].state, told[-1].progress) == ("done", 1.0)
    assert built in call("assets")
    call("delete_asset", built)
    with pytest.raises(NotFound, match=made.id):
        call("asset", made)


def test_arrays_and_their_frames(call: Call) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    arrays = {
        "positions": corners,
        "faces": [[0, 1, 2]],
        "uv": corners[:, :2] * 0.9,
        "face_uv": [[0, 1, 2]],
        "frames": np.stack([corners, 2 * corners]),
    }
    built = call("wait", call("create_asset", arrays, settings=patch.SETTINGS), timeout=30)
    assert [frame.name for frame in call("frames", built)] == ["neutral", "0001", "0002"]
    assert np.array_equal(call("positions", built, "0002"), 2 * corners)
    with pytest.warns(RhytidWarning, match="0000 of a mesh file is named 0001 now") as told:
        assert np.array_equal(call("positions", built, "0000"), corners)
    assert ["rhytid_client" in one.filename for one in told] == [False]


def test_graph_comes_as_curves_too(call: Call, asset: str) -> None:
    assert call("graph", asset, format="obj").startswith(b"# 2 wrinkles")
    assert call("graph", asset, format="usda").startswith(b"#usda 1.0\n")
    with pytest.raises(RequestError, match="'abc': one of safetensors, obj, usda"):
        call("graph", asset, format="abc")


def test_the_mesh_comes_as_glb_and_ply(call: Call, asset: str) -> None:
    assert call("mesh", asset).startswith(b"glTF")
    assert call("mesh", asset, format="ply").startswith(b"ply\n")


def test_graph_goes_back_where_it_came_from(call: Call, asset: str) -> None:
    graph = call("graph", asset)
    made = call("create_asset", patch.obj(2.0), **MADE, graph=graph)
    assert call("wait", made, timeout=30).wrinkles == call("asset", asset).wrinkles


@pytest.mark.parametrize("raw", [False, True])
def test_frames(call: Call, asset: str, raw: bool) -> None:
    put = call("put_frame", asset, "smile", patch.smile(), raw=raw)
    assert put == call("frame", asset, "smile")
    assert put.log_stretch.keys() >= {"p50", "abs_p90"}
    assert np.array_equal(call("positions", asset, "smile"), patch.smile())
    stretch = call("stretch", asset, "smile")
    assert stretch.axes.shape == (*stretch.ratios.shape, 2)
    call("delete_frame", asset, "smile")
    with pytest.raises(NotFound, match="smile"):
        call("frame", asset, "smile")


def test_tiles_maps_and_formats(call: Call, asset: str) -> None:
    call("put_frame", asset, "smile", patch.smile())
    place = (asset, "smile", 1001, 0, 1, 2)
    tile = call("tile", *place)
    whole = call("map", asset, "smile", 1001).array
    n = len(tile.array)
    assert np.array_equal(tile.array, whole[n : 2 * n, 2 * n : 3 * n])
    assert call("tile", *place, if_none_match=tile) is tile
    half = call("tile", *place, format="f16").array
    assert np.array_equal(half, tile.array.astype(np.float16))
    image = call("tile", *place, format="png")
    assert image.content.startswith(b"\x89PNG")
    assert image.scale >= np.abs(whole).max()
    assert call("map", asset, "smile", 1001, level=2, format="exr").content[:4] == b"v/1\x01"
    call("put_frame", asset, "smile", patch.smile(0.2))
    assert call("tile", *place, if_none_match=tile) is not tile


@pytest.mark.parametrize("format", ["npy", "f16", "png"])
def test_one_trip(call: Call, asset: str, format: str) -> None:
    call("put_frame", asset, "smile", patch.smile())
    addresses = [(1001, 0, 1, 2), (1001, 2, 0, 0), (1001, 0, 0, 0)]
    query = {"format": format, "method": "binned"}
    once = call("tiles", asset, patch.smile(), addresses, **query)
    for address, tile in zip(addresses, once, strict=True):
        stored = call("tile", asset, "smile", *address, **query)
        assert tile.scale == stored.scale
        if format == "png":
            assert bytes(tile.content)[:4] == b"\x89PNG"
        else:
            assert np.array_equal(tile.array, stored.array)


def test_bins(call: Call, asset: str) -> None:
    bins = call("bins", asset)
    assert len(bins.angles) == bins.layers["wrinkles"]
    assert len(bins.steps["pores"]) == len(bins.samples)
    cushion = {"factor": 4, "apron": 2, "samples": (-0.5, 0.0, 0.5), "exponent": 4.0}
    assert bins.cushion == cushion
    assert bins.grain == {"exponent": 2.0}
    assert call("bin_tile", asset, 1001, 0, 0, 0, bin=1, sample=2).dtype == np.int8
    grain, whole = (
        call("bin_tile", asset, 1001, 0, 0, 0, layer="grain", **given)
        for given in ({}, {"bin": 0, "sample": 0})
    )
    np.testing.assert_array_equal(grain, whole)
    with pytest.raises(RequestError, match="bin is missing: layer wrinkles"):
        call("bin_tile", asset, 1001, 0, 0, 0)


def test_calibration_and_changes(call: Call, asset: str) -> None:
    done = call("wait", call("calibrate", asset, patch.smile()), timeout=30)
    assert done.state == "done"
    assert call("change_asset", asset, {"depth": 0.02}).settings["depth"] == 0.02


def test_cancelled_build(call: Call) -> None:
    made = call("create_asset", patch.obj(4.0), **MADE)
    assert call("cancel", made.job).state == "cancelled"
    assert call("job", made.job).ended


def test_call_on_a_building_asset_is_told_so(call: Call) -> None:
    made = call("create_asset", patch.obj(5.0), **MADE)
    with pytest.raises(NotReady, match="still building"):
        call("graph", made)


def test_refusals_say_why(call: Call, asset: str) -> None:
    with pytest.raises(Conflict, match="neutral") as conflict:
        call("put_frame", asset, "neutral", patch.smile())
    assert conflict.value.status == 409
    with pytest.raises(RequestError, match="resolutoin") as refused:
        call("create_asset", patch.obj(), name="p.obj", settings={"resolutoin": 1})
    assert refused.value.type.endswith("settings")
    with pytest.raises(RequestError, match=r"\(24, 3\)"):
        call("put_frame", asset, "smile", patch.smile()[:24])
    with pytest.raises(NotFound, match="1002"):
        call("tile", asset, "neutral", 1002, 0, 0, 0)
    with pytest.raises(TooLarge, match=str(LIMIT)):
        call("create_asset", bytes(2 * LIMIT), name="p.obj")


def test_bytes_need_a_name(call: Call) -> None:
    with pytest.raises(ValueError, match="need a name"):
        call("create_asset", b"v 0 0 0")
