from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.errors import FrameError, MeshError
from rhytid_lab.samples.sphere import RADIUS, SPHERE_STRETCHES, sphere, sphere_stretch


def test_sphere_is_a_round_hemisphere() -> None:
    mesh = sphere(32)
    np.testing.assert_allclose(np.linalg.norm(mesh.positions, axis=1), RADIUS, rtol=1e-6)
    assert mesh.positions[:, 2].min() > -1e-5
    assert mesh.usable_triangles().all()


def test_uv_is_lamberts_projection_unflipped_and_inside_the_margin() -> None:
    mesh = sphere(64)
    corners = mesh.triangle_uv()
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    areas = np.linalg.det(edges)
    assert areas.min() > 0.05 * np.median(areas)
    assert mesh.uv.min() >= 0.02
    assert mesh.uv.max() <= 0.98
    # Equal area: the disc inside a circle of latitude grows with the height of the cap.
    disc = np.sum((mesh.uv - 0.5) ** 2, axis=1) / 0.48**2
    np.testing.assert_allclose(disc, 1 - mesh.positions[:, 2] / RADIUS, atol=1e-6)


@given(a=st.floats(0.5, 2), b=st.floats(0.5, 2))
def test_stretch_at_the_centre_is_what_was_asked_for(a: float, b: float) -> None:
    mesh = sphere(32)
    centre = int(np.argmax(mesh.positions[:, 2]))
    touching = (mesh.faces == centre).any(axis=1)
    for triangle in mesh.faces[touching]:
        before, after = (
            (p[triangle[1:]] - p[triangle[0]]).astype(np.float64)
            for p in (mesh.positions, sphere_stretch(mesh, a, b))
        )
        np.testing.assert_allclose(after[:, :2], before[:, :2] * (a, b), rtol=1e-5, atol=1e-6)


def test_named_stretches_are_two_isotropic_and_two_anisotropic() -> None:
    kinds = [a == b for a, b in SPHERE_STRETCHES.values()]
    assert kinds == [True, True, False, False]


@pytest.mark.parametrize("ratios", [(0.0, 1.0), (1.0, -1.0), (float("nan"), 1.0)])
def test_ratios_must_be_positive(ratios: tuple[float, float]) -> None:
    with pytest.raises(FrameError, match="above 0"):
        sphere_stretch(sphere(4), *ratios)


def test_sphere_resolution_out_of_range() -> None:
    with pytest.raises(MeshError, match="resolution 1:"):
        sphere(1)
