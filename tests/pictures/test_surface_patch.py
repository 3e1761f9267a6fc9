from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.reference.orthographic import ray_uv, tangent_axes

from rhytid.pictures.raster import vertex_normals
from rhytid.pictures.relief import flat_light, lit, spline_samples, spline_slopes
from rhytid.pictures.surface_patch import Frame, surface_patch
from rhytid_lab.samples.sphere import RADIUS, sphere

SIZE, MAP, WAVE, DEPTH = 96, 512, 0.05, 0.004
Array = NDArray[np.float64]
ToUV = Callable[[Array, Array], tuple[Array, Array]]


def plane(to_uv: ToUV, normal: Array) -> tuple[Array, Array]:
    """Corners (F, 3, 3) and uv of a tilted plane, x and y within ±½ cut in eight."""
    along = np.linspace(-0.5, 0.5, 9)
    y, x = np.meshgrid(along, along, indexing="ij")
    i = np.arange(72).reshape(8, 9)[:, :8].ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 10], 1), np.stack([i, i + 10, i + 9], 1)])
    flat = np.stack([x.ravel(), y.ravel()], axis=1)
    uv = np.stack(to_uv(flat[:, 0], flat[:, 1]), axis=1)
    return (flat @ tangent_axes(normal)[:2])[faces], uv[faces]


def straight(x: Array, y: Array) -> tuple[Array, Array]:
    return 0.5 + 0.9 * x, 0.5 + 0.9 * y


def sheared(x: Array, y: Array) -> tuple[Array, Array]:
    return 0.5 + 0.55 * x + 0.3 * y, 0.5 + 0.8 * y


def bent(x: Array, y: Array) -> tuple[Array, Array]:
    """Sheared one way above the middle and the other way below."""
    return 0.5 + 0.55 * x + 0.3 * np.abs(y), 0.5 + 0.8 * y


def furrows(u_of: ToUV) -> Array:
    """A map of furrows along y of the plane: solves u, v for x at every texel."""
    along = (np.arange(MAP) + 0.5) / MAP
    u, v = np.meshgrid(along, 1 - along)
    origin = np.zeros_like(u)
    slope_v = u_of(origin, origin + 1)[1] - 0.5
    y = (v - 0.5) / slope_v
    slope_u = u_of(origin + 1, origin)[0] - 0.5
    x = (u - u_of(origin, y)[0]) / slope_u
    return DEPTH * np.cos(2 * np.pi * x / WAVE)


def angle_of(slopes: Array) -> float:
    """The main direction of gradients (…, 2), degrees from the horizontal."""
    g = slopes.reshape(-1, 2)
    return float(np.degrees(0.5 * np.arctan2(2 * g[:, 0] @ g[:, 1], (g**2 @ (1, -1)).sum())))


NORMAL = np.array([0.3, -0.2, 0.9])


@pytest.mark.parametrize("to_uv", [straight, sheared, bent])
def test_furrows_upright_on_the_surface_are_upright_in_the_patch(to_uv: ToUV) -> None:
    corners, uv = plane(to_uv, NORMAL)
    patch = surface_patch(corners, uv, Frame.at(np.zeros(3), NORMAL), 0.5, SIZE)
    assert patch.seen.covered.all()
    slopes = patch.gradient(furrows(to_uv))
    for half in (slopes[: SIZE // 2 - 2], slopes[SIZE // 2 + 2 :]):
        assert abs(angle_of(half)) < 2.0
    x = ((np.arange(SIZE) + 0.5) / SIZE - 0.5) * 0.5
    true = -DEPTH * 2 * np.pi / WAVE * np.sin(2 * np.pi * x / WAVE)
    clear = np.abs(np.arange(SIZE) - SIZE / 2 + 0.5) > 2
    assert np.abs(slopes[clear, :, 0] - true).max() < 0.05 * np.abs(true).max()


@pytest.mark.parametrize("to_uv", [sheared, bent])
@pytest.mark.parametrize("elevation", [45.0, 15.0])
def test_the_picture_does_not_depend_on_the_uv(to_uv: ToUV, elevation: float) -> None:
    frame = Frame.at(np.zeros(3), NORMAL)
    pictures = [
        surface_patch(*plane(m, NORMAL), frame, 0.5, SIZE).picture(furrows(m), elevation)
        for m in (straight, to_uv)
    ]
    apart = np.abs(pictures[0].astype(int) - pictures[1].astype(int))
    assert np.ptp(pictures[0]) > 60
    assert apart.mean() < 1.5
    assert np.percentile(apart, 99) < 10


@pytest.mark.slow
def test_pixels_lie_where_rays_hit_the_mesh() -> None:
    mesh = sphere(12)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    uv = mesh.triangle_uv()
    triangle = int(np.argmin(np.linalg.norm(corners.mean(axis=1) - (2.0, 1.5, 4.2), axis=1)))
    frame = Frame.of(corners[triangle])
    side, size = 0.8 * RADIUS, 17
    patch = surface_patch(corners, uv, frame, side, size)
    a, b, c = corners[triangle]
    axes = tangent_axes(np.cross(b - a, c - a))
    np.testing.assert_allclose(frame.axes, axes, atol=1e-12)
    true = ray_uv(corners, uv, corners[triangle].mean(axis=0), axes, side, size)
    np.testing.assert_array_equal(patch.seen.covered, ~np.isnan(true[..., 0]))
    np.testing.assert_allclose(patch.uv[patch.seen.covered], true[patch.seen.covered], atol=1e-9)


def test_what_is_nearest_and_near_the_place_is_seen() -> None:
    corners, uv = plane(straight, NORMAL)
    n = NORMAL / np.linalg.norm(NORMAL)
    shifts = (0.0, 0.2, 3.0)
    stack = np.concatenate([corners + s * n for s in shifts])
    all_uv = np.concatenate([uv * 0 + i for i in range(3)])
    frame = Frame.at(np.zeros(3), NORMAL)
    np.testing.assert_allclose(surface_patch(stack, all_uv, frame, 0.5, 16).uv, 1.0)


def test_slope_is_measured_on_the_surface_not_across_the_picture() -> None:
    """A plane tilted by 60° from the viewer: its furrows look closer, and are as steep as ever."""
    corners, uv = plane(straight, np.array([0.0, 0.0, 1.0]))
    turned = Frame.at(np.zeros(3), np.array([np.sin(np.pi / 3), 0.0, 0.5]))
    patch = surface_patch(corners, uv, turned, 0.23, SIZE)
    steepest = np.abs(patch.gradient(furrows(straight))[..., 0]).max()
    assert steepest == pytest.approx(DEPTH * 2 * np.pi / WAVE, rel=0.02)


def test_a_frame_turns_with_its_triangle_and_leaves_its_stretch() -> None:
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 1, 0.1]])
    frame = Frame.of(triangle)
    angle = 0.4
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    along = frame.axes[0]
    stretch = np.eye(3) + 0.5 * np.outer(along, along)
    carried = frame.carried(triangle, triangle @ (turn @ stretch).T)
    np.testing.assert_allclose(carried.axes, frame.axes @ turn.T, atol=1e-12)


def test_spline_slopes_are_those_of_the_samples() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(12, 12))
    row, column = rng.uniform(-1, 12, (2, 200))
    down, across = spline_slopes(values, row, column)
    step = 1e-6
    for slope, dr, dc in ((down, step, 0.0), (across, 0.0, step)):
        ahead, behind = (spline_samples(values, row + s * dr, column + s * dc) for s in (1, -1))
        np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-7)


def test_a_flat_sheet_is_as_bright_at_grazing_light() -> None:
    flat = np.broadcast_to((0.0, 0.0, 1.0), (2, 2, 3))
    steep, grazing = (lit(flat, *flat_light(e)) for e in (45.0, 15.0))
    np.testing.assert_allclose(steep, grazing, atol=0.12)
    x, y, z = flat_light(15.0)[0]
    assert x < 0 < y
    assert np.degrees(np.arcsin(z)) == pytest.approx(15.0)


@pytest.mark.parametrize("elevation", [45.0, 15.0])
def test_the_form_of_the_mesh_is_shaded_and_does_not_burn_out(elevation: float) -> None:
    mesh = sphere(48)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    triangle = int(np.argmax(corners.mean(axis=1)[:, 2]))
    normals = vertex_normals(mesh.positions, mesh.faces)[mesh.faces]
    frame = Frame.of(corners[triangle])
    patch = surface_patch(corners, mesh.triangle_uv(), frame, RADIUS, SIZE, normals)
    bare = np.zeros((MAP, MAP))
    formed = patch.picture(bare, elevation, form=True).astype(int)
    assert formed[8, 8].sum() > formed[-8, -8].sum() + 100
    # Weaker light from the upper right, too: without it these two would be alike.
    assert formed[8, -8].sum() > formed[-8, 8].sum() + 30
    assert (formed == 255).all(axis=-1).mean() < 0.01
    assert np.ptp(patch.picture(bare, elevation)) < 40
