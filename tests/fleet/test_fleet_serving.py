"""Two replicas behind one server: what they draw, what they share, and what is lost with one.

One file, so that one process has all of it, and one Ray.
"""

from __future__ import annotations

import io
import os
import signal
import threading
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import ray
from ray import serve

from api.asking import NPY, array_of, built, npy
from api.live import serving
from api.patch import obj, smile, upload
from engine.engines import new_asset, running
from fleet.replicas import replica_of, replicas, sent_to
from live.speaker import speaking
from processes.served import await_value
from rhytid.errors import DeviceLostError
from rhytid.fleet.app import NAME, REPLICAS, deployment
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.ray_engine import RayEngine
from rhytid.fleet.remote_registry import NAMESPACE, RemoteFrameRegistry
from rhytid.fleet.router import replica_order
from rhytid.storage.shared.shared_store import SharedStore
from rhytid.support.settings import ServiceSettings

pytestmark = pytest.mark.slow
TILE = "tiles/1001/0/0/0"
LOOKS = {"shape": {"taper": 0.2}, "response": {"log_stretch_limit": 0.4}, "depth": 0.5}


@pytest.fixture(scope="session")
def assets(client: httpx.Client) -> list[str]:
    """Assets that lie on both replicas, each with a frame."""
    found = [built(client, upload(obj(1.0 + n))) for n in range(6)]
    for asset in found:
        path = f"/v1/assets/{asset}/frames/smile"
        client.put(path, content=npy(smile()), headers=NPY).raise_for_status()
    return found


def tile(client: httpx.Client, asset: str, **query: str) -> httpx.Response:
    return client.get(f"/v1/assets/{asset}/frames/smile/{TILE}", params={"format": "npy", **query})


@pytest.fixture(scope="session")
def single(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    with running(tmp_path_factory.mktemp("single")) as engine, serving(engine) as alone:
        yield alone


@pytest.mark.parametrize("method", ["redraw", "binned"])
def test_tiles_are_those_of_the_single_server(
    client: httpx.Client, single: httpx.Client, assets: list[str], method: str
) -> None:
    assert built(single, upload(obj(1.0))) == assets[0]
    path = f"/v1/assets/{assets[0]}/frames/smile"
    single.put(path, content=npy(smile()), headers=NPY).raise_for_status()
    ours, theirs = (tile(one, assets[0], method=method) for one in (client, single))
    assert np.array_equal(array_of(ours), array_of(theirs))
    assert ours.headers["etag"] == theirs.headers["etag"]


def test_assets_are_spread_over_the_replicas(fleet: Any, assets: list[str]) -> None:
    names = replicas(fleet)
    assert len(names) == 2
    assert {replica_order(asset, names)[0] for asset in assets} <= set(names)
    for asset in assets:
        job = fleet.assets.calibrate(asset, smile())
        assert replica_of(job.id) == replica_order(asset, names)[0]


def test_the_other_replica_draws_the_same(fleet: Any, client: httpx.Client) -> None:
    """A replica that has neither the asset nor its frame fetches both, and what changes later."""
    asset = built(client, upload(obj(1.07)))
    frame = f"/v1/assets/{asset}/frames/smile"
    client.put(frame, content=npy(smile()), headers=NPY).raise_for_status()
    other = replica_order(asset, replicas(fleet))[1]

    def drawn() -> tuple[bytes, bytes]:
        first = tile(client, asset)
        with sent_to(fleet, other):
            second = tile(client, asset)
        assert first.headers["etag"] == second.headers["etag"]
        return first.content, second.content

    before, copy = drawn()
    assert before == copy
    client.put(frame, content=npy(smile(0.2)), headers=NPY).raise_for_status()
    moved, copy = drawn()
    assert moved == copy != before
    client.patch(f"/v1/assets/{asset}", json=LOOKS).raise_for_status()
    changed, copy = drawn()
    assert changed == copy != moved
    client.delete(frame).raise_for_status()
    with sent_to(fleet, other):
        assert tile(client, asset).status_code == 404
    client.delete(f"/v1/assets/{asset}").raise_for_status()
    with sent_to(fleet, other):
        assert client.get(f"/v1/assets/{asset}").status_code == 404


def test_a_live_connection_goes_to_a_replica(client: httpx.Client, assets: list[str]) -> None:
    with speaking(client, assets[0]) as speaker:
        speaker.open(tiles=[[1001, 0, 0, 0]], method="redraw", format="f32")
        speaker.positions(1, smile())
        (drawn,), _ = speaker.answer()
    assert np.array_equal(drawn.values, array_of(tile(client, assets[0], method="redraw")))


def test_a_package_and_a_snapshot_come_by_the_folder(
    client: httpx.Client, single: httpx.Client, assets: list[str]
) -> None:
    path = f"/v1/assets/{assets[1]}"
    made = client.get(f"{path}/package")
    if made.status_code == 202:
        job = made.headers["location"]
        await_value(lambda: client.get(job).json()["state"] == "done")
    package = client.get(f"{path}/package").raise_for_status()
    assert zipfile.ZipFile(io.BytesIO(package.content)).testzip() is None
    about = {"Content-Type": "application/x-tar"}
    snapshot = client.get(f"{path}/snapshot").raise_for_status().content
    assert single.post("/v1/snapshots", content=snapshot, headers=about).status_code == 201
    assert single.get(f"{path}/snapshot").content == snapshot
    assert client.post("/v1/snapshots", content=snapshot, headers=about).status_code == 200
    client.delete(path).raise_for_status()
    assert client.post("/v1/snapshots", content=snapshot, headers=about).status_code == 201
    assert client.get(f"{path}/snapshot").content == snapshot


def test_no_request_is_lost_with_a_replica(fleet: Any, client: httpx.Client) -> None:
    assets = [built(client, upload(obj(31.0 + n))) for n in range(4)]
    frames = [f"/v1/assets/{asset}/frames/smile" for asset in assets]
    for frame in frames:
        client.put(frame, content=npy(smile()), headers=NPY).raise_for_status()
    wanted = {frame: client.get(f"{frame}/{TILE}").raise_for_status().content for frame in frames}
    names = replicas(fleet)
    victim = replica_order(assets[0], names)[0]
    stopping, answers = threading.Event(), []

    def ask(frame: str) -> None:
        while not stopping.is_set():
            answer = client.get(f"{frame}/{TILE}")
            answers.append((answer.status_code, answer.content == wanted[frame]))

    with ThreadPoolExecutor(len(frames)) as pool:
        asking = [pool.submit(ask, frame) for frame in frames]
        try:
            await_value(lambda: len(answers) > 20)
            os.kill(names[victim], signal.SIGKILL)
            await_value(lambda: set(replicas(fleet)) - set(names))
            after = len(answers)
            await_value(lambda: len(answers) > after + 20)
        finally:
            stopping.set()
    for one in asking:
        one.result()
    assert set(answers) == {(200, True)}
    assert client.get("/readyz").status_code == 200
    await_value(lambda: len(replicas(fleet)) == 2)


def test_a_build_goes_on_elsewhere(fleet: Any, client: httpx.Client) -> None:
    names = await_value(lambda: len(found := replicas(fleet)) == 2 and found)
    many = upload(obj(47.0), resolution=1024, graph={"wrinkles": 60_000})
    made = client.post("/v1/assets", files=many).raise_for_status().json()
    builder = replica_of(made["job"])
    os.kill(names[builder], signal.SIGKILL)
    listed = client.get("/v1/assets").json()
    assert made["id"] in {one["id"] for one in listed}
    path = f"/v1/jobs/{made['job']}"
    job = await_value(lambda: (now := client.get(path).json())["state"] == "done" and now)
    assert job["id"] == made["job"]
    found = client.get(f"/v1/assets/{made['id']}").json()
    assert (found["state"], found["wrinkles"] > 1000) == ("ready", True)


def test_frames_survive_the_board_and_then_a_replica(fleet: Any, client: httpx.Client) -> None:
    names = await_value(lambda: len(found := replicas(fleet)) == 2 and found)
    assets = [built(client, upload(obj(61.0 + n))) for n in range(4)]
    frames = [f"/v1/assets/{asset}/frames/f{number}" for asset in assets for number in range(4)]
    for number, frame in enumerate(frames):
        positions = npy(smile(0.01 * (number + 1)))
        client.put(frame, content=positions, headers=NPY).raise_for_status()
    wanted = {frame: client.get(f"{frame}/{TILE}").raise_for_status().content for frame in frames}
    kill_board(NAME)
    board = RemoteFrameRegistry(NAME)
    for asset in assets:
        await_value(lambda asset=asset: set(versions_of(board, asset)) == {"f0", "f1", "f2", "f3"})
    os.kill(names[replica_order(assets[0], names)[0]], signal.SIGKILL)
    answers = {frame: client.get(f"{frame}/{TILE}") for frame in frames}
    assert {answer.status_code for answer in answers.values()} == {200}
    assert {frame: answer.content for frame, answer in answers.items()} == wanted
    await_value(lambda: len(replicas(fleet)) == 2)


def test_frames_survive_another_number_of_replicas(fleet: Any, tmp_path: Path) -> None:
    """`serve deploy` of other options starts every deployment of the application again."""
    settings, board = replace(ServiceSettings(), store=tmp_path), RemoteFrameRegistry("again")

    def deployed(count: int) -> FleetOptions:
        local = tmp_path / "local"
        options = FleetOptions(store=tmp_path, least=count, most=count, local=local, cpus=0.0)
        made = deployment(settings, options)
        serve.run(made, name="again", route_prefix=None, logging_config={"log_level": "WARNING"})
        return options

    try:
        options = deployed(1)
        handle = serve.get_deployment_handle(REPLICAS, "again")
        with closing(RayEngine(settings, options, handle, board)) as engine:
            (before,) = await_value(lambda: replicas(engine))
            asset, neutral = engine.assets.create(new_asset()).id, new_asset().mesh.positions
            await_value(lambda: engine.assets.info(asset).state == "ready")
            for number in range(4):
                engine.frames.put(asset, f"f{number}", neutral * (1 + number))
            deployed(2)
            await_value(lambda: len(now := replicas(engine)) == 2 and before not in now)
            for number in range(4):
                found = engine.frames.positions(asset, f"f{number}")
                assert np.array_equal(found, neutral * (1 + number))
    finally:
        serve.delete("again")
        board.end()


def test_a_fleet_works_on_a_bucket(
    fleet: Any, bucket: str, single: httpx.Client, tmp_path: Path
) -> None:
    """What `rhytid serve --ray --shared-store s3://...` is, in the Ray that runs already: two
    replicas, one of which is lost with all that it had on its machine."""
    settings = replace(ServiceSettings(), store=tmp_path / "store", shared_store=bucket)
    local = tmp_path / "local"
    options = FleetOptions(store=settings.store, least=2, most=2, local=local, cpus=0.0)
    registry, logs = RemoteFrameRegistry("bucket"), {"log_level": "WARNING"}
    try:
        serve.run(
            deployment(settings, options), name="bucket", route_prefix=None, logging_config=logs
        )
        handle = serve.get_deployment_handle(REPLICAS, "bucket")
        with (
            closing(RayEngine(settings, options, handle, registry)) as engine,
            serving(engine) as client,
        ):
            names = await_value(lambda: len(found := replicas(engine)) == 2 and found)
            asset = built(client, upload(obj(91.0)))
            frame = f"/v1/assets/{asset}/frames/smile"
            client.put(frame, content=npy(smile()), headers=NPY).raise_for_status()
            client.patch(f"/v1/assets/{asset}", json=LOOKS).raise_for_status()
            before = tile(client, asset)
            assert [one["id"] for one in client.get("/v1/assets").json()] == [asset]
            first, second = replica_order(asset, names)
            with sent_to(engine, second):
                assert tile(client, asset).content == before.content
            os.kill(names[first], signal.SIGKILL)
            assert tile(client, asset).content == before.content
            assert client.get(f"/v1/assets/{asset}").json()["settings"]["depth"] == 0.5
            about = {"Content-Type": "application/x-tar"}
            path = f"/v1/assets/{asset}/snapshot"
            snapshot = client.get(path).raise_for_status().content
            single.post("/v1/snapshots", content=snapshot, headers=about).raise_for_status()
            assert single.get(path).content == snapshot
            made = client.get(f"/v1/assets/{asset}/package")
            if made.status_code == 202:
                job = made.headers["location"]
                await_value(lambda: client.get(job).json()["state"] == "done")
            package = client.get(f"/v1/assets/{asset}/package").raise_for_status()
            assert zipfile.ZipFile(io.BytesIO(package.content)).testzip() is None
            assert SharedStore.at(bucket).holds(asset)
            client.delete(f"/v1/assets/{asset}").raise_for_status()
            assert client.get("/v1/assets").json() == []
            assert SharedStore.at(bucket).ids() == []
            assert client.post("/v1/snapshots", content=snapshot, headers=about).status_code == 201
            assert client.get(path).content == snapshot
        assert not settings.store.exists(), "no folder of this machine is needed"
    finally:
        serve.delete("bucket")
        registry.end()


def test_a_board_that_nobody_asks_ends_and_another_is_started(fleet: Any) -> None:
    board = RemoteFrameRegistry("left", left=3.0)
    life = board.news("", 0).life

    def has_ended() -> bool:
        with suppress(ValueError):
            return ray.get_actor("left", namespace=NAMESPACE) is None
        return True

    await_value(has_ended)
    try:
        assert board.news("", 0).life != life
    finally:
        board.end()
    await_value(has_ended)


def kill_board(application: str) -> None:
    actor: Any = ray.get_actor(application, namespace=NAMESPACE)
    os.kill(ray.get(actor.__ray_call__.remote(lambda board: os.getpid())), signal.SIGKILL)


def versions_of(board: RemoteFrameRegistry, asset: str) -> dict[str, int]:
    with suppress(DeviceLostError):  # it starts
        return board.versions(asset)
    return {}
