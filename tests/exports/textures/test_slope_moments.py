"""Moments of slopes on the device, against brute force texel by texel in double."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from exports.textures.patches import degrees_between
from meshes import SmallMesh, deform
from reference import slopes as reference
from rhytid.domain.mesh import Mesh
from rhytid.exports.textures.frame_map import Chart
from rhytid.exports.textures.slope_terms import neighbour_codes, slope_terms
from rhytid.exports.textures.tangents import Posed
from rhytid.exports.textures.writers import normal_map
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.slopes import SlopeChart, SlopeStage, moments

if TYPE_CHECKING:
    from rhytid.device.buffer import Buffer
    from rhytid.device.runtime import Device

SIDE = 128
# Float32 beside double: slopes of this relief reach 1.
CLOSE = 1e-5


class Scene(NamedTuple):
    """A deformed sheet of two islands, with relief, and its slopes by brute force."""

    mesh: Mesh
    posed: Posed
    heights: NDArray[np.float32]
    triangles: NDArray[np.int32]
    chart: SlopeChart
    terms: Buffer
    slopes: NDArray[np.float64]
    inside: NDArray[np.bool_]


@pytest.fixture(scope="module")
def scene(device: Device, small_mesh: SmallMesh) -> Scene:
    mesh = Mesh(*small_mesh)
    positions = deform(mesh.positions, 3)
    rng = np.random.default_rng(5)
    heights = (0.008 * rng.standard_normal((SIDE, SIDE))).astype(np.float32)
    located = UdimTriangles(device, mesh, 1001, SIDE, 4)
    triangles = device.read(located.texels(SIDE, 0, 0, SIDE), (SIDE, SIDE), np.int32)
    posed = Posed.of(mesh, positions)
    chart = SlopeChart.of(device, triangles, neighbour_codes(mesh, 1001, triangles), (0, 0))
    surface = reference.surface(positions, mesh.faces, mesh.uv, mesh.face_uv)
    slopes, inside = reference.slopes(heights.astype(np.float64), triangles, surface)
    terms = device.upload(slope_terms(mesh, posed, SIDE))
    return Scene(mesh, posed, heights, triangles, chart, terms, slopes, inside)


@pytest.mark.parametrize("level", range(1, 8))
def test_moments_are_those_of_brute_force(device: Device, scene: Scene, level: int) -> None:
    made = SlopeStage(device).levels(scene.chart, scene.terms, scene.heights)
    side = SIDE >> level
    sums = np.stack([_read(device, plane.buffers[level - 1], side) for plane in made.planes])
    coverage = _read(device, scene.chart.coverage.buffers[level - 1], side)

    found = moments(sums, coverage)

    wanted = reference.moments(scene.slopes, scene.inside, level)
    assert np.abs(wanted).max() > 0.04
    np.testing.assert_allclose(found, wanted, atol=CLOSE)
    variance = found[..., 2:5:2] - found[..., :2] ** 2
    assert variance.min() > -CLOSE


def test_level_0_is_the_slope_and_its_products(device: Device, scene: Scene) -> None:
    """A square inside of the map, beside a seam."""
    row, column, side = 32, 48, 32
    around = scene.heights[row - 1 : row + side + 1, column - 1 : column + side + 1]

    found = SlopeStage(device).finest(scene.chart, scene.terms, around, row, column)

    block = np.s_[row : row + side, column : column + side]
    assert 0 < scene.inside[block].mean() < 1
    x, y = np.moveaxis(scene.slopes[block], -1, 0)
    np.testing.assert_allclose(found, [x, y, x * x, x * y, y * y], atol=2 * CLOSE)


def test_level_0_slopes_are_those_of_normal_maps(scene: Scene) -> None:
    """To first order in how the mesh bends within a triangle: shaders do not make vectors unit."""
    map = normal_map(scene.heights, Chart.of(scene.mesh, 1001, scene.triangles), scene.posed)
    inside = scene.inside
    wanted = map[inside].astype(np.float64)

    x, y = scene.slopes[inside].T
    own = np.stack([-x, -y, np.ones(len(x))], axis=1)
    own /= np.linalg.norm(own, axis=1, keepdims=True)

    error = degrees_between(own, wanted)
    assert np.median(error) < 0.2


def _read(device: Device, buffer: Buffer, side: int) -> NDArray[np.float32]:
    found: NDArray[np.float32] = device.read(buffer, (side, side), np.float32)
    return found
