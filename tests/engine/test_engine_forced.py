"""A graph of another mesh, over HTTP and from the command line."""

from __future__ import annotations

import numpy as np
import pytest

from api.live import serving
from engine.engines import running
from rhytid.api.multipart import Part
from rhytid.api.routes.assets import new_asset
from rhytid.api.spool import Spool
from rhytid.cli import main
from rhytid.engine.byte_budget import ByteBudget
from rhytid.errors import InputError
from rhytid.formats.graphs import read_graph
from rhytid.processes.decoding.decoder import Decoder
from rhytid_client import Client, RequestError
from synthesis import sheets

SETTINGS = {"resolution": 256, "tile_size": 256, "unit": "mm", "graph": {"spacing": 8.0}}
ARRAYS = ("positions", "faces", "uv", "face_uv")


def arrays(mesh):
    return {name: getattr(mesh, name) for name in ARRAYS}


ONE = arrays(sheets.sheet(scale=160.0))
OTHER = arrays(sheets.sheet(lambda xy: 0.1 + 0.7 * xy, scale=160.0))


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with (
        running(tmp_path_factory.mktemp("store")) as engine,
        serving(engine) as http,
        Client(str(http.base_url)) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def graph(client):
    return client.graph(client.wait(client.create_asset(ONE, settings=SETTINGS)))


def test_the_file_says_what_it_is_drawn_with(graph):
    origin = read_graph(graph).origin
    assert (origin.unit, origin.spacing, origin.depth) == ("mm", 8.0, pytest.approx(1.2))
    assert (origin.sigma, origin.wave_frequency) == (2.0, 0.05)


def test_the_service_takes_it_where_it_is_forced(client, graph):
    sizes = {name: SETTINGS[name] for name in ("resolution", "tile_size")}
    with pytest.raises(RequestError, match=r"made for another mesh.*form field"):
        client.create_asset(OTHER, settings=sizes, graph=graph)
    made = client.wait(client.create_asset(OTHER, settings=sizes, graph=graph, force=True))
    assert made.settings["unit"] == "mm"
    assert made.settings["depth"] == pytest.approx(1.2)


def part(name, filename, data):
    """A part of a form."""
    spool = Spool()
    spool.write(data)
    return Part(name, filename, spool, 0, len(data))


def read(parts):
    """What an upload of these parts is decoded to."""
    memory = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")
    return new_asset(parts, Decoder(), memory.hold("uploads"), lambda: False)


@pytest.mark.parametrize("sent", ["yes", "1", "", "null"])
def test_force_is_true_or_false(sent):
    mesh = part("mesh", "mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
                b"f 1/1 2/2 3/3\n")  # fmt: skip
    assert read({"mesh": mesh, "force": part("force", None, b"true")}).force
    assert not read({"mesh": mesh, "force": part("force", None, b"false")}).force
    assert not read({"mesh": mesh}).force
    with pytest.raises(InputError, match="part force"):
        read({"mesh": mesh, "force": part("force", None, sent.encode())})


@pytest.mark.parametrize("command", ["graph", "bake", "bench"])
def test_commands_take_it_where_it_is_forced(tmp_path, graph, capsys, command):
    mesh, file = tmp_path / "other.npz", tmp_path / "g.safetensors"
    np.savez(mesh, **OTHER, frames=OTHER["positions"][None] * np.float32(1.1))
    file.write_bytes(graph)
    given = {
        "graph": [str(mesh), str(file)],
        "bake": ["--mesh", str(mesh), "--graph", str(file), "--out", str(tmp_path / "maps"),
                 "--resolution", "256"],
        "bench": ["--mesh", str(mesh), "--graph", str(file), "--size", "256", "--repeats", "1",
                  "--methods", "redraw", "--implementations", "rhytid"],
    }[command]  # fmt: skip
    assert main([command, *given]) == 1
    assert "made for another mesh" in capsys.readouterr().err
    assert main([command, *given, "--force"]) == 0
