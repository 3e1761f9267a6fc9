"""A server on several devices: PoCL makes two of one processor."""

from __future__ import annotations

import os
import re
import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import httpx
import pytest

from api.asking import NPY, built, is_problem, npy
from api.patch import obj, smile, upload
from processes.served import TILE, Served, await_value, children, serving

pytestmark = [pytest.mark.slow, pytest.mark.release]
ASSETS = 4


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of PoCL both kinds of devices that it makes of a processor."""
    monkeypatch.setenv("POCL_DEVICES", "pthread basic")


@pytest.fixture
def served(tmp_path: Path, faults: Path, devices: None) -> Iterator[Served]:
    with serving(tmp_path, faults, "--devices", "all") as running:
        yield running


def builds(served: Served) -> Counter[str]:
    """Assets that were built, by device."""
    text = served.client.get("/metrics").text
    name = r'rhytid_jobs_ended_total\{device="(\d+)",kind="build",state="done"\} (\S+)'
    return Counter({device: int(float(n)) for device, n in re.findall(name, text)})


def tiles(served: Served, assets: list[str]) -> list[bytes]:
    frames = [f"/v1/assets/{asset}/frames/smile/{TILE}" for asset in assets]
    return [served.client.get(path).raise_for_status().content for path in frames]


def test_assets_are_spread_come_back_and_stay(tmp_path: Path, served: Served, faults: Path) -> None:
    assets = [built(served.client, upload(obj(1.0 + n))) for n in range(ASSETS)]
    for asset in assets:
        path = f"/v1/assets/{asset}/frames/smile"
        served.client.put(path, content=npy(smile()), headers=NPY).raise_for_status()
    assert sum(builds(served).values()) == ASSETS
    assert len(+builds(served)) >= 2
    assert built(served.client, upload(obj(1.0))) == assets[0]
    assert sum(builds(served).values()) == ASSETS
    before = tiles(served, assets)

    processes = children(served.process.pid)
    used = [one for one in served.client.get("/v1/devices").json() if one["selected"]]
    assert len(processes) == len(used) >= 2
    for process in processes:
        os.kill(process, signal.SIGKILL)
    await_value(lambda: served.restarts() == {"killed": len(processes)} and served.ready())
    assert tiles(served, assets) == before
    listed = await_value(lambda: served.client.get("/v1/assets").json())
    assert sorted(one["id"] for one in listed) == sorted(assets)
    assert sum(builds(served).values()) == ASSETS, "counters go on after a restart"

    snapshot = served.client.get(f"/v1/assets/{assets[0]}/snapshot").content
    served.client.delete(f"/v1/assets/{assets[0]}").raise_for_status()
    is_problem(served.client.get(f"/v1/assets/{assets[0]}"), 404, "not-found")
    about = {"Content-Type": "application/x-tar"}
    made = served.client.post("/v1/snapshots", content=snapshot, headers=about)
    assert (made.status_code, made.json()["id"]) == (201, assets[0])

    served.process.send_signal(signal.SIGTERM)
    served.process.wait(60)
    with serving(tmp_path, faults) as alone:  # the store is any server's
        found = {one["id"]: one["state"] for one in alone.client.get("/v1/assets").json()}
    assert found == dict.fromkeys(assets, "ready")


def test_a_device_that_hangs_does_not_keep_the_others(served: Served) -> None:
    assets = [built(served.client, upload(obj(1.0 + n))) for n in range(ASSETS)]
    victim = children(served.process.pid)[0]
    os.kill(victim, signal.SIGSTOP)
    try:
        answered = 0
        for asset in assets:
            path = f"/v1/assets/{asset}/frames/neutral/{TILE}"
            with suppress(httpx.ReadTimeout):  # its device is the one that hangs
                answered += served.client.get(path, timeout=10).status_code == 200
        assert answered > 0
        assert served.ready()
    finally:
        os.kill(victim, signal.SIGCONT)
