"""Expressions over HTTP and from the SDK: a part, the mesh's own, mistakes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import numpy as np
import pytest

from api.live import serving
from api.patch import SETTINGS, obj, positions, upload
from engine.engines import running
from formats.writers import npy, npz
from rhytid_client import Client

pytestmark = pytest.mark.usefixtures("no_maps_ahead")

SMALL = {**SETTINGS, "unit": "ft", "graph": {"wrinkles": 400}}
SHAPES = np.stack([positions() * np.float32([0.8, 1, 1]), positions() * np.float32([0.9, 1, 1])])


def mesh_arrays() -> dict[str, np.ndarray]:
    """The arrays of the mesh of `obj`."""
    rows = [line.split() for line in obj().decode().splitlines()]
    uv = np.array([[float(x) for x in row[1:]] for row in rows if row[0] == "vt"])
    quads = [[int(c.split("/")[0]) - 1 for c in row[1:]] for row in rows if row[0] == "f"]
    faces = np.array([f for q in quads for f in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])
    return {"positions": positions(), "faces": faces, "uv": uv, "face_uv": faces}


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running(tmp_path_factory.mktemp("api")) as engine, serving(engine) as client:
        yield str(client.base_url)


@pytest.mark.slow
def test_every_way_of_sending_them_is_the_same_asset(url: str, tmp_path: Path) -> None:
    file = tmp_path / "shapes.npz"
    np.savez(file, shapes=SHAPES, names=np.array(["0000", "0001"]))
    ways = [SHAPES, file, npy(SHAPES), npz(frames=SHAPES), {"0000": SHAPES[0], "0001": SHAPES[1]}]
    with closing(Client(url)) as client:
        made = [client.create_asset(obj(), name="a.obj", settings=SMALL, shapes=w) for w in ways]
        plain = client.create_asset(obj(), name="a.obj", settings=SMALL)
        assert len({asset.id for asset in made}) == 1
        assert plain.id != made[0].id
        one, other = (client.graph(client.wait(asset)) for asset in (made[0], plain))
        assert one != other
        level = {**SMALL, "graph": {"wrinkles": 400, "lines": "level"}}
        again = client.create_asset(obj(), name="a.obj", settings=level, shapes=SHAPES)
        assert again.id == plain.id


def test_frames_of_the_mesh_file_count_where_there_are_no_shapes(url: str) -> None:
    arrays = mesh_arrays()
    with closing(Client(url)) as client:
        made = [
            client.create_asset({**arrays, **more}, settings=SMALL, shapes=shapes).id
            for more, shapes in (
                ({}, None), ({}, SHAPES), ({"frames": SHAPES}, None), ({"shapes": SHAPES}, None),
                ({"frames": SHAPES[:1], "shapes": SHAPES}, None),
                ({"frames": SHAPES[:1]}, SHAPES), ({"frames": SHAPES[:1]}, None),
            )
        ]  # fmt: skip
    assert len(set(made[1:6])) == 1
    assert len(set(made)) == 3


@pytest.mark.parametrize(
    ("part", "told"),
    [
        (("shapes.npy", npy(SHAPES[:, :20])), "part shapes: shapes have shape (2, 20, 3)"),
        (("shapes.npy", npy(SHAPES[0, :20])), "part shapes: shapes have shape (1, 20, 3)"),
        (("shapes.npy", npy(SHAPES)[:-1]), "part shapes: the file: the header promises"),
        (("shapes.npy", b""), "part shapes: the file is not a .npy array"),
        (("shapes.npy", npy(np.full_like(SHAPES, np.nan))), "shape 0000, vertex 0"),
        (("shapes.npz", npz(shapes=SHAPES[:, :20])), "part shapes: shapes have shape (2, 20, 3)"),
        (("shapes.npz", npz(frames=SHAPES[:, :20])), "part shapes: frames have shape (2, 20, 3)"),
        (("shapes.npz", npz(frames=np.full_like(SHAPES, np.nan))), "part shapes: frame 0001, ver"),
        (("shapes", npy(SHAPES)), "part shapes has no filename with .npz or .npy"),
        (("shapes.obj", obj()), "must be one of .npz, .npy"),
        (("shapes.npz", b"PK"), "not a readable .npz archive"),
    ],
)
def test_what_cannot_be_used_is_told(url: str, part: tuple[str, bytes], told: str) -> None:
    refused = httpx.post(f"{url}/v1/assets", files={**upload(), "shapes": part}, timeout=60)
    assert refused.status_code == 422
    assert told in refused.json()["detail"]
    if "part shapes:" in told:
        assert refused.json()["type"] == "urn:rhytid:problem:shapes"
        assert refused.json()["title"] == "The shapes cannot be used"


@pytest.mark.parametrize(
    ("array", "values", "told"),
    [
        ("positions", positions()[:, :2], "part mesh: positions has shape (25, 2), not (N, 3)"),
        ("frames", SHAPES[0], "part mesh: frames have shape (25, 3), not (N, 25, 3)"),
        ("shapes", SHAPES[0], "part mesh: shapes have shape (25, 3)"),
    ],
)
def test_a_wrong_array_of_the_mesh_is_named(
    url: str, array: str, values: np.ndarray, told: str
) -> None:
    sent = npz(**{**mesh_arrays(), array: values})
    refused = httpx.post(f"{url}/v1/assets", files={"mesh": ("mesh.npz", sent)}, timeout=60)
    assert refused.status_code == 422
    assert refused.json()["detail"].startswith(told)


def test_expressions_that_are_asked_for_must_come(url: str) -> None:
    files = upload(unit="ft", graph={"wrinkles": 200, "lines": "expressions"})
    refused = httpx.post(f"{url}/v1/assets", files=files, timeout=60)
    assert refused.status_code == 422
    assert 'graph.lines is "expressions", and none came' in refused.json()["detail"]


def test_the_part_is_documented(url: str) -> None:
    document = httpx.get(f"{url}/openapi.json").json()
    form = document["paths"]["/v1/assets"]["post"]["requestBody"]["content"]
    assert "shapes (E, V, 3)" in str(form["multipart/form-data"]["schema"]["properties"]["shapes"])
