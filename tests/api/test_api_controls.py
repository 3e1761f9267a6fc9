"""Painted synthesis over HTTP and from the SDK: a mask, a mistake, a part that repeats."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image

from api.live import serving
from api.patch import SETTINGS, obj, upload
from engine.engines import running
from exr_images import exr
from rhytid.domain.painted_maps import CONTROLS
from rhytid.formats.graphs import read_graph
from rhytid_client import Client

SMALL = {**SETTINGS, "unit": "ft", "graph": {"wrinkles": 1000}}


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running(tmp_path_factory.mktemp("api")) as engine, serving(engine) as client:
        yield str(client.base_url)


def png(left: int, right: int) -> bytes:
    stream = io.BytesIO()
    texels = np.array([[left] * 8 + [right] * 8] * 16, np.uint8)
    Image.fromarray(texels).save(stream, "PNG")
    return stream.getvalue()


def test_a_mask_leaves_no_pores(url: str, tmp_path: Path) -> None:
    file = tmp_path / "mask.1001.png"
    file.write_bytes(png(128, 0))
    with closing(Client(url)) as client:
        controls = {"density": file, "region_lip": {1001: png(0, 255)}}
        asset = client.create_asset(obj(), name="a.obj", settings=SMALL, controls=controls)
        client.wait(asset)
        graph = read_graph(client.graph(asset))
        found = client.asset(asset)
    drawn = graph.node_uv[graph.node_weight > 0]
    assert drawn[:, 0].max() < 0.55
    assert found.wrinkles == graph.wrinkles == pytest.approx(500, rel=0.1)
    assert found.settings["graph"]["density"] == 1.0


def test_one_half_in_an_exr_is_mid_grey(url: str) -> None:
    neutral = exr(np.full((16, 16), 0.5, np.float16))
    names = [name for name in CONTROLS if name != "direction" and "region" not in name]
    graphs = []
    with closing(Client(url)) as client:
        for image in (neutral, png(127, 128)):
            controls = {name: {1001: image} for name in names}
            asset = client.create_asset(obj(), name="a.obj", settings=SMALL, controls=controls)
            client.wait(asset)
            graphs.append(read_graph(client.graph(asset)).arrays())
    for name, array in graphs[0].items():
        np.testing.assert_array_equal(array, graphs[1][name], err_msg=name)


def test_an_empty_mask_is_told_at_once(url: str) -> None:
    files = {**upload(), "density": ("d.png", png(0, 0))}
    refused = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
    assert refused.status_code == 422
    assert "the map leaves no room for pores" in refused.json()["detail"]


def test_more_than_fits_is_413(url: str) -> None:
    files = upload(graph={"wrinkles": 40_000_000, "density": 16})
    refused = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
    assert refused.status_code == 413
    # Which is less depends on the machine.
    assert re.search(r"(a graph|device memory) can hold \d+$", refused.json()["detail"])


def test_every_control_is_a_part_and_is_documented(url: str) -> None:
    document = httpx.get(f"{url}/openapi.json").json()
    form = document["paths"]["/v1/assets"]["post"]["requestBody"]["content"]
    assert set(CONTROLS) < set(form["multipart/form-data"]["schema"]["properties"])
    for name in CONTROLS:
        files = [*upload().items(), *[(name, (f"{name}.png", png(9, 250)))] * 2]
        refused = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
        assert refused.status_code == 422
        assert f"{name}.png names no UDIM" in refused.json()["detail"]
