"""A server whose driver crashes, hangs and fails: real processes, real signals."""

from __future__ import annotations

import io
import itertools
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from zipfile import ZipFile

import httpx
import numpy as np
import pytest

from api.asking import NPY, built, is_problem, npy
from api.patch import obj, smile, upload
from processes.served import LONG, TILE, Served, alive, await_value, children, serving
from rhytid_lab.samples.grids import flat_sheet

pytestmark = [pytest.mark.slow, pytest.mark.attack, pytest.mark.release]
# Kernels that tiles with `stretch=uv` launch, and builds, and nothing else.
UV, SYNTHESIS = "stretch_uv", "throw_darts"
# Of a graph that takes seconds to grow, and what is said of a build that is started again.
LARGE = {"wrinkles": 400_000}
AGAIN = "started again, since the device's process ended"


@pytest.fixture
def served(tmp_path: Path, faults: Path) -> Iterator[Served]:
    """A server with an asset and a frame."""
    with serving(tmp_path, faults) as running:
        running.make()
        yield running


@pytest.fixture
def watched(tmp_path: Path, faults: Path) -> Iterator[Served]:
    """The same, whose driver has ten seconds for each call."""
    with serving(tmp_path, faults, seconds=10) as running:
        running.make()
        yield running


def test_a_crash_of_the_driver_is_not_noticed_by_who_asks(served: Served) -> None:
    before = served.tile().content
    served.fail(f"segv {UV} once")
    assert served.tile(stretch="uv").status_code == 200
    assert served.tile().content == before
    assert served.restarts() == {"fault": 1}
    assert served.client.get(served.frame).json()["name"] == "smile"
    devices = served.client.get("/v1/devices").json()
    assert [device["restarts"] for device in devices if device["selected"]] == [1]


def test_what_crashes_twice_is_refused_and_nothing_else(served: Served) -> None:
    served.fail(f"segv {UV}")
    told = is_problem(served.tile(stretch="uv"), 422, "fatal-request")
    assert "SIGSEGV" in told
    assert served.restarts() == {"fault": 2}
    assert is_problem(served.tile(stretch="uv"), 422, "fatal-request") == told
    assert served.tile().status_code == 200
    assert served.restarts() == {"fault": 2}
    served.heal()
    served.client.put(served.frame, content=npy(smile(0.2)), headers=NPY).raise_for_status()
    assert served.tile(stretch="uv").status_code == 200


def test_a_build_that_crashes_twice_is_refused(served: Served) -> None:
    served.fail(f"segv {SYNTHESIS}")
    made = served.client.post("/v1/assets", files=upload(obj(2.0))).raise_for_status().json()
    path = f"/v1/assets/{made['id']}"
    state = await_value(lambda: failed(served.client, path))
    assert "SIGSEGV" in state["reason"]
    assert served.restarts() == {"fault": 2}
    job = served.client.get(f"/v1/jobs/{made['job']}").json()
    assert (job["state"], job["detail"]) == ("failed", state["reason"])
    is_problem(served.client.post("/v1/assets", files=upload(obj(2.0))), 422, "fatal-request")
    assert served.tile().status_code == 200
    assert served.restarts() == {"fault": 2}
    served.heal()
    is_problem(served.client.post("/v1/assets", files=upload(obj(2.0))), 422, "fatal-request")
    served.client.delete(path).raise_for_status()
    assert built(served.client, upload(obj(2.0))) == made["id"]
    os.kill(served.child, signal.SIGKILL)
    await_value(served.ready)
    assert served.client.get(path).json()["state"] == "ready"


def failed(client: httpx.Client, path: str) -> dict[str, str] | None:
    response = client.get(path)
    asset: dict[str, str] = response.json()
    return asset if response.status_code == 200 and asset["state"] == "failed" else None


def test_a_build_goes_on_under_its_job_where_the_process_was_killed(served: Served) -> None:
    served.fail(f"hang {SYNTHESIS} once")
    made = served.client.post("/v1/assets", files=upload(obj(3.0))).raise_for_status().json()
    await_value(lambda: not served.fault.exists())
    os.kill(served.child, signal.SIGKILL)
    with served.client.stream("GET", f"/v1/jobs/{made['job']}/events") as events:
        assert b'"state": "done"' in events.read()
    assert served.client.get(f"/v1/assets/{made['id']}").json()["state"] == "ready"
    assert served.restarts() == {"killed": 1}


def test_a_build_that_is_started_again_keeps_its_id_and_says_so(served: Served) -> None:
    """One id for its asset, for who sends it again and for who follows the job, after each of two
    kills; it is done once the asset is ready."""
    files = upload(obj(4.0), graph=LARGE)
    made = served.client.post("/v1/assets", files=files).raise_for_status().json()
    asset, job = f"/v1/assets/{made['id']}", f"/v1/jobs/{made['job']}"
    for kills in (1, 2):
        await_value(lambda: served.client.get(job).json()["state"] == "running")
        os.kill(served.child, signal.SIGKILL)
        again = served.client.post("/v1/assets", files=files).raise_for_status().json()
        found = served.client.get(asset).json()
        assert (again["job"], found["job"]) == (made["job"], made["job"]), kills
        now = served.client.get(job).json()
        assert (found["state"], now["id"]) == ("building", made["job"])
        assert now["detail"].startswith(AGAIN)
    with served.client.stream("GET", f"{job}/events") as events:
        told = events.read()
    assert b'"state": "done"' in told
    assert f'"detail": "{AGAIN}'.encode() in told
    found = served.client.get(asset).json()
    assert (found["state"], found["job"]) == ("ready", made["job"])
    os.kill(served.child, signal.SIGKILL)
    assert served.client.get(job).json()["state"] == "done"
    assert served.client.get(asset).json()["job"] is None
    assert served.restarts() == {"killed": 3}


def test_frames_that_are_added_to_a_build_do_not_take_its_place(served: Served) -> None:
    """The asset names the job that adds frames, until its process ends: the build goes on alone,
    and stands for that job, too."""
    files = upload(framed(5.0), "patch.npz", graph=LARGE)
    build = served.client.post("/v1/assets", files=files).raise_for_status().json()
    frames = served.client.post("/v1/assets", files=files).raise_for_status().json()
    assert frames["job"] != build["job"]
    asset = f"/v1/assets/{build['id']}"
    for _ in range(2):
        os.kill(served.child, signal.SIGKILL)
        found = served.client.get(asset).json()
        assert (found["state"], found["job"]) == ("building", build["job"])
        for one in (build, frames):
            now = served.client.get(f"/v1/jobs/{one['job']}").json()
            assert now["id"] == one["job"]
            assert now["detail"].startswith(AGAIN)
    for one in (frames, build):
        with served.client.stream("GET", f"/v1/jobs/{one['job']}/events") as events:
            assert b'"state": "done"' in events.read()
        assert served.client.get(asset).json()["state"] == "ready"
    assert served.client.get(f"{asset}/frames/0001/{TILE}").status_code == 200


def test_a_build_that_is_started_again_can_be_cancelled(served: Served) -> None:
    files = upload(obj(6.0), graph=LARGE)
    made = served.client.post("/v1/assets", files=files).raise_for_status().json()
    job = f"/v1/jobs/{made['job']}"
    os.kill(served.child, signal.SIGKILL)
    assert served.client.delete(job).status_code == 200
    assert await_value(lambda: served.client.get(job).json()["state"] == "cancelled")
    os.kill(served.child, signal.SIGKILL)
    is_problem(served.client.get(f"/v1/assets/{made['id']}"), 404, "not-found")
    # A new build of the same has an id of its own, also where that is started again.
    new = served.client.post("/v1/assets", files=files).raise_for_status().json()
    assert new["job"] != made["job"]
    os.kill(served.child, signal.SIGKILL)
    assert served.client.get(f"/v1/assets/{made['id']}").json()["job"] == new["job"]
    assert served.client.get(job).json()["state"] == "cancelled"


def framed(scale: float) -> bytes:
    """A mesh of its own with a frame, as npz."""
    mesh = flat_sheet(scale, 4)
    arrays = {"positions": mesh.positions, "faces": mesh.faces, "uv": mesh.uv}
    file = io.BytesIO()
    np.savez(file, **arrays, face_uv=mesh.face_uv, frames=1.1 * mesh.positions[None])
    return file.getvalue()


@pytest.mark.parametrize("word", ["hang", "wait"])
def test_a_call_that_never_ends_is_ended(watched: Served, word: str) -> None:
    before = watched.tile().content
    watched.fail(f"{word} {UV} once")
    answers: list[httpx.Response] = []
    asking = threading.Thread(target=lambda: answers.append(watched.tile(stretch="uv")))
    asking.start()
    await_value(lambda: not watched.fault.exists())
    await_value(lambda: not watched.ready())
    assert watched.client.get("/healthz").status_code == 200
    asking.join()
    assert answers[0].status_code == 200
    assert await_value(watched.ready)
    assert watched.restarts() == {"late": 1}
    assert watched.tile().content == before


def test_snapshots_go_out_and_in(served: Served) -> None:
    path = f"/v1/assets/{served.asset}"
    before = served.client.get(f"{path}/frames/neutral/{TILE}").content
    snapshot = served.client.get(f"{path}/snapshot").raise_for_status().content
    served.client.delete(path).raise_for_status()
    sent = {"content": snapshot, "headers": {"Content-Type": "application/x-tar"}}
    assert served.client.post("/v1/snapshots", **sent).status_code == 201
    assert served.client.post("/v1/snapshots", **sent).status_code == 200
    assert served.client.get(f"{path}/frames/neutral/{TILE}").content == before


def test_packages_are_made_and_read(served: Served) -> None:
    path = f"/v1/assets/{served.asset}/package"
    found = await_value(lambda: ready_package(served.client, path))
    with ZipFile(io.BytesIO(found)) as came:
        for name in ("manifest.json", "skin.glb"):
            assert served.client.get(f"{path}/{name}").content == came.read(name)
    os.kill(served.child, signal.SIGKILL)
    assert served.client.get(path).content == found


def ready_package(client: httpx.Client, path: str) -> bytes | None:
    answer = client.get(path).raise_for_status()
    return answer.content if answer.status_code == 200 else None


def test_ready_is_what_computes(served: Served) -> None:
    assert served.ready()
    served.fail("error *")
    assert not served.ready()
    assert served.client.get("/healthz").status_code == 200
    served.heal()
    assert served.ready()
    assert served.restarts() == {}


def test_a_server_ends_while_its_device_hangs(served: Served) -> None:
    served.fail(f"hang {UV}")
    asking = threading.Thread(target=ask_in_vain, args=(served,))
    asking.start()
    child = served.child
    time.sleep(1)
    served.process.send_signal(signal.SIGTERM)
    # Twenty for requests to finish, five for the process of the device to end.
    assert served.process.wait(40) == 0
    asking.join()
    assert not alive(child)


def ask_in_vain(served: Served) -> None:
    with suppress(httpx.TransportError):
        assert served.tile(stretch="uv").status_code >= 500


def test_kills_under_load_lose_nothing(served: Served) -> None:
    places = [f"tiles/1001/0/{row}/{column}" for row in range(4) for column in range(4)]
    before = {place: served.tile(place).content for place in places}
    wrong: list[str] = []
    answered: list[str] = []
    ended = threading.Event()

    def ask(offset: int) -> None:
        at = offset
        while not ended.is_set():
            place = places[at % len(places)]
            answer = served.tile(place)
            if answer.status_code != 200 or answer.content != before[place]:
                wrong.append(f"{place}: {answer.status_code} {answer.text[:200]}")
            answered.append(place)
            at += 1

    threads = [threading.Thread(target=ask, args=(4 * i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for round in range(4):
        os.kill(served.child, signal.SIGKILL)
        served.await_kills(round + 1)
        more = len(answered) + 4 * len(threads)
        while len(answered) < more and not wrong:
            time.sleep(0.05)
    ended.set()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert served.restarts() == {"killed": 4}


@pytest.mark.parametrize("change", ["put", "delete"])
def test_a_frame_that_changes_while_the_process_is_killed_stays_changed(
    served: Served, change: str
) -> None:
    """Whatever else is asked for until the next process has answered."""
    shapes = [smile(0.1 * size) for size in range(1, 4)]
    for before, after in itertools.pairwise(shapes):
        served.client.put(served.frame, content=npy(before), headers=NPY).raise_for_status()
        child = served.child
        os.kill(child, signal.SIGSTOP)
        with ThreadPoolExecutor(4) as pool:
            if change == "put":
                changed = pool.submit(served.client.put, served.frame, content=npy(after),
                                      headers=NPY)  # fmt: skip
            else:
                changed = pool.submit(served.client.delete, served.frame)
            time.sleep(0.5)  # it is sent, and waits for its answer
            asked = [pool.submit(served.tile) for _ in range(2)]
            os.kill(child, signal.SIGKILL)
            changed.result(LONG).raise_for_status()
            for tile in asked:
                assert tile.result(LONG).status_code in (200, 404)
        for _ in range(2):
            found = served.client.get(served.frame, headers={"Accept": "application/x-npy"})
            if change == "put":
                assert np.array_equal(np.load(io.BytesIO(found.content)), after)
            else:
                assert found.status_code == served.tile().status_code == 404
            os.kill(served.child, signal.SIGKILL)
            await_value(served.ready)


def test_descriptors_and_memory_of_killed_processes_are_given_back(served: Served) -> None:
    def held() -> tuple[int, int]:
        folder = Path(f"/proc/{served.process.pid}")
        shared = (folder / "maps").read_text().count("memfd:rhytid")
        return len(list((folder / "fd").iterdir())), shared

    served.tile()
    before = held()
    for round in range(3):
        os.kill(served.child, signal.SIGKILL)
        served.await_kills(round + 1)
        for at in ("tiles/1001/0/0/0", "tiles/1001/0/2/1", "tiles/1001/0/3/3"):
            served.tile(at).raise_for_status()
    after = held()
    assert after[0] <= before[0] + 2
    assert after[1] <= before[1] + 1


def test_the_process_ends_with_a_server_that_is_killed(served: Served, faults: Path) -> None:
    served.fail(f"hang {UV}")
    asking = threading.Thread(target=ask_in_vain, args=(served,))
    asking.start()
    child = served.child
    time.sleep(1)
    served.process.kill()
    served.process.wait()
    asking.join()
    await_value(lambda: not alive(child))
    served.heal()
    with serving(served.fault.parent, faults) as again:
        again.asset = served.asset
        assert again.client.get(f"/v1/assets/{again.asset}").json()["state"] == "ready"
        assert len(children(again.process.pid)) == 1


def test_without_a_process_of_its_own_the_device_is_in_the_server(
    tmp_path: Path, faults: Path
) -> None:
    with serving(tmp_path, faults, "--in-process") as running:
        asset = built(running.client, upload())
        running.asset = asset
        assert running.client.get(f"/v1/assets/{asset}/frames/neutral/{TILE}").status_code == 200
        assert children(running.process.pid) == []
