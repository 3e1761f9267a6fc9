"""Every function of OpenCL that is used fails: no wrong answer, and the server goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from api.asking import NPY, npy
from api.patch import obj, smile, upload
from processes.served import Served, await_value, serving

pytestmark = pytest.mark.attack
METHODS = ("redraw", "binned", "convolved")
# Out of resources; of a build its own, of memory its own.
ERRORS = {"clBuildProgram": -11, "clCreateBuffer": -4, "clCreateSubBuffer": -4}
USUAL = -5
# Without these nothing of ours computes: a server that never called one was not tried.
NEEDED = {
    "clCreateBuffer",
    "clBuildProgram",
    "clCreateKernel",
    "clSetKernelArg",
    "clEnqueueNDRangeKernel",
}


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of functions that were called."""
    return tmp_path_factory.mktemp("calls") / "calls"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, faults: Path, calls: Path) -> Iterator[Served]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RHYTID_TEST_CALLS", str(calls))
        with serving(tmp_path_factory.mktemp("store"), faults) as running:
            running.make()
            yield running


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, faults: Path) -> Iterator[Served]:
    """A server whose driver does not fail."""
    with serving(tmp_path_factory.mktemp("sound"), faults) as running:
        running.make()
        yield running


def test_no_failing_call_leads_to_a_wrong_answer(
    served: Served, sound: Served, calls: Path
) -> None:
    assert all(same(served, sound, method) for method in METHODS)
    used = sorted(set(calls.read_text().split()))
    assert set(used) >= NEEDED
    answered, amount = 0, 0.1
    for function in used:
        for once in ("once", ""):
            amount += 0.01
            for server in (served, sound):
                put(server, amount)
            served.fail(f"call {function} {ERRORS.get(function, USUAL)} {once}")
            answered += sum(same(served, sound, method) for method in METHODS)
            built_or_refused(served, amount)
            served.heal()
            await_value(served.ready)
            for _ in range(2):  # nor was anything wrong kept
                assert all(same(served, sound, method) for method in METHODS), function
    assert served.client.get("/healthz").status_code == 200
    print(f"{used}: {6 * len(used)} tiles, {answered} answered")  # noqa: T201


def put(server: Served, amount: float) -> None:
    """Replace the frame."""
    response = server.client.put(server.frame, content=npy(smile(amount)), headers=NPY)
    response.raise_for_status()


def same(served: Served, sound: Served, method: str) -> bool:
    """Whether a tile is answered, as it must be; fails where it is answered otherwise."""
    found = served.tile(method=method)
    if found.status_code == 200:
        assert found.content == sound.tile(method=method).content
        return True
    assert found.status_code in (500, 503, 507), found.text
    assert found.headers["content-type"] == "application/problem+json"
    return False


def built_or_refused(served: Served, scale: float) -> None:
    """A new asset, which is built, or fails with a reason."""
    sent = served.client.post("/v1/assets", files=upload(obj(scale)))
    assert sent.status_code in (200, 202, 500, 503, 507), sent.text
    if sent.status_code < 300:
        path = f"/v1/assets/{sent.json()['id']}"

        def ended() -> httpx.Response | None:
            response = served.client.get(path)
            if response.status_code == 200 and response.json()["state"] == "building":
                return None
            return response

        found = await_value(ended)
        assert found.status_code in (200, 404, 503), found.text
        if found.status_code == 200 and found.json()["state"] == "failed":
            assert found.json()["reason"]
