"""Assets over HTTP: sending, listing, changing, removing; and what is refused."""

from __future__ import annotations

import io
import json
from typing import Any

import httpx
import numpy as np
import pytest

from api.asking import built, is_problem
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import SIDE, obj, positions, smile, upload
from rhytid.formats.graphs import read_graph
from rhytid.formats.meshes import read_mesh


def post(client: httpx.Client, files: Any) -> httpx.Response:
    return client.post("/v1/assets", files=files)


def test_a_new_asset_is_accepted_and_builds() -> None:
    with serving(FakeEngine(polls=2)) as client:
        response = post(client, upload())
        asset = response.json()
        assert response.status_code == 202
        assert response.headers["location"] == f"/v1/assets/{asset['id']}"
        assert asset["state"] == "building"
        assert client.get(f"/v1/jobs/{asset['job']}").json()["state"] == "running"
        again = post(client, upload())
        assert (again.status_code, again.json()["id"]) == (202, asset["id"])


def test_an_asset_that_builds_answers_409_and_when_to_ask_again() -> None:
    with serving(FakeEngine(polls=5)) as client:
        path = f"/v1/assets/{post(client, upload()).json()['id']}"
        for call in (f"{path}/graph", f"{path}/bins", f"{path}/frames/neutral/tiles/1001/0/0/0"):
            response = client.get(call)
            assert "building" in is_problem(response, 409, "not-ready")
            assert response.headers["retry-after"] == "1"


def test_the_same_content_again_is_the_same_asset(client: httpx.Client, asset: str) -> None:
    response = post(client, upload())
    assert response.status_code == 200
    assert response.json()["id"] == asset


def test_an_asset_says_what_it_is(client: httpx.Client, asset: str) -> None:
    found = client.get(f"/v1/assets/{asset}").json()
    assert found["state"] == "ready"
    assert found["reason"] is None
    assert found["udims"] == [1001]
    assert found["levels"] == 9
    assert (found["vertices"], found["triangles"]) == (SIDE**2, 2 * (SIDE - 1) ** 2)
    assert found["pores"] > 0
    assert found["wrinkles"] > 0
    assert found["settings"]["resolution"] == 256
    assert found["settings"]["depth"] > 0
    assert found in client.get("/v1/assets").json()


def test_a_small_resolution_needs_no_tile_size() -> None:
    settings = json.dumps({"resolution": 256, "graph": {"wrinkles": 200}})
    with serving(FakeEngine(polls=1)) as client:
        response = post(client, {**upload(), "settings": (None, settings)})
        assert response.status_code == 202
        assert response.json()["settings"]["tile_size"] == 256


def test_the_graph_comes_as_safetensors(client: httpx.Client, asset: str) -> None:
    response = client.get(f"/v1/assets/{asset}/graph")
    graph = read_graph(response.content)
    assert response.headers["content-length"] == str(len(response.content))
    assert graph.wrinkles == client.get(f"/v1/assets/{asset}").json()["wrinkles"]
    sent = {**upload(depth=0.5), "graph": ("graph.safetensors", response.content)}
    assert post(client, sent).status_code in (200, 202)


@pytest.mark.parametrize(
    ("asked", "some"),
    [
        ("bytes=0-99", slice(0, 100)),
        ("bytes=100-", slice(100, None)),
        ("bytes=-7", slice(-7, None)),
        ("bytes=-99999999", slice(0, None)),
        ("bytes=8-999999999999", slice(8, None)),
    ],
)
@pytest.mark.parametrize("file", ["graph", "mesh"])
def test_a_range_of_a_file_is_answered(
    client: httpx.Client, asset: str, file: str, asked: str, some: slice
) -> None:
    path = f"/v1/assets/{asset}/{file}"
    whole = client.get(path)
    assert (whole.status_code, whole.headers["accept-ranges"]) == (200, "bytes")
    tag = whole.headers["etag"]
    for head in ({}, {"If-Range": tag}):
        part = client.get(path, headers={"Range": asked, **head})
        assert part.status_code == 206
        assert part.content == whole.content[some]
        first, stop, _ = some.indices(len(whole.content))
        assert part.headers["content-range"] == f"bytes {first}-{stop - 1}/{len(whole.content)}"
        assert part.headers["content-length"] == str(len(part.content))
        assert part.headers["etag"] == tag
    other = client.get(path, headers={"Range": asked, "If-Range": '"another"'})
    assert (other.status_code, other.content) == (200, whole.content)
    known = client.get(path, headers={"Range": asked, "If-None-Match": tag})
    assert known.status_code == 304


def test_the_pieces_of_a_graph_can_be_put_together(client: httpx.Client, asset: str) -> None:
    path, each = f"/v1/assets/{asset}/graph", 1000
    whole = client.get(path).content
    parts = [
        client.get(path, headers={"Range": f"bytes={at}-{at + each - 1}"}).content
        for at in range(0, len(whole), each)
    ]
    assert b"".join(parts) == whole


@pytest.mark.parametrize(
    "asked", ["bytes=0-1,5-6", "lines=0-1", "bytes=5-2", "bytes=-", "bytes=a-b", "bytes 0-1", ""]
)
def test_what_is_no_single_range_of_bytes_is_ignored(
    client: httpx.Client, asset: str, asked: str
) -> None:
    path = f"/v1/assets/{asset}/graph"
    answer = client.get(path, headers={"Range": asked})
    assert (answer.status_code, answer.content) == (200, client.get(path).content)


@pytest.mark.parametrize("asked", ["bytes=99999999-", "bytes=99999999-999999999", "bytes=-0"])
def test_a_range_after_the_end_is_refused(client: httpx.Client, asset: str, asked: str) -> None:
    path = f"/v1/assets/{asset}/graph"
    answer = client.get(path, headers={"Range": asked})
    is_problem(answer, 416)
    size = len(client.get(path).content)
    assert answer.headers["content-range"] == f"bytes */{size}"


def test_lines_in_space_have_no_ranges(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/graph?format=obj"
    answer = client.get(path, headers={"Range": "bytes=0-1"})
    assert (answer.status_code, answer.headers["accept-ranges"]) == (200, "none")


def test_the_graph_comes_as_lines_in_space(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/graph"
    obj, usda = (client.get(path, params={"format": kind}) for kind in ("obj", "usda"))
    assert (obj.status_code, obj.headers["content-type"]) == (200, "model/obj")
    assert obj.text.splitlines()[-2:] == ["l 1 2", "l 3 1"]
    assert (usda.status_code, usda.headers["content-type"]) == (200, "model/vnd.usda")
    assert usda.text.startswith("#usda 1.0\n")
    stored = client.get(path, params={"format": "safetensors"})
    assert stored.content == client.get(path).content
    for query in ({"format": "abc"}, {"format": ["obj", "usda"]}):
        is_problem(client.get(path, params=query), 422, "query")
    assert "colour" in is_problem(client.get(path, params={"colour": "red"}), 422, "query")
    is_problem(client.get("/v1/assets/none/graph?format=obj"), 404, "not-found")


def test_the_mesh_comes_as_other_programs_read_it(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/mesh"
    glb, ply = (client.get(path, params={"format": kind}) for kind in ("glb", "ply"))
    assert (glb.status_code, glb.headers["content-type"]) == (200, "model/gltf-binary")
    assert (ply.status_code, ply.headers["content-type"]) == (200, "application/x-ply")
    assert client.get(path).content == glb.content
    read = [read_mesh(r.content, f"m.{k}").mesh for r, k in ((glb, "glb"), (ply, "ply"))]
    assert np.array_equal(read[0].positions, read[1].positions)
    is_problem(client.get(path, params={"format": "obj"}), 422, "query")
    assert "colour" in is_problem(client.get(path, params={"colour": "red"}), 422, "query")
    is_problem(client.get("/v1/assets/none/mesh"), 404, "not-found")


def test_an_asset_has_figures_of_its_graph(client: httpx.Client, asset: str) -> None:
    found = client.get(f"/v1/assets/{asset}").json()["statistics"]
    assert found == {
        "spacing": 0.01,
        "distance": 0.01,
        "degree": 1.0,
        "strengths": [0] * 9 + [1],
        "events": {},
    }


def test_settings_change_without_a_new_asset(client: httpx.Client) -> None:
    path = f"/v1/assets/{built(client, upload(depth=0.25))}"
    changed = client.patch(path, json={"depth": 0.5, "response": {"beta_w": 2}})
    assert changed.status_code == 200
    assert changed.json()["settings"]["depth"] == 0.5
    assert changed.json()["settings"]["response"]["beta_w"] == 2
    assert client.get(path).json() == changed.json()


def test_a_removed_asset_is_gone(client: httpx.Client) -> None:
    path = f"/v1/assets/{post(client, upload(obj(2.0))).json()['id']}"
    response = client.delete(path)
    assert (response.status_code, response.content) == (204, b"")
    is_problem(client.get(path), 404, "not-found")
    is_problem(client.delete(path), 404, "not-found")


def test_frames_in_an_npz_are_stored(client: httpx.Client) -> None:
    faces = np.array([[0, 1, 6], [0, 6, 5]], np.int32)
    uv = positions()[:, :2].astype(np.float64)
    file = io.BytesIO()
    frames = np.stack([smile(0.1), smile(0.2)])
    np.savez(file, positions=positions(), faces=faces, uv=uv, face_uv=faces, frames=frames)
    made = built(client, upload(file.getvalue(), "patch.npz"))
    names = [f["name"] for f in client.get(f"/v1/assets/{made}/frames").json()]
    assert names == ["neutral", "0001", "0002"]


BAD_MESHES = {
    "no uv": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 4"),
    "not finite": (obj().replace(b"v 0 0 ", b"v nan 0 ", 1), "line 1"),
    "empty": (b"", ""),
}


@pytest.mark.parametrize(("mesh", "where"), BAD_MESHES.values(), ids=BAD_MESHES.keys())
def test_a_bad_mesh_is_refused(client: httpx.Client, mesh: bytes, where: str) -> None:
    assert where in is_problem(post(client, upload(mesh)), 422, "mesh")


def test_a_truncated_file_is_refused(client: httpx.Client) -> None:
    file = io.BytesIO()
    np.savez(file, positions=positions())
    half = file.getvalue()[: file.tell() // 2]
    assert is_problem(post(client, upload(half, "patch.npz")), 422, "mesh")


def test_an_unknown_extension_is_refused(client: httpx.Client) -> None:
    assert ".fbx" in is_problem(post(client, upload(name="patch.fbx")), 422, "mesh")


BAD_SETTINGS = {
    "unknown key": (b'{"resolutoin": 256}', 422, "settings", "resolutoin"),
    "wrong type": (b'{"bins": {"count": "4"}}', 422, "settings", "bins.count"),
    "not JSON": (b"{resolution: 256}", 422, "settings", "part settings is not JSON"),
    "not UTF-8": (b'{"unit": "\xff"}', 422, "settings", "not UTF-8 at byte 10"),
    "key twice": (b'{"depth": 1, "depth": 2}', 422, "settings", "'depth' occurs twice"),
    "NaN": (b'{"depth": NaN}', 422, "settings", "NaN"),
    "no object": (b"[]", 422, "settings", "must be a JSON object"),
    "lone surrogate": (b'{"unit": "\\ud800"}', 422, "settings", "unit"),
    "too deep": (b"[" * 60_000, 422, "settings", "too deeply"),
    "too large": (b" " * 65_537, 413, "limit", "65537 bytes: at most 65536"),
}


@pytest.mark.parametrize(
    ("settings", "status", "kind", "what"), BAD_SETTINGS.values(), ids=BAD_SETTINGS.keys()
)
def test_bad_settings_are_refused(
    client: httpx.Client, settings: bytes, status: int, kind: str, what: str
) -> None:
    files = {"mesh": ("patch.obj", obj()), "settings": ("settings.json", settings)}
    assert what in is_problem(post(client, files), status, kind)


BAD_PARTS = {
    "no mesh": ([("settings", (None, "{}"))], "part mesh is missing"),
    "no filename": ([("mesh", (None, obj()))], "part mesh has no filename"),
    "unknown": ([("mesh", ("a.obj", obj())), ("meshes", ("a", b""))], "unknown part 'meshes'"),
    "twice": ([("mesh", ("a.obj", obj()))] * 2, "part mesh was sent twice"),
    "stiffness": (
        [("mesh", ("a.obj", obj())), ("stiffness", ("a.png", b"GIF"))],
        "a.png: not a PNG or OpenEXR image",
    ),
    "stiffness without name": (
        [("mesh", ("a.obj", obj())), ("stiffness", (None, b"GIF"))],
        "part stiffness: not a PNG or OpenEXR image",
    ),
    "stiffness elsewhere": (
        [("mesh", ("a.obj", obj())), ("stiffness", ("a.1002.png", b""))],
        "a.1002.png is of UDIM 1002, which has no mesh; the mesh has 1001",
    ),
    "stiffness twice": (
        [("mesh", ("a.obj", obj())), *[("stiffness", ("a.1001.png", b""))] * 2],
        "a.1001.png and a.1001.png are both of UDIM 1001",
    ),
}


@pytest.mark.parametrize(("files", "what"), BAD_PARTS.values(), ids=BAD_PARTS.keys())
def test_bad_parts_are_refused(client: httpx.Client, files: Any, what: str) -> None:
    assert what in is_problem(post(client, files), 422, "input")


def test_a_bad_graph_is_refused(client: httpx.Client) -> None:
    is_problem(post(client, {**upload(), "graph": ("g", b"\x00" * 9)}), 422, "graph")


BAD_CHANGES = {
    "fixed": (b'{"resolution": 512}', 422, "settings"),
    "unknown": (b'{"colour": 1}', 422, "settings"),
    "not JSON": (b"depth=1", 422, "settings"),
    "no object": (b"3", 422, "input"),
    "too large": (b" " * 65_537, 413, "limit"),
}


@pytest.mark.parametrize(("body", "status", "kind"), BAD_CHANGES.values(), ids=BAD_CHANGES.keys())
def test_bad_changes_are_refused(
    client: httpx.Client, asset: str, body: bytes, status: int, kind: str
) -> None:
    path, before = f"/v1/assets/{asset}", client.get(f"/v1/assets/{asset}").json()
    response = client.patch(path, content=body, headers={"Content-Type": "application/json"})
    assert is_problem(response, status, kind)
    assert client.get(path).json() == before


def test_a_body_of_the_wrong_type_is_415(client: httpx.Client, asset: str) -> None:
    assert "multipart" in is_problem(client.post("/v1/assets", json={}), 415)
    sent = client.patch(f"/v1/assets/{asset}", content=json.dumps({}))
    assert "application/json" in is_problem(sent, 415)
