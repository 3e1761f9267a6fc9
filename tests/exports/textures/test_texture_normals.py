"""Normal maps beside normals of a finely displaced mesh, in double."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from exports.textures.patches import (
    all_triangles,
    centres,
    curved,
    degrees_between,
    fine_normals,
    grid_mesh,
    tangents,
    true_normals,
    unit,
    waves,
)
from meshes import SmallMesh, deform
from reference import slopes as reference_slopes
from reference.normals import normals
from rhytid.domain.mesh import Mesh
from rhytid.engine.device_assets.slopes import neighbour_codes
from rhytid.errors import MeshError
from rhytid.exports.textures.frame_map import Chart
from rhytid.exports.textures.normals import NormalChart
from rhytid.exports.textures.tangents import Posed
from rhytid.pipeline.normals import normal_codes

if TYPE_CHECKING:
    from rhytid.device.runtime import Device

FloatArray = NDArray[np.float64]
Drawn = Callable[..., FloatArray]


@pytest.fixture(scope="module")
def drawn(device: Device) -> Drawn:
    def found(mesh: Mesh, heights: FloatArray, posed: FloatArray | None = None) -> FloatArray:
        """The map of some heights; posed: positions of a frame."""
        positions = mesh.positions if posed is None else posed.astype(np.float32)
        map = decoded(codes_of(device, mesh, positions, heights, slice(0, len(heights))))
        np.testing.assert_allclose(np.linalg.norm(map, axis=-1), 1.0, atol=3e-5)
        return map

    return found


def codes_of(
    device: Device,
    mesh: Mesh,
    positions: NDArray[np.float32],
    heights: FloatArray,
    rows: slice,
    green: int = 1,
) -> NDArray[np.uint16]:
    """Codes of the normals of some rows; texels next to triangles show the nearest, as the service
    pads."""
    triangles = all_triangles(mesh, len(heights))
    away, (row, column) = ndimage.distance_transform_edt(
        triangles == len(mesh.faces), return_indices=True
    )
    triangles = np.where(away < 3, triangles[row, column], triangles)
    codes = neighbour_codes(mesh, 1001, triangles)
    chart = NormalChart.of(mesh, 1001, triangles.astype(np.int32), codes)
    records = chart.records(Posed.of(mesh, positions))
    given = (heights.astype(np.float32), chart.triangles, codes, records)
    return normal_codes(device, *given, rows, green)


def decoded(codes: NDArray[np.uint16]) -> FloatArray:
    found: FloatArray = codes / 65535.0 * 2.0 - 1.0
    return found


def shaded(map: FloatArray, along: FloatArray, normal: FloatArray, sign: float = 1.0) -> FloatArray:
    """What a shader makes of a map: T is dP/du in the plane of N, B = sign N x T."""
    tangent = unit(along - np.sum(along * normal, -1, keepdims=True) * normal)
    x, y, z = (map[..., i, None] for i in range(3))
    return unit(x * tangent + y * sign * np.cross(normal, tangent) + z * normal)


@pytest.mark.parametrize("strength", [0.4, 0.01])
@pytest.mark.parametrize("green", [1, -1])
def test_codes_are_those_of_double(
    device: Device, small_mesh: SmallMesh, strength: float, green: int
) -> None:
    """Within two codes of 65535, on a sheet of two islands that is bent, texel by texel."""
    mesh, side = Mesh(*small_mesh), 128
    positions = deform(mesh.positions, 3, strength)
    heights = 0.008 * np.random.default_rng(5).standard_normal((side, side))
    triangles = all_triangles(mesh, side)
    own = reference_slopes.surface(positions, mesh.faces, mesh.uv, mesh.face_uv)
    slopes, inside = reference_slopes.slopes(
        heights.astype(np.float32).astype(np.float64), triangles, own
    )
    wanted = normals(slopes, inside, triangles, own) * [1, green, 1]
    assert 0.2 < inside.mean() < 1.0
    assert wanted[inside, 2].min() < 0.8

    parts = [slice(start, min(start + 48, side)) for start in range(0, side, 48)]
    found = np.concatenate(
        [codes_of(device, mesh, positions, heights, part, green) for part in parts]
    )

    codes = (wanted * 0.5 + 0.5) * 65535
    assert np.abs(found - codes).max() <= 2.5
    np.testing.assert_array_equal(
        found[~inside], np.broadcast_to([32768, 32768, 65535], found[~inside].shape)
    )


@pytest.mark.slow
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_curved_patch_is_shaded_as_the_displaced_mesh(drawn: Drawn, mirrored: bool) -> None:
    """Within 0.3 degrees where slopes reach 19. What is left out, h over the radius of curvature,
    is 0.8 % of the slopes; differences over two texels and the 48 facets make up the rest."""
    mesh = grid_mesh(curved, 48, mirrored=mirrored)
    u, v = centres()
    heights = waves(u, v)
    wanted = fine_normals(curved, waves)
    normal = true_normals(curved, u, v)
    along = tangents(curved, u, v)[0] * (-1 if mirrored else 1)
    assert degrees_between(wanted, normal).max() > 15

    map = drawn(mesh, heights[:, ::-1] if mirrored else heights)
    map = map[:, ::-1] if mirrored else map
    found = shaded(map, along, normal, -1.0 if mirrored else 1.0)

    inside = np.s_[1:-1, 1:-1]
    error = degrees_between(found, wanted)[inside]
    assert error.max() < 0.3
    assert np.sqrt(np.mean(error**2)) < 0.15


def test_the_metric_is_that_of_the_frame(drawn: Drawn) -> None:
    """A patch that is flat and square in the neutral, curved and sheared in the frame."""

    def flat(u: FloatArray, v: FloatArray) -> FloatArray:
        return np.stack([u, v, 0 * u], axis=-1)

    u, v = centres()
    posed = grid_mesh(curved, 48).positions
    map = drawn(grid_mesh(flat, 48), waves(u, v), posed)

    found = shaded(map, tangents(curved, u, v)[0], true_normals(curved, u, v))
    error = degrees_between(found, fine_normals(curved, waves))[1:-1, 1:-1]
    assert error.max() < 0.3


def test_normals_that_are_interpolated_are_not_of_length_1(drawn: Drawn) -> None:
    """A shader takes them as they are. A cylinder of three facets, with heights that rise along it:
    the slope is the same everywhere, though normals are short in the middle of a facet."""

    def bent(u: FloatArray, v: FloatArray) -> FloatArray:
        return np.stack([u, np.sin(3 * v - 1.5), np.cos(3 * v - 1.5)], axis=-1)

    mesh, side, rise = grid_mesh(bent, 3), 64, 0.5
    map = drawn(mesh, rise * centres(side)[0])

    chart = Chart.of(mesh, 1001, all_triangles(mesh, side))
    weights = chart.corner_weights(slice(0, side))
    posed, found = Posed.of(mesh, mesh.positions), chart.triangles.reshape(-1)
    normal, tangent = (
        np.einsum("kc,kcx->kx", weights, vectors[found])
        for vectors in (posed.normals, posed.tangents)
    )
    x, y, z = map.reshape(-1, 3).T[..., None]
    shown = unit(x * tangent + y * np.cross(normal, tangent) + z * normal)
    assert np.linalg.norm(normal, axis=1).min() < 0.9
    np.testing.assert_allclose(-shown[:, 0] / np.sum(shown * unit(normal), axis=1), rise, rtol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_under_any_straight_uv_is_exact(drawn: Drawn, seed: int) -> None:
    """Heights that rise evenly on a plane have one normal, whatever the UV are."""
    rng = np.random.default_rng(seed)
    to_uv = rng.uniform(-1, 1, (2, 2))
    to_uv *= 0.45 / np.abs(to_uv).sum(axis=1).max()
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    uv = square @ to_uv.T + 0.5
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(np.pad(square, [(0, 0), (0, 1)]).astype(np.float32), faces, uv, faces)
    rise = rng.uniform(-0.5, 0.5, 2)
    side = 64
    places = (np.stack(centres(side), axis=-1) - 0.5) @ np.linalg.inv(to_uv).T

    map = drawn(mesh, places @ rise)

    along = np.append(np.linalg.inv(to_uv)[:, 0], 0.0)
    found = shaded(map, along, np.array([0, 0, 1.0]), np.sign(np.linalg.det(to_uv)))
    covered = all_triangles(mesh, side) < 2
    wanted = unit(np.append(-rise, 1.0))
    assert (
        degrees_between(found[covered], np.broadcast_to(wanted, found[covered].shape)).max() < 0.01
    )
    straight = decoded(np.array([32768, 32768, 65535]))
    np.testing.assert_array_equal(map[~covered], np.broadcast_to(straight, map[~covered].shape))


def test_islands_do_not_lean_on_each_other(drawn: Drawn) -> None:
    """Two islands side by side, at different heights: flat each, so that every normal is straight;
    a difference over the gap would be a wall."""
    left = np.array([[0, 0], [0.5, 0], [0.5, 1], [0, 1]])
    uv = np.concatenate([left, left + np.array([0.5, 0])])
    places = np.concatenate([left, left + np.array([2, 0])])
    one = np.array([[0, 1, 2], [0, 2, 3]])
    faces = np.concatenate([one, one + 4])
    # The islands share a border in UV, but no coordinates.
    uv[:4, 0] *= 0.999
    mesh = Mesh(np.pad(places, [(0, 0), (0, 1)]).astype(np.float32), faces, uv, faces)
    triangles = all_triangles(mesh, 64)
    heights = np.where(triangles < 2, 1.0, -1.0)

    np.testing.assert_array_equal(drawn(mesh, heights)[..., 2], 1.0)


def test_tangents_are_shared_where_uv_are_and_apart_over_seams() -> None:
    mesh = grid_mesh(curved, 6)
    posed = Posed.of(mesh, mesh.positions)
    flat = posed.tangents.reshape(-1, 3)
    numbers = mesh.faces.reshape(-1)
    for number in np.unique(numbers):
        same = flat[numbers == number]
        np.testing.assert_allclose(same, same[:1].repeat(len(same), 0), atol=1e-12)
    lean = np.sum(posed.tangents * posed.normals, axis=-1)
    np.testing.assert_allclose(lean, 0.0, atol=1e-12)


def test_a_triangle_without_area_in_a_frame_is_flat(drawn: Drawn) -> None:
    """As a lid that closes: no slopes, and no texel that is no number."""
    mesh = grid_mesh(curved, 8)
    u, v = centres()
    heights = waves(u, v)
    posed = mesh.positions.astype(np.float64)
    posed[mesh.faces[0]] = posed[mesh.faces[0, 0]]

    found = drawn(mesh, heights, posed)

    inside = all_triangles(mesh, len(heights)) == 0
    assert inside.any()
    assert np.isfinite(found).all()
    assert (found[inside][:, 2] > 0.999).all()


def test_a_udim_without_a_texel_in_a_triangle_is_refused() -> None:
    mesh = grid_mesh(curved, 8)
    none = np.full((64, 64), len(mesh.faces), np.int32)
    with pytest.raises(MeshError, match="no texel of UDIM 1001 shows a triangle"):
        NormalChart.of(mesh, 1001, none, np.zeros((64, 64), np.uint8))
