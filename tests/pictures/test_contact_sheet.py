from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError, MeshError
from rhytid.pictures.flat_patches import FlatPatch, most_stretched_patches
from rhytid.pictures.relief import surface_crop
from rhytid.pictures.sheet import GAP, MARGIN
from rhytid_lab.contact_sheets import SIZE, Performance, contact_sheet, patch_views, relative_rms
from rhytid_lab.samples.sphere import RADIUS, sphere, sphere_stretch

pytestmark = pytest.mark.release

RATIOS = (1.25, 0.8)


def performance(mesh: Mesh, ratios: tuple[float, float] = RATIOS) -> Performance:
    """The sphere stretched along x and y; near its centre the axes are u and v."""
    count = len(mesh.faces)
    axes = np.broadcast_to(np.eye(2, dtype=np.float32), (count, 2, 2))
    values = np.broadcast_to(np.array(ratios, np.float32), (count, 2))
    deformed = sphere_stretch(mesh, *ratios)
    return Performance(mesh.positions, deformed, mesh.faces, mesh.triangle_uv(), axes, values)


def centre_patch(ratios: tuple[float, float]) -> FlatPatch:
    """A patch at the middle of the map, uv and mesh units alike, x along u."""
    return FlatPatch(np.zeros(3), 0, np.array([0.5, 0.5]), np.eye(2), np.diag(np.log(ratios)))


def test_patches_carry_the_principal_stretch() -> None:
    mesh = sphere(48)
    frame = performance(mesh)
    corners = mesh.positions[mesh.faces]
    stretched, compressed = most_stretched_patches(
        corners, frame.triangle_uv, frame.axes, frame.ratios, 0.5
    )
    for patch in (stretched, compressed):
        assert patch.centre[2] > 2
        np.testing.assert_allclose(np.sort(patch.principal[0]), (0.8, 1.25), rtol=0.03)
        per_unit = np.linalg.norm(patch.to_uv, axis=0)
        np.testing.assert_allclose(per_unit, 0.48 / (RADIUS * np.sqrt(2)), rtol=0.25)


def test_patches_find_the_patch_that_changes_most() -> None:
    mesh = sphere(48)
    frame = performance(mesh)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    centre = corners.mean(axis=1)
    ratios = np.ones((len(corners), 2))
    ratios[np.linalg.norm(centre - (1.5, 1.0, 4.66), axis=1) < 1, 0] = 1.3
    ratios[np.linalg.norm(centre - (-1.5, -1.0, 4.66), axis=1) < 1, 1] = 0.7
    stretched, compressed = most_stretched_patches(
        corners, frame.triangle_uv, frame.axes, ratios, 0.5
    )
    assert np.linalg.norm(stretched.centre - (1.5, 1.0, 4.66)) < 0.8
    assert np.linalg.norm(compressed.centre - (-1.5, -1.0, 4.66)) < 0.8
    assert stretched.principal[0][0] > 1.25
    assert compressed.principal[0][0] < 0.75


def test_no_patch_is_larger_than_the_chart() -> None:
    mesh = sphere(8)
    frame = performance(mesh)
    with pytest.raises(MeshError, match="no patch of radius 9"):
        most_stretched_patches(
            mesh.positions[mesh.faces], frame.triangle_uv, frame.axes, frame.ratios, radius=9.0
        )


@pytest.mark.parametrize("deformed", [False, True])
def test_crops_are_at_true_scale(deformed: bool) -> None:
    size = 64
    along = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(along, 1 - along)
    x = surface_crop(u - 0.5, centre_patch(RATIOS), 0.5, 20, deformed)
    y = surface_crop(v - 0.5, centre_patch(RATIOS), 0.5, 20, deformed)
    shrink = RATIOS if deformed else (1.0, 1.0)
    assert x[0, -1] == pytest.approx(0.5 * 0.475 / shrink[0])
    assert y[0, -1] == pytest.approx(0.5 * 0.475 / shrink[1])
    assert y[0, 0] > 0 > y[-1, 0]


def maps(size: int) -> dict[str, NDArray[np.float32]]:
    rng = np.random.default_rng(4)
    redraw = rng.normal(0, 0.01, (size, size)).astype(np.float32)
    return {"neutral": redraw * np.float32(0.5), "redraw": redraw, "binned": redraw * 1.1}


@pytest.mark.slow
def test_contact_sheet_has_five_rows_of_five() -> None:
    page = contact_sheet(performance(sphere(32)), maps(256), note="drawn by a test")
    assert page.width == 2 * MARGIN + 5 * SIZE + 4 * GAP
    assert page.height > 5 * SIZE
    assert len(np.unique(np.asarray(page).reshape(-1, 3), axis=0)) > 1000


def test_patches_of_a_sheet_lie_on_their_surface() -> None:
    """Deformed skin shows less of the map where it is stretched, more where it is compressed."""
    frame = performance(sphere(64))
    corners = frame.neutral[frame.faces].astype(np.float64)
    triangle = int(np.argmax(corners.mean(axis=1)[:, 2]))
    uv = frame.triangle_uv[triangle].mean(axis=0)
    patch = FlatPatch(corners[triangle].mean(axis=0), triangle, uv, np.eye(2), np.zeros((2, 2)))
    views = patch_views(frame, patch, 0.5)
    assert all(view.seen.covered.all() for view in views.values())
    middle = SIZE // 2
    for view in views.values():
        np.testing.assert_allclose(view.uv[middle, middle], uv, atol=2e-3)
    across, down = (
        {m: np.linalg.norm(np.ptp(np.take(v.uv, middle, axis), axis=0)) for m, v in views.items()}
        for axis in (0, 1)
    )
    assert across["neutral"] / across["redraw"] == pytest.approx(RATIOS[0], rel=0.02)
    assert down["neutral"] / down["redraw"] == pytest.approx(RATIOS[1], rel=0.02)
    assert across["face"] == pytest.approx(2 * across["redraw"], rel=0.05)


def test_relative_rms() -> None:
    reference = maps(32)["redraw"]
    assert relative_rms(reference * 1.1, reference) == pytest.approx(0.1, rel=1e-4)
    assert relative_rms(np.zeros(4), np.zeros(4)) == 0.0
    assert relative_rms(np.ones(4), np.zeros(4)) == np.inf


def test_maps_must_belong_together() -> None:
    frame = performance(sphere(8))
    with pytest.raises(InputError, match="no 'binned'"):
        contact_sheet(frame, {k: v for k, v in maps(64).items() if k != "binned"})
    with pytest.raises(InputError, match="'redraw' has shape"):
        contact_sheet(frame, {**maps(64), "redraw": np.zeros((32, 32))})
