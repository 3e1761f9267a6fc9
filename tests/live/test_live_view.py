"""What a live connection looks at: a list that changes, a camera."""

from __future__ import annotations

import httpx
import numpy as np
import pytest

from api.asking import built
from api.patch import obj, positions, smile, upload
from live.gated import TILE
from live.speaker import Speaker, speaking


def test_a_changed_view_is_answered_with_what_is_new_in_it(speaker: Speaker) -> None:
    speaker.open(tiles=[TILE])
    speaker.tell("view", tiles=[TILE, [1001, 0, 0, 0]])  # no frame yet: no answer
    speaker.positions(1, smile())
    assert speaker.answer()[1]["sent"] == 2
    speaker.tell("view", tiles=[[1001, 0, 3, 3], TILE])
    tiles, end = speaker.answer()
    assert [tile.address for tile in tiles] == [(1001, 0, 3, 3)]
    assert (end["frame"], end["unchanged"]) == (1, 1)


def test_a_camera_chooses_the_tiles(speaker: Speaker) -> None:
    # Orthographic: the left half of the patch fills the picture.
    matrix = [[4, 0, 0, -1], [0, 2, 0, -1], [0, 0, 0.1, 0], [0, 0, 0, 1]]
    speaker.open(camera={"matrix": matrix, "level": 0})
    speaker.positions(1, positions())
    tiles, _ = speaker.answer()
    assert {tile.address[3] for tile in tiles} == {0, 1, 2}  # columns: u up to 0.5, with a margin
    # From behind nothing is seen, unless both sides are.
    matrix[0] = [-4.0, 0, 0, 1]
    speaker.tell("view", camera={"matrix": matrix})
    assert speaker.answer()[1]["sent"] == 0
    speaker.tell("view", camera={"matrix": matrix, "two_sided": True})
    assert speaker.answer()[1]["sent"] > 0


def test_a_camera_looks_where_the_mesh_was_sent(server: httpx.Client) -> None:
    """The mesh is far from the origin, and moved there by the server."""
    far = np.array([3000.0, 0.0, 0.0])
    moved = positions().astype(float) * 1.001 + far
    lines = obj().decode().splitlines()
    rest = [line for line in lines if not line.startswith("v ")]
    vertices = [f"v {x:.15g} {y:.15g} {z:.15g}" for x, y, z in moved]
    asset = built(server, upload("\n".join([*vertices, *rest]).encode()))
    assert any(server.get(f"/v1/assets/{asset}").json()["centre"])
    matrix = np.array([[4, 0, 0, -1], [0, 2, 0, -1], [0, 0, 0.1, 0], [0, 0, 0, 1.0]])
    matrix[:, 3] -= matrix[:, :3] @ far
    with speaking(server, asset) as speaker:
        speaker.open(camera={"matrix": matrix.tolist()})
        speaker.positions(1, moved)
        tiles, _ = speaker.answer()
    assert {tile.address[3] for tile in tiles} == {0, 1, 2}


def test_a_camera_that_sees_too_many_tiles_ends_the_connection(
    speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.api.live.drawing.MOST_TILES", 3)
    speaker.open(camera={"matrix": np.diag([1.0, 1.0, 0.1, 1.0]).tolist(), "two_sided": True})
    speaker.positions(1, positions())
    assert speaker.closed() == (4413, "16 tiles in view: at most 3")
