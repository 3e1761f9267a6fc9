"""Frames over HTTP: positions in and out, stretch, calibration; and what is refused."""

from __future__ import annotations

import io

import httpx
import numpy as np
import pytest

from api.asking import NPY, array_of, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import positions, smile, upload

RAW = {"Content-Type": "application/octet-stream"}


def test_a_frame_answers_with_its_stretch(client: httpx.Client, frame: str) -> None:
    response = client.put(frame, content=npy(smile(0.2)), headers=NPY)
    assert response.status_code == 200
    found = response.json()
    assert found["name"] == "smile"
    assert found["log_stretch"].keys() == {"p1", "p10", "p50", "p90", "p99", "abs_p90"}
    assert client.get(frame).json() == found


def test_positions_come_back_as_they_were_sent(client: httpx.Client, frame: str) -> None:
    back = array_of(client.get(frame, headers={"Accept": "application/x-npy"}))
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back, smile())
    raw = client.get(frame, headers={"Accept": "application/octet-stream"})
    assert raw.headers["vary"] == "Accept"
    np.testing.assert_array_equal(np.frombuffer(raw.content, "<f4").reshape(-1, 3), smile())


def test_raw_positions_are_read_too(client: httpx.Client, frame: str) -> None:
    sent = client.put(frame, content=smile(0.3).astype("<f4").tobytes(), headers=RAW)
    assert sent.status_code == 200
    back = array_of(client.get(frame, headers={"Accept": "application/x-npy"}))
    np.testing.assert_array_equal(back, smile(0.3))


@pytest.mark.parametrize("headers", [{}, {"Content-Type": "text/csv"}])
@pytest.mark.parametrize(
    ("method", "call"),
    [("PUT", "frames/bad"), ("PUT", "calibration"), ("POST", "tiles?tile=1001/0/0/0")],
)
def test_positions_of_another_type_are_415(
    client: httpx.Client, asset: str, method: str, call: str, headers: dict[str, str]
) -> None:
    path = f"/v1/assets/{asset}/{call}"
    told = is_problem(client.request(method, path, content=npy(smile()), headers=headers), 415)
    sent = repr(headers["Content-Type"]) if headers else "missing"
    assert told == f"Content-Type is {sent}: one of {NPY_TYPE}, {RAW_TYPE}"
    is_problem(client.get(f"/v1/assets/{asset}/frames/bad"), 404, "not-found")


def test_accept_that_is_not_offered_is_406(client: httpx.Client, frame: str) -> None:
    assert "text/html" in is_problem(client.get(frame, headers={"Accept": "text/html"}), 406)


JSON_TYPE, NPY_TYPE, RAW_TYPE = (
    f"application/{name}" for name in ("json", "x-npy", "octet-stream")
)
ACCEPTS = {
    "": JSON_TYPE,
    "*/*": JSON_TYPE,
    "text/*, application/*": JSON_TYPE,
    f"{NPY_TYPE}, {JSON_TYPE}": NPY_TYPE,
    f"{JSON_TYPE};q=0.1, {NPY_TYPE};q=0.9": NPY_TYPE,
    f"{JSON_TYPE}; q=0.5, {NPY_TYPE}; Q=0.500, {RAW_TYPE};q=0.501": RAW_TYPE,
    f"{JSON_TYPE};q=0.000, */*": NPY_TYPE,
    f"*/*;q=0.1, {RAW_TYPE};q=0.2": RAW_TYPE,
    f"*/*, {JSON_TYPE};q=0, {NPY_TYPE};q=0.": RAW_TYPE,
    f"application/*;q=0, {NPY_TYPE};q=0.001": NPY_TYPE,
    f"{JSON_TYPE};q=2, {RAW_TYPE};q=0.3": RAW_TYPE,
    f"text/html, {NPY_TYPE};version=1;q=0.4": NPY_TYPE,
}


@pytest.mark.parametrize(("accept", "wanted"), ACCEPTS.items(), ids=ACCEPTS.keys())
def test_the_type_of_the_highest_weight_is_sent(
    client: httpx.Client, frame: str, accept: str, wanted: str
) -> None:
    answer = client.get(frame, headers={"Accept": accept})
    assert answer.status_code == 200
    assert answer.headers["content-type"] == wanted
    assert answer.headers["vary"] == "Accept"


@pytest.mark.parametrize(
    "accept", [f"{JSON_TYPE};q=0.000", "*/*;q=0.0", f"{JSON_TYPE};q=0.00, {NPY_TYPE};q=0"]
)
def test_a_weight_of_zero_is_a_refusal(client: httpx.Client, frame: str, accept: str) -> None:
    assert accept in is_problem(client.get(frame, headers={"Accept": accept}), 406)


def test_several_accept_headers_are_one(client: httpx.Client, frame: str) -> None:
    headers = [("Accept", f"{JSON_TYPE};q=0.1"), ("Accept", NPY_TYPE)]
    assert client.get(frame, headers=headers).headers["content-type"] == NPY_TYPE


def test_frames_are_listed_and_forgotten(client: httpx.Client, asset: str, frame: str) -> None:
    path = f"/v1/assets/{asset}/frames"
    assert {"neutral", "smile"} <= {f["name"] for f in client.get(path).json()}
    assert client.delete(frame).status_code == 204
    assert "smile" not in {f["name"] for f in client.get(path).json()}
    assert "smile" in is_problem(client.delete(frame), 404, "not-found")


def test_neutral_is_there_and_read_only(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/frames/neutral"
    back = array_of(client.get(path, headers={"Accept": "application/x-npy"}))
    np.testing.assert_array_equal(back, positions())
    is_problem(client.put(path, content=npy(smile()), headers=NPY), 409, "read-only")
    is_problem(client.delete(path), 409, "read-only")


def test_stretch_is_an_npz(client: httpx.Client, asset: str, frame: str) -> None:
    triangles = client.get(f"/v1/assets/{asset}").json()["triangles"]
    response = client.get(f"{frame}/stretch")
    with np.load(io.BytesIO(response.content)) as found:
        assert found["axes"].shape == (triangles, 2, 2)
        assert found["ratios"].shape == (triangles, 2)
        assert found["folds"].shape == (triangles,)


def test_calibration_is_a_job(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/calibration"
    response = client.put(path, content=npy(smile()), headers=NPY)
    job = response.json()
    assert response.status_code == 202
    assert response.headers["location"] == f"/v1/jobs/{job['id']}"
    assert job["asset"] == asset


def holed() -> np.ndarray:
    bad = smile()
    bad[7, 1] = np.nan
    return bad


BAD_BODIES = {
    "wrong vertex count": (npy(smile()[:-1]), NPY, "24"),
    "wrong shape": (npy(smile().ravel()), NPY, "75"),
    "NaN": (npy(holed()), NPY, "vertex 7"),
    "truncated": (npy(smile())[:-5], NPY, ""),
    "not npy": (b"hello", NPY, ""),
    "raw of a wrong length": (smile().tobytes()[:-1], RAW, "299"),
    "empty": (b"", RAW, ""),
}


@pytest.mark.parametrize(("body", "headers", "what"), BAD_BODIES.values(), ids=BAD_BODIES.keys())
@pytest.mark.parametrize(
    ("method", "call", "named"),
    [
        ("PUT", "frames/bad", "frame 'bad'"),
        ("PUT", "calibration", "calibration frame"),
        ("POST", "tiles?tile=1001/0/0/0", "frame"),
    ],
)
def test_bad_positions_are_refused(
    client: httpx.Client,
    asset: str,
    method: str,
    call: str,
    named: str,
    body: bytes,
    headers: dict[str, str],
    what: str,
) -> None:
    path = f"/v1/assets/{asset}/{call}"
    sent = client.request(method, path, content=body, headers=headers)
    told = is_problem(sent, 422, "frame")
    assert what in told
    assert told.startswith(named)
    is_problem(client.get(f"/v1/assets/{asset}/frames/bad"), 404, "not-found")


@pytest.mark.parametrize("name", [".hidden", "-", "a" * 65, "sm%C3%AFle", "a%20b"])
def test_bad_frame_names_are_refused(client: httpx.Client, asset: str, name: str) -> None:
    path = f"/v1/assets/{asset}/frames/{name}"
    is_problem(client.put(path, content=npy(smile()), headers=NPY), 422, "frame")
    is_problem(client.get(path), 404, "not-found")


@pytest.mark.parametrize("call", ["frames", "frames/a", "frames/neutral/stretch", "bins", "graph"])
def test_an_unknown_asset_is_404(client: httpx.Client, call: str) -> None:
    assert "nobody" in is_problem(client.get(f"/v1/assets/nobody/{call}"), 404, "not-found")


def test_the_frames_of_a_building_asset_are_not_ready() -> None:
    with serving(FakeEngine(polls=1000)) as client:
        path = f"/v1/assets/{client.post('/v1/assets', files=upload()).json()['id']}/frames"
        for answer in (
            client.get(path),
            client.get(f"{path}/neutral"),
            client.get(f"{path}/neutral/stretch"),
            client.put(f"{path}/smile", content=npy(smile()), headers=NPY),
        ):
            is_problem(answer, 409, "not-ready")
            assert answer.headers["retry-after"] == "1"


def test_the_widest_frame_is_read(client: httpx.Client, frame: str) -> None:
    body = npy(smile().astype(np.float64))
    assert len(body) > 24 * len(smile())
    assert client.put(frame, content=body, headers=NPY).status_code == 200
