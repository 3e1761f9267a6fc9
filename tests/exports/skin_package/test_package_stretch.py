"""Stretch as a package computes it, against numpy's SVD in double."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes import SmallMesh, deform
from reference.stretch import stretch as reference
from rhytid.exports.skin_package.runtime import stretch


def rest_of(mesh: SmallMesh) -> NDArray[np.float64]:
    return stretch.rest_of(mesh.positions, mesh.faces, mesh.uv[mesh.face_uv])


@pytest.mark.parametrize(
    ("dtype", "close"), [(np.float64, 1e-7), (np.float32, 2e-6)], ids=["double", "single"]
)
def test_it_is_that_of_the_reference(
    small_mesh: SmallMesh, dtype: type[np.floating[Any]], close: float
) -> None:
    moved = deform(small_mesh.positions, 3)
    found = stretch.log_stretch(moved, small_mesh.faces, rest_of(small_mesh), dtype)
    ratios, axes = reference(*small_mesh, moved)

    assert np.abs(found[:, 4:6] - np.log(ratios)).max() < close
    along = np.abs((found[:, :4].reshape(-1, 2, 2) * axes).sum(-1))
    assert (1 - along).max() < close
    assert (found[:, 6:] == 0).all()


def test_triangles_without_area_are_unstretched_and_pressed_ones_are_finite(
    small_mesh: SmallMesh,
) -> None:
    flat = small_mesh.positions.copy()
    flat[small_mesh.faces[0, 1]] = flat[small_mesh.faces[0, 0]]
    bad = stretch.rest_of(flat, small_mesh.faces, small_mesh.uv[small_mesh.face_uv])
    moved = deform(small_mesh.positions, 3)

    assert (bad[0] == 0).all()
    found = stretch.log_stretch(moved, small_mesh.faces, bad)
    assert found[0].tolist() == [1, 0, 0, 1, 0, 0, 0, 0]
    found = stretch.log_stretch(flat, small_mesh.faces, rest_of(small_mesh))
    assert np.isfinite(found).all()
    assert found[0, 5] == stretch.LEAST_LOG


def test_the_texture_ends_with_an_unstretched_entry() -> None:
    rows = np.arange(24, dtype=np.float32).reshape(3, 8)
    found = stretch.texture(rows, 2)

    assert found.shape == (2, 4, 4)
    assert np.array_equal(found.reshape(4, 8)[:3], rows)
    assert found[1, 2:].ravel().tolist() == [1, 0, 0, 1, 0, 0, 0, 0]
