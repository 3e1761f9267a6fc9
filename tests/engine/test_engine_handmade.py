"""A graph made elsewhere, over HTTP and through the engine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

import handmade
from api.asking import is_problem
from api.live import serving
from engine.engines import finish
from meshes import SmallMesh
from reference import drawing, redraw
from reference.inputs import Graph, Shape
from rhytid.engine.engine import Engine
from rhytid.formats.graphs import read_graph

SETTINGS = '{"preset": "paper", "resolution": 256, "tile_size": 64, "depth": 0.05}'


@pytest.fixture
def client(engine: Engine) -> Iterator[httpx.Client]:
    with serving(engine) as client:
        yield client


@pytest.fixture
def mesh_file(tmp_path: Path, small_mesh: SmallMesh) -> Path:
    np.savez(tmp_path / "mesh.npz", **small_mesh._asdict())
    return tmp_path / "mesh.npz"


def post(client: httpx.Client, mesh: Path, graph: Path) -> httpx.Response:
    files = {
        "mesh": (mesh.name, mesh.read_bytes()),
        "graph": (graph.name, graph.read_bytes()),
        "settings": (None, SETTINGS),
    }
    return client.post("/v1/assets", files=files)


def test_seven_wrinkles_are_drawn_as_they_were_made(
    engine: Engine, client: httpx.Client, mesh_file: Path, tmp_path: Path
) -> None:
    answer = post(client, mesh_file, handmade.write(tmp_path / "seven.safetensors"))
    assert answer.status_code == 202, answer.text
    assert finish(engine, answer.json()["job"]).state == "done"
    path = f"/v1/assets/{answer.json()['id']}"
    asset = client.get(path).json()
    assert (asset["pores"], asset["wrinkles"]) == (8, 7)
    assert asset["statistics"]["degree"] == pytest.approx(14 / 8)
    back = read_graph(client.get(f"{path}/graph").content)
    assert back.arrays().keys() == handmade.seven_wrinkles().keys()
    map = client.get(f"{path}/frames/neutral/maps/1001", params={"format": "f16"})
    found = np.frombuffer(map.content, "<f2").reshape(256, 256)
    points = drawing.crop(0, 0, 256, 256, 256)
    wanted = redraw.neutral(points, Graph(**handmade.seven_wrinkles()), Shape(), 0.05)
    assert np.abs(found - wanted.reshape(256, 256)).max() <= 1e-3 * 0.05
    assert np.abs(wanted).max() > 0.04
    curves = client.get(f"{path}/graph", params={"format": "obj"}).text.splitlines()
    assert [line for line in curves if line[0] == "l"] == [f"l 1 {i}" for i in range(2, 9)]


@pytest.mark.parametrize("name", handmade.BAD)
def test_what_is_wrong_is_named(
    client: httpx.Client, mesh_file: Path, tmp_path: Path, name: str
) -> None:
    changes, wrong = handmade.BAD[name]
    answer = post(client, mesh_file, handmade.write(tmp_path / "bad.safetensors", **changes))
    assert wrong in is_problem(answer, 422, "graph")
