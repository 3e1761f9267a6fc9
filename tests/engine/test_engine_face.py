"""Every row of the table of methods on the real face, over HTTP, collapsed and exploded too."""

from __future__ import annotations

from email import message_from_bytes
from email.policy import HTTP
from itertools import product

import numpy as np
import pytest

from api.asking import NPY, npy
from api.live import serving
from engine.engines import built, running
from pipeline.scenes import random_graph, settings_of
from rhytid.domain.mesh import Mesh
from rhytid.engine.messages import METHODS, SAMPLINGS, STRETCH_MODELS, NewAsset

pytestmark = pytest.mark.face
SETTINGS = {
    "resolution": 256,
    "tile_size": 256,
    "response": {"log_stretch_limit": 4.0},
    "shape": {"pore_bulge": 4.0},
}
WHOLE, TILE = "1001/0/0/0", (256, 256)
MERGES = [
    {"merge": merge, "depth_factored": factored}
    for merge, factored in product(("min", "mellow"), (False, True))
]


@pytest.fixture(scope="module")
def service(face, tmp_path_factory):
    """A client of a server with the real face, and the path of its asset."""
    mesh = Mesh(face.positions, face.faces, face.uv, face.face_uv)
    graph = random_graph(5, 1500, (0.004, 0.02), (0.01, 0.05))
    with running(tmp_path_factory.mktemp("face")) as engine, serving(engine) as client:
        yield client, f"/v1/assets/{built(engine, NewAsset(mesh, settings_of(**SETTINGS), graph))}"


@pytest.fixture(scope="module")
def frames(face):
    """All composites, and what no face should do."""
    rng = np.random.default_rng(3)
    broken = {
        "collapsed": np.zeros_like(face.positions),
        "flat": face.positions * np.float32([1, 1, 0]),
        "exploded": rng.uniform(-1e30, 1e30, face.positions.shape).astype(np.float32),
        "torn": np.where(rng.random((len(face.positions), 1)) < 0.5, 1e38, face.positions),
    }
    return {**{name: face.composite(name) for name in face.composites}, **broken}


def drawn(service, positions, **query):
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


def test_convolved_has_no_smooth_sampling_yet(service, frames):
    client, asset = service
    response = client.post(
        f"{asset}/tiles",
        params={"tile": WHOLE, "method": "convolved", "sampling": "smooth"},
        content=npy(frames["smile"].astype(np.float32)),
        headers=NPY,
    )
    assert response.status_code == 422
    assert "'convolved' has sampling 'nearest' alone" in response.json()["detail"]


ROWS = [
    (method, model, sampling)
    for method in METHODS
    for model in STRETCH_MODELS
    for sampling in SAMPLINGS
    if (method, sampling) != ("convolved", "smooth")
]


@pytest.mark.parametrize(("method", "model", "sampling"), ROWS)
def test_every_row_answers_with_finite_values(service, frames, method, model, sampling):
    seen = set()
    for name, positions in frames.items():
        found = drawn(service, positions, method=method, stretch=model, sampling=sampling)
        assert np.isfinite(found).all(), name
        assert found.min() < 0, name
        seen.add(found.tobytes())
    assert len(seen) == (1 if method == "neutral" else len(frames))


@pytest.mark.parametrize("bins", MERGES, ids=lambda bins: "-".join(map(str, bins.values())))
def test_every_merge_answers_with_finite_values(service, frames, bins):
    client, asset = service
    client.patch(asset, json={"bins": bins}).raise_for_status()
    assert client.get(f"{asset}/bins").json()["merge"] == bins["merge"]
    for name, model in product(("smile", "collapsed", "exploded", "torn"), STRETCH_MODELS):
        found = drawn(service, frames[name], method="binned", stretch=model)
        assert np.isfinite(found).all(), name
        assert found.min() < 0, name
