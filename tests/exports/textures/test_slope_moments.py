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
from rhytid.engine.device_assets.slopes import neighbour_codes
from rhytid.exports.textures.normals import NormalChart
from rhytid.exports.textures.tangents import Posed, joined
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.normals import normal_codes
from rhytid.pipeline.slopes import Band, SlopeChart, SlopeWork, finest_moments, moments
from rhytid.pipeline.tangents import TERMS, TangentMesh

if TYPE_CHECKING:
    from rhytid.device.buffer import Buffer
    from rhytid.device.runtime import Device

SIDE = 128
# The flag of a triangle, in slope_terms.clh.
FITS = 31
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


@pytest.fixture(scope="module", params=[0.4, 0.01], ids=["bent", "smooth"])
def scene(device: Device, small_mesh: SmallMesh, request: pytest.FixtureRequest) -> Scene:
    """Of a mesh that bends much within a cell, and little."""
    mesh = Mesh(*small_mesh)
    positions = deform(mesh.positions, 3, request.param)
    rng = np.random.default_rng(5)
    heights = (0.008 * rng.standard_normal((SIDE, SIDE))).astype(np.float32)
    located = UdimTriangles(device, mesh, 1001, SIDE, 4)
    triangles = device.read(located.texels(SIDE, 0, 0, SIDE), (SIDE, SIDE), np.int32)
    posed = Posed.of(mesh, positions)
    chart = SlopeChart.of(device, triangles, neighbour_codes(mesh, 1001, triangles), (0, 0), SIDE)
    surface = reference.surface(positions, mesh.faces, mesh.uv, mesh.face_uv)
    slopes, inside = reference.slopes(heights.astype(np.float64), triangles, surface)
    frames = TangentMesh.of(device, mesh.faces, mesh.triangle_uv() * SIDE, *joined(mesh).numbers)
    return Scene(
        mesh, posed, heights, triangles, chart, frames.terms(device, positions), slopes, inside
    )


def test_the_scenes_take_both_ways(
    device: Device, scene: Scene, request: pytest.FixtureRequest
) -> None:
    """A triangle that bends much is turned exactly in each texel, others by a polynomial."""
    terms = device.read(scene.terms, (len(scene.mesh.faces), TERMS), np.float32)
    fits = terms[:, FITS].mean()
    assert 0.5 < fits < 0.9 if "bent" in request.node.name else fits == 1.0


@pytest.mark.parametrize("least", [1, 2])
def test_moments_are_those_of_brute_force(device: Device, scene: Scene, least: int) -> None:
    work = SlopeWork(device, SIDE, SIDE, least)
    work.take(Band.of(device, 0, scene.heights))
    work.add(scene.chart, scene.terms)
    made = work.finish()
    for level in range(least, 8):
        sums = made.read(device, level, 0, 0, SIDE >> level)
        coverage = _read(device, scene.chart.coverage.buffers[level - 1], SIDE >> level)
        found = moments(sums, coverage)

        wanted = reference.moments(scene.slopes, scene.inside, level)
        assert np.abs(wanted).max() > 0.04
        np.testing.assert_allclose(found, wanted, atol=CLOSE)
        variance = found[..., 2:5:2] - found[..., :2] ** 2
        assert variance.min() > -CLOSE


def test_strips_make_the_same_bits(device: Device, scene: Scene) -> None:
    """Where the rows above and below a strip are in other bands."""
    codes = neighbour_codes(scene.mesh, 1001, scene.triangles)
    chart = SlopeChart.of(device, scene.triangles, codes, (0, 0), SIDE // 4)
    assert len(chart.strips) == 4
    made = []
    for of in (chart, scene.chart):
        rows = of.strips[0].rows
        work = SlopeWork(device, SIDE, rows, 1)
        for row in range(0, SIDE, rows):
            work.take(Band.of(device, row, scene.heights[row : row + rows]))
            work.add(of, scene.terms)
        made.append(work.finish())
    for level in (1, 2, 7):
        one, other = (levels.read(device, level, 0, 0, SIDE >> level) for levels in made)
        np.testing.assert_array_equal(one, other)


def test_level_0_is_the_slope_and_its_products(device: Device, scene: Scene) -> None:
    """A square inside of the map, beside a seam."""
    row, column, side = 32, 48, 32
    around = scene.heights[row - 1 : row + side + 1, column - 1 : column + side + 1]

    found = finest_moments(device, scene.chart, scene.terms, around, row, column)

    block = np.s_[row : row + side, column : column + side]
    assert 0 < scene.inside[block].mean() < 1
    x, y = np.moveaxis(scene.slopes[block], -1, 0)
    np.testing.assert_allclose(found, [x, y, x * x, x * y, y * y], atol=2 * CLOSE)


def test_level_0_slopes_are_those_of_normal_maps(device: Device, scene: Scene) -> None:
    """To first order in how the mesh bends within a triangle: shaders do not make vectors unit."""
    codes = neighbour_codes(scene.mesh, 1001, scene.triangles)
    chart = NormalChart.of(scene.mesh, 1001, scene.triangles, codes)
    records = chart.records(scene.posed)
    found = normal_codes(device, scene.heights, chart.triangles, codes, records, slice(0, SIDE), 1)
    inside = scene.inside
    wanted = found[inside] / 65535.0 * 2.0 - 1.0

    x, y = scene.slopes[inside].T
    own = np.stack([-x, -y, np.ones(len(x))], axis=1)
    own /= np.linalg.norm(own, axis=1, keepdims=True)

    error = degrees_between(own, wanted)
    assert np.median(error) < 0.2


def _read(device: Device, buffer: Buffer, side: int) -> NDArray[np.float32]:
    found: NDArray[np.float32] = device.read(buffer, (side, side), np.float32)
    return found
