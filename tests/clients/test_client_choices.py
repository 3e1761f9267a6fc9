"""Names that are not known are seen by a type checker, and the names are the server's."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import pytest
from mypy import api

from house.syntax import ROOT
from rhytid.api.live.wire import CODES as LIVE_FORMATS
from rhytid.api.schemas import GRAPH_FORMATS
from rhytid.domain.methods import METHODS, SAMPLINGS, STRETCH_MODELS
from rhytid.exports.meshes import MESH_FORMATS
from rhytid.formats.tiles import FORMATS
from rhytid_client import (
    GraphFormat,
    LiveFormat,
    MeshFormat,
    Method,
    Sampling,
    StretchModel,
    TileFormat,
)

PROGRAM = """\
from rhytid_client import AsyncClient, Client, PlainClient, Tile
client, plain = Client(), PlainClient()
client.map("a", "f", 1001, method="binned", stretch="uv", sampling="smooth", format="exr16")
client.map("a", "f", 1001, method="bined")
client.tile("a", "f", 1001, 0, 0, 0, format="jpg")
client.tiles("a", [[0.0]], [(1001, 0, 0, 0)], stretch="strain")
plain.map("a", "f", 1001, sampling="linear")
plain.graph("a", format="fbx")
client.mesh("a", format="stl")
async def go(later: AsyncClient) -> Tile:
    await later.map("a", "f", 1001, method="bined")
    return await later.map("a", "f", 1001, method="binned")
"""
WRONG = {4, 5, 6, 7, 8, 9, 11}


@pytest.mark.parametrize(
    ("literal", "known"),
    [
        (Method, METHODS),
        (StretchModel, STRETCH_MODELS),
        (Sampling, SAMPLINGS),
        (TileFormat, FORMATS),
        (GraphFormat, GRAPH_FORMATS),
        (MeshFormat, MESH_FORMATS),
        (LiveFormat, LIVE_FORMATS),
    ],
)
def test_names_are_those_of_the_server(literal: Any, known: Any) -> None:
    assert get_args(literal) == tuple(known)


@pytest.mark.slow
def test_wrong_names_are_errors_of_types_and_the_examples_have_none(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    config = ["--strict", "--config-file", str(ROOT / "pyproject.toml")]
    cache = ["--cache-dir", str(tmp_path / "cache")]
    examples = [str(file) for file in sorted((ROOT / "examples").glob("*.py"))]
    told, problems, _ = api.run([*config, *cache, str(program), *examples])
    assert problems == ""
    errors = [line for line in told.splitlines() if ": error:" in line]
    assert {int(line.split("program.py:")[1].split(":")[0]) for line in errors} == WRONG
    assert all("[arg-type]" in line for line in errors), told
