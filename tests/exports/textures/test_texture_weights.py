"""Weights of stretch and compression, on meshes whose stretch is known."""

from __future__ import annotations

import numpy as np
import pytest

from exports.textures.patches import FloatArray, grid_mesh
from rhytid.exports.textures.stretch import FULL, corner_weights


def flat(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.stack([u, v, 0 * u], axis=-1)


MESH = grid_mesh(flat, 2)


@pytest.mark.parametrize(
    ("ratios", "wanted"),
    [
        ((1.0, 1.0), (0.0, 0.0)),
        ((2.0, 1.0), (1.0, 0.0)),
        ((1.0, 0.5), (0.0, 1.0)),
        ((8.0, 0.1), (1.0, 1.0)),
        ((np.sqrt(2.0), 2**-0.25), (0.5, 0.25)),
        ((1.5, 1.2), (np.log(1.5) / np.log(2), 0.0)),
        ((0.0, 1.0), (0.0, 1.0)),
    ],
)
def test_even_stretch(ratios: tuple[float, float], wanted: tuple[float, float]) -> None:
    found = corner_weights(MESH, np.full((len(MESH.faces), 2), ratios, np.float32))

    np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), atol=1e-6)


def test_a_vertex_has_the_mean_of_its_triangles() -> None:
    """All triangles of this grid are as large as each other; one is twice as long."""
    ratios = np.ones((len(MESH.faces), 2), np.float32)
    ratios[0, 1] = 2.0

    found = corner_weights(MESH, ratios)

    many = np.bincount(MESH.faces.reshape(-1))
    for face, corner in np.ndindex(MESH.faces.shape):
        vertex = MESH.faces[face, corner]
        share = 1.0 / many[vertex] if vertex in MESH.faces[0] else 0.0
        assert found[face, corner] == pytest.approx((share, 0.0), abs=1e-6)
    assert np.log(2.0) == FULL
