"""Files and bodies that are damaged or made up: read, or refused by an error of ours."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from api.patch import obj, positions
from attack.bombs import TRIANGLE, grey_png, images
from exr_images import exr
from formats import writers
from formats.test_format_graph import ARRAYS, METADATA, OPTIONAL
from processes.decoding.test_decoding import read
from rhytid.api.multipart import PartReader
from rhytid.api.spool import Spool
from rhytid.api.uploads import decode_json
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.byte_budget import ByteBudget
from rhytid.errors import RhytidError
from rhytid.formats import exr as exr_format
from rhytid.formats.frames import NPY, RAW, read_expressions, read_positions
from rhytid.formats.gltf import promised_by_gltf
from rhytid.formats.graphs import read_graph, write_graph
from rhytid.formats.meshes import read_mesh
from rhytid.formats.npz import promised_by_npz
from rhytid.formats.painted import read_grey

pytestmark = pytest.mark.attack
hard = settings(
    max_examples=500,
    deadline=None,
    database=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
FRAMES = np.stack([TRIANGLE["positions"], TRIANGLE["positions"] + 1]).astype(np.float32)
MEMBERS = {**TRIANGLE, "frames": FRAMES, "shapes": FRAMES, "names": np.array(["a", "b"])}
POINTS = {
    "POSITION": TRIANGLE["positions"].astype("<f4"),
    "TEXCOORD_0": TRIANGLE["uv"].astype("<f4"),
    "indices": np.array([[0], [1], [2]], "<u2"),
}
DOCUMENT = writers.gltf(POINTS, targets=[{"POSITION": 0}, {"POSITION": 0}])
TABLES = TRIANGLE["positions"], TRIANGLE["uv"], [(0, 1, 2)]
MESHES = {
    "m.obj": obj(),
    "m.gltf": json.dumps(DOCUMENT).encode(),
    "m.glb": writers.glb(DOCUMENT),
    "m.npz": writers.npz(**MEMBERS),
    "a.ply": writers.ply(*TABLES, "ascii"),
    "b.ply": writers.ply(*TABLES),
}
GRAPH = write_graph(WrinkleGraph(**ARRAYS, **OPTIONAL), METADATA)
FRAME = writers.npy(positions())
GREY = np.linspace(0, 1, 64, dtype=np.float16).reshape(8, 8)
SETTINGS = b'{"depth": 1.5, "graph": {"wrinkles": 200}, "unit": "mm"}'
BOUNDARY = b"edge"
BODY = (
    b'--edge\r\nContent-Disposition: form-data; name="mesh"; filename="m.obj"\r\n\r\nv 0 0 0\r\n'
    b'--edge\r\nContent-Disposition: form-data; name="settings"\r\n\r\n{"depth": 1}\r\n--edge--\r\n'
)


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """Bytes with some changed, added, taken away or repeated."""
    data = bytearray(whole)
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        long = draw(st.integers(0, 40))
        piece = draw(
            st.binary(max_size=12)
            | st.sampled_from([b"\0" * 8, b"\xff" * 8, b"-1", b"1e999", b"nan", b"999999999999"])
        )
        kind = draw(st.sampled_from(["change", "insert", "remove", "repeat", "cut"]))
        if kind == "change":
            data[at : at + len(piece)] = piece
        elif kind == "insert":
            data[at:at] = piece
        elif kind == "remove":
            del data[at : at + long]
        elif kind == "repeat":
            data[at:at] = data[at : at + long]
        elif draw(st.booleans()):
            del data[at:]
    return bytes(data)


def taken(read: Callable[..., Any], *arguments: Any) -> None:
    """Nothing but an error of ours comes out."""
    with suppress(RhytidError), np.errstate(all="ignore"):
        read(*arguments)


@pytest.mark.parametrize("name", MESHES)
@given(data=st.data())
@hard
def test_meshes(name: str, data: st.DataObject) -> None:
    sent = data.draw(damaged(MESHES[name]))
    taken(read_mesh, sent, name)
    if name.endswith((".gltf", ".glb")):
        taken(promised_by_gltf, sent)


@given(data=st.data())
@hard
def test_members_of_archives(data: st.DataObject) -> None:
    """Whole archives, whose arrays are damaged."""
    chosen = data.draw(st.sets(st.sampled_from(sorted(MEMBERS)), min_size=1, max_size=3))
    members = []
    for name, array in MEMBERS.items():
        file = writers.npy(array)
        members.append((f"{name}.npy", data.draw(damaged(file)) if name in chosen else file))
    sent = writers.archive(members)
    taken(read_mesh, sent, "m.npz")
    taken(promised_by_npz, sent)
    taken(read_expressions, sent, "m.npz", Mesh(**TRIANGLE))


@given(damaged(GRAPH))
@hard
def test_graphs(data: bytes) -> None:
    taken(read_graph, data)


@given(damaged(FRAME) | st.binary(max_size=400), st.sampled_from([NPY, RAW]))
@hard
def test_frames(data: bytes, kind: str) -> None:
    taken(read_positions, data, kind, len(positions()))


@given(damaged(grey_png(8)))
@hard
def test_png_images(data: bytes) -> None:
    taken(read_grey, data, "m.png")


@given(damaged(exr(GREY)[:400]))
@hard
def test_exr_headers(data: bytes) -> None:
    taken(exr_format.read_sides, data, "m.exr")


@given(damaged(exr(GREY)))
@settings(hard, max_examples=20)
def test_exr_images(data: bytes) -> None:
    """In the process that decodes them."""
    if data.startswith(exr_format.SIGNATURE):
        budget = ByteBudget(1 << 30, "RHYTID_HOST_MEMORY_MB")
        taken(read, images(1, data, "exr"), budget.hold("uploads"))


@given(damaged(BODY), st.lists(st.integers(0, len(BODY)), max_size=4))
@hard
def test_multipart_bodies(data: bytes, cuts: list[int]) -> None:
    def read() -> None:
        reader, at = PartReader(BOUNDARY, Spool()), 0
        for cut in (*sorted(cuts), len(data)):
            reader.feed(data[at:cut])
            at = max(at, cut)
        for part in reader.finish().values():
            assert part.data in data

    taken(read)


@given(
    st.binary(max_size=200) | damaged(b'{"depth": 1.5, "graph": {"wrinkles": 200}, "unit": "mm"}')
)
@hard
def test_settings(data: bytes) -> None:
    taken(lambda: AssetSettings.parse(decode_json(data, "settings")))
