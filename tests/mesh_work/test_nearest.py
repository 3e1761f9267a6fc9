"""The nearest points of triangles, against all triangles looked at."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rhytid.meshes import nearest as module
from rhytid.meshes.nearest import closest


@pytest.mark.parametrize("seed", range(6))
def test_it_is_what_looking_at_all_triangles_gives(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Triangles of very different sizes, so that far middles belong to near triangles."""
    monkeypatch.setattr(module, "_ROWS", 70)
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-2, 1, (150, 1, 1))
    corners = rng.uniform(-1, 1, (150, 1, 3)) + sizes * rng.uniform(-1, 1, (150, 3, 3))
    points = rng.uniform(-3, 3, (200, 3))
    found = closest(corners, points)

    every = np.stack(
        [trimesh.triangles.closest_point(corners, np.tile(p, (150, 1))) for p in points]
    )
    gaps = np.linalg.norm(every - points[:, None], axis=2)
    assert found.distance == pytest.approx(gaps.min(axis=1), rel=1e-12)
    place = np.einsum("nk,nkc->nc", found.weights, corners[found.triangle])
    assert np.linalg.norm(place - points, axis=1) == pytest.approx(found.distance, rel=1e-6)
    assert (found.weights >= 0).all()


def test_of_equal_ones_the_first_is_taken() -> None:
    one = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    corners = np.stack([one + np.array([5.0, 0, 0]), one, one, one])

    assert closest(corners, np.array([[0.2, 0.2, 1.0]])).triangle.tolist() == [1]
