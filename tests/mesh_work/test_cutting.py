"""A piece of a mesh around a place."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.mesh import Mesh
from rhytid.meshes.nearest import cut_around

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
