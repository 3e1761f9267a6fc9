"""Frames of a mesh file are counted from 0001, and 0000 of earlier versions is still answered."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator

import httpx
import numpy as np
import pytest

from api.asking import NPY, array_of, built, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import positions, smile, upload
from rhytid.api.former_frames import MOST, NOTICE, FormerNames

FACES = np.array([[0, 1, 6], [0, 6, 5]], np.int32)
POSITIONS = {"Accept": "application/x-npy"}
TILE = "tiles/1001/0/0/0"


def moving(scale: float, *amounts: float) -> bytes:
    """A .npz of the patch with frames; another scale is another asset."""
    file = io.BytesIO()
    uv = positions()[:, :2].astype(np.float64)
    frames = {"frames": np.stack([scale * smile(one) for one in amounts])} if amounts else {}
    np.savez(file, positions=scale * positions(), faces=FACES, uv=uv, face_uv=FACES, **frames)
    return file.getvalue()


@pytest.fixture
def asset(client: httpx.Client) -> Iterator[str]:
    """The path of an asset whose file has two frames."""
    path = f"/v1/assets/{built(client, upload(moving(3.0, 0.1, 0.2), 'patch.npz'))}"
    yield path
    if client.get(path).status_code == 200:
        client.delete(path)


def test_frames_are_counted_as_bake_counts_them(client: httpx.Client, asset: str) -> None:
    for name, amount in (("0001", 0.1), ("0002", 0.2)):
        response = client.get(f"{asset}/frames/{name}", headers=POSITIONS)
        np.testing.assert_array_equal(array_of(response), np.float32(3) * smile(amount))
        assert NOTICE not in response.headers
    is_problem(client.get(f"{asset}/frames/0003"), 404, "not-found")


@pytest.mark.parametrize("what", ["", "/stretch", f"/{TILE}", "/maps/1001"])
def test_the_first_of_earlier_versions_is_answered_with_a_notice(
    client: httpx.Client, asset: str, what: str
) -> None:
    former, now = (client.get(f"{asset}/frames/{name}{what}") for name in ("0000", "0001"))
    assert (former.status_code, now.status_code) == (200, 200)
    assert former.content == now.content
    assert "0000 of a mesh file is named 0001 now" in former.headers[NOTICE]
    assert NOTICE not in now.headers
    assert former.headers.get("etag") == now.headers.get("etag")


def test_a_tag_of_the_former_name_still_holds(client: httpx.Client, asset: str) -> None:
    tag = client.get(f"{asset}/frames/0001/{TILE}").headers["etag"]
    asked = {"If-None-Match": tag}
    response = client.get(f"{asset}/frames/0000/{TILE}", headers=asked)
    assert response.status_code == 304
    assert NOTICE in response.headers
    assert client.head(f"{asset}/frames/0000/{TILE}").headers[NOTICE]


def test_a_frame_of_that_name_is_that_frame(client: httpx.Client, asset: str) -> None:
    path = f"{asset}/frames/0000"
    client.put(path, content=npy(smile(0.3)), headers=NPY).raise_for_status()
    again = client.post("/v1/assets", files=upload(moving(3.0, 0.1, 0.2), "patch.npz"))
    assert again.is_success
    response = client.get(path, headers=POSITIONS)
    np.testing.assert_array_equal(array_of(response), smile(0.3))
    assert NOTICE not in response.headers
    client.delete(path).raise_for_status()
    is_problem(client.get(path), 404, "not-found")


@pytest.mark.parametrize("change", ["put", "delete"])
def test_where_the_first_frame_is_no_more_of_the_file_its_former_name_is_none(
    client: httpx.Client, asset: str, change: str
) -> None:
    if change == "put":
        client.put(f"{asset}/frames/0001", content=npy(smile(0.3)), headers=NPY).raise_for_status()
    else:
        client.delete(f"{asset}/frames/0001").raise_for_status()
    is_problem(client.get(f"{asset}/frames/0000"), 404, "not-found")


def test_a_former_name_is_for_reading(client: httpx.Client, asset: str) -> None:
    is_problem(client.delete(f"{asset}/frames/0000"), 404, "not-found")
    assert client.get(f"{asset}/frames/0001").status_code == 200


def test_frames_that_were_sent_by_name_have_no_former_one(client: httpx.Client) -> None:
    path = f"/v1/assets/{built(client, upload(moving(4.0), 'patch.npz'))}/frames"
    client.put(f"{path}/0001", content=npy(smile(0.3)), headers=NPY).raise_for_status()
    is_problem(client.get(f"{path}/0000"), 404, "not-found")


def test_a_removed_asset_is_gone_under_both(client: httpx.Client, asset: str) -> None:
    client.delete(asset).raise_for_status()
    for name in ("0000", "0001"):
        is_problem(client.get(f"{asset}/frames/{name}"), 404, "not-found")


def test_it_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    with serving(FakeEngine()) as client:
        asset = built(client, upload(moving(3.0, 0.1), "patch.npz"))
        with caplog.at_level(logging.WARNING, "rhytid.api.former_frames"):
            for _ in range(3):
                client.get(f"/v1/assets/{asset}/frames/0000").raise_for_status()
    assert len([r for r in caplog.records if "is named 0001 now" in r.getMessage()]) == 1


def test_what_is_remembered_is_bounded() -> None:
    names = FormerNames()
    for number in range(MOST + 1):
        names.sent(f"{number}")
    assert not names.known("0")
    assert names.known("1")
    for number in range(2 * MOST):
        names.stored(f"of {number}", "0000")
    assert len(names._assets) == MOST
