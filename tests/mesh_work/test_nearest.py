"""The nearest points of triangles, against all triangles looked at; and a piece of a mesh around a
place."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rhytid.domain.mesh import Mesh
from rhytid.meshes import nearest as module
from rhytid.meshes.nearest import closest, cut_around


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


SIDE = 21


def grid(height: float = 0.0, u: float = 0.0) -> tuple[np.ndarray, ...]:
    """A flat sheet of 2 × 400 triangles, 1 by 1, with UV of its own place."""
    at = np.linspace(0.0, 1.0, SIDE)
    x, y = np.meshgrid(at, at)
    positions = np.stack([x, y, np.full_like(x, height)], -1).reshape(-1, 3)
    i = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (part.ravel() for part in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return positions, faces, positions[:, :2] * 0.9 + (u + 0.05, 0.05)


def mesh(*sheets: tuple[np.ndarray, ...]) -> Mesh:
    """Sheets in one mesh; the indices of its UV are shuffled."""
    count = SIDE * SIDE
    positions = np.concatenate([sheet[0] for sheet in sheets])
    faces = np.concatenate([sheet[1] + n * count for n, sheet in enumerate(sheets)])
    uv = np.concatenate([sheet[2] for sheet in sheets])
    order = np.random.default_rng(1).permutation(len(uv))
    shuffled = np.empty_like(uv)
    shuffled[order] = uv
    return Mesh(positions, faces, shuffled, order[faces])


def test_triangles_near_the_place_keep_their_shape_and_uv() -> None:
    piece = cut_around(mesh(grid()), 1001, np.array([0.5, 0.5, 0.0]), 0.2)
    corners = piece.positions[piece.faces].astype(np.float64)
    distance = np.linalg.norm(corners.mean(axis=1) - (0.5, 0.5, 0.0), axis=1)
    assert distance.max() < 0.2
    assert len(piece.faces) == pytest.approx(np.pi * 0.2**2 * 800, rel=0.1)
    np.testing.assert_allclose(piece.triangle_uv(), corners[..., :2] * 0.9 + 0.05, atol=1e-6)
    assert set(np.unique(piece.faces)) == set(range(len(piece.positions)))
    assert set(np.unique(piece.face_uv)) == set(range(len(piece.uv)))


def test_skin_across_a_gap_is_left_out() -> None:
    lips = mesh(grid(), grid(0.05))
    for height in (0.0, 0.05):
        piece = cut_around(lips, 1001, np.array([0.5, 0.5, height + 0.001]), 0.2)
        assert set(np.round(piece.positions[:, 2], 6)) == {np.float32(height)}


def test_other_udims_are_left_out() -> None:
    both = mesh(grid(), grid(0.001, u=1.0))
    piece = cut_around(both, 1002, np.array([0.5, 0.5, 0.0]), 0.2)
    assert piece.uv[:, 0].min() > 1.0


def test_the_nearest_triangle_is_always_there() -> None:
    piece = cut_around(mesh(grid()), 1001, np.array([0.51, 0.52, 0.0]), 1e-6)
    assert 1 <= len(piece.faces) <= 2


def test_the_centre_is_kept() -> None:
    positions, faces, uv = grid()
    far = Mesh.centred(positions + 1e6, faces, uv, faces)
    piece = cut_around(far, 1001, np.array([0.5, 0.5, 0.0]) + 1e6 - far.centre, 0.2)
    assert (piece.centre == far.centre).all()
    assert len(piece.faces) > 50
