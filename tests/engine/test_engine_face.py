"""Every row of the table of methods on the real face, over HTTP, collapsed and exploded too."""

from __future__ import annotations

from email import message_from_bytes
from email.policy import HTTP
from itertools import product

import numpy as np
import pytest

import face_data
from api.asking import NPY, npy
from api.live import serving
from engine.engines import built, running
from pipeline.scenes import random_graph, settings_of
from rhytid.domain.mesh import Mesh
from rhytid.domain.methods import METHODS, SAMPLINGS, STRETCH_MODELS
from rhytid.engine.messages import NewAsset

pytestmark = [pytest.mark.face, pytest.mark.slow]
SETTINGS = {
    "resolution": 256,
    "tile_size": 256,
    "response": {"log_stretch_limit": 4.0},
    "shape": {"pore_bulge": 4.0},
}
CAPTURED = 100
RAW = {"Content-Type": "application/octet-stream"}
WHOLE, TILE = "1001/0/0/0", (256, 256)
MERGES = [
    {"merge": merge, "depth_factored": factored}
    for merge, factored in product(("min", "mellow"), (False, True))
]


@pytest.fixture(scope="module")
def frames(face):
    """All composites, frames all along the captured performance, and what no face should do."""
    rng = np.random.default_rng(3)
    captured = np.linspace(0, len(face_data.performance()[1]) - 1, CAPTURED).astype(int)
    return {
        **{name: face.composite(name) for name in face.composites},
        **{f"captured_{index}": face.captured(index) for index in captured},
        "collapsed": np.zeros_like(face.positions),
        "flat": face.positions * np.float32([1, 1, 0]),
        "exploded": rng.uniform(-1e30, 1e30, face.positions.shape).astype(np.float32),
        "torn": np.where(rng.random((len(face.positions), 1)) < 0.5, 1e38, face.positions),
    }


@pytest.fixture(scope="module")
def service(face, frames, tmp_path_factory):
    """A client of a server with the real face and the frames, and the path of its asset."""
    mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
    graph = random_graph(5, 1500, (0.004, 0.02), (0.01, 0.05))
    with running(tmp_path_factory.mktemp("face")) as engine, serving(engine) as client:
        asset = f"/v1/assets/{built(engine, NewAsset(mesh, settings_of(**SETTINGS), graph))}"
        for name, positions in frames.items():
            body = positions.astype("<f4").tobytes()
            client.put(f"{asset}/frames/{name}", content=body, headers=RAW).raise_for_status()
        yield client, asset


def drawn(service, frame, **query):
    """The whole map of a frame."""
    client, asset = service
    params = {"format": "f16", **query}
    response = client.get(f"{asset}/frames/{frame}/tiles/{WHOLE}", params=params)
    assert response.status_code == 200, response.text
    return np.frombuffer(response.content, "<f2").reshape(TILE)


def once(service, positions, **query):
    """The whole map of positions, sent and answered in one round trip."""
    client, asset = service
    response = client.post(
        f"{asset}/tiles",
        params={"tile": WHOLE, "format": "f16", **query},
        content=npy(positions.astype(np.float32)),
        headers=NPY,
    )
    assert response.status_code == 200, response.text
    head = f"Content-Type: {response.headers['content-type']}\r\n\r\n".encode()
    (part,) = message_from_bytes(head + response.content, policy=HTTP).iter_parts()
    return np.frombuffer(part.get_payload(decode=True), "<f2").reshape(TILE)


ROWS = list(product(METHODS, STRETCH_MODELS, SAMPLINGS))


@pytest.mark.parametrize(("method", "model", "sampling"), ROWS)
def test_every_row_answers_with_finite_values(service, frames, method, model, sampling):
    query, seen = {"method": method, "stretch": model, "sampling": sampling}, set()
    for name in frames:
        found = drawn(service, name, **query)
        assert np.isfinite(found).all(), name
        assert found.min() < 0, name
        seen.add(found.tobytes())
    assert len(seen) == (1 if method == "neutral" else len(frames))
    for name in ("smile", "exploded"):
        sent = once(service, frames[name], **query)
        assert sent.tobytes() == drawn(service, name, **query).tobytes()


@pytest.mark.parametrize("bins", MERGES, ids=lambda bins: "-".join(map(str, bins.values())))
def test_every_merge_answers_with_finite_values(service, bins):
    client, asset = service
    client.patch(asset, json={"bins": bins}).raise_for_status()
    assert client.get(f"{asset}/bins").json()["merge"] == bins["merge"]
    for name, model in product(("smile", "collapsed", "exploded", "torn"), STRETCH_MODELS):
        found = drawn(service, name, method="binned", stretch=model)
        assert np.isfinite(found).all(), name
        assert found.min() < 0, name
