"""Where the patch of each region lies."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.mesh import Mesh
from rhytid.pictures.preview import region_views
from rhytid_lab.samples.sphere import RADIUS, sphere

SIDE, PIXELS = 0.2 * RADIUS, 48


def head() -> tuple[Mesh, np.ndarray, np.ndarray]:
    """A ball, its corners, and the middles of its triangles in radii."""
    mesh = sphere(32)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    return mesh, corners, corners.mean(axis=1) / RADIUS


def test_patches_lie_in_their_regions_in_the_usual_order() -> None:
    mesh, corners, middle = head()
    masks = {
        "neck": (middle[:, 1] < -0.3).astype(float),
        "cheek": (middle[:, 0] > 0.5).astype(float),
        "nose": np.zeros(len(middle)),
    }
    nothing = np.zeros(len(middle))
    views = region_views(corners, mesh.triangle_uv(), masks, nothing, SIDE, PIXELS)
    assert [view.region for view in views] == ["cheek", "neck"]
    for view in views:
        assert masks[view.region][view.triangle] == 1.0
        assert view.surface.uv.shape == (PIXELS, PIXELS, 2)
        assert view.surface.seen.covered.mean() > 0.95


def test_regions_of_folds_are_seen_where_they_fold() -> None:
    mesh, corners, middle = head()
    front = (middle[:, 2] > 0.3).astype(float)
    folds = np.exp(-20 * ((middle - [0.0, 0.5, 0.8]) ** 2).sum(axis=1))
    views = region_views(
        corners, mesh.triangle_uv(), {"forehead": front, "cheek": front}, folds, SIDE, PIXELS
    )
    away = {v.region: np.linalg.norm(middle[v.triangle] - [0.0, 0.5, 0.8]) for v in views}
    assert away["forehead"] < 0.35


def test_the_scale_is_that_of_the_uv() -> None:
    along = np.linspace(0.0, 1.0, 9)
    y, x = np.meshgrid(along, along, indexing="ij")
    i = np.arange(72).reshape(8, 9)[:, :8].ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 10], 1), np.stack([i, i + 10, i + 9], 1)])
    flat = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    uv = flat[:, :2] * [0.25, 0.09]
    masks = {"cheek": np.ones(len(faces))}
    (view,) = region_views(flat[faces], uv[faces], masks, np.zeros(len(faces)), 0.5, PIXELS)
    assert view.scale == pytest.approx((0.25 * 0.09) ** 0.5)
