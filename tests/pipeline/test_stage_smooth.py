"""Smooth sampling against the reference, and the laws that it holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import bumpy_grid, deform, rotate_translate
from pipeline.binned import BinnedScene
from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from pipeline.smooth_scenes import (
    LIMIT,
    MODELS,
    SmoothScene,
    fields_of,
    mesh_of,
    reference_fields,
    reference_sample,
    stretch_at,
)
from reference import bins as reference
from reference import drawing, locate, smooth
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.smooth import SmoothStage
from rhytid.pipeline.stretch import StretchStage
from rhytid.pipeline.uv_vertices import UvVertices, unit_jacobians

PLACES = np.random.default_rng(8).uniform(0.1, 0.9, (500, 2))


def bent(mesh, seed=3):
    return deform(mesh.positions, seed, 0.15)


def packed(form):
    """(..., 3) uu, uv, vv of matrices (..., 2, 2)."""
    return np.stack([form[..., 0, 0], form[..., 0, 1], form[..., 1, 1]], axis=-1)


@pytest.mark.parametrize("model", MODELS)
def test_fields_are_those_of_double(device, model):
    mesh = sheet()
    fields = fields_of(device, mesh, bent(mesh), model)
    corners = UvVertices.of(mesh, np.ones(len(mesh.faces), bool)).corners
    values = device.read(fields.values, (corners.max() + 1, 8), np.float32)[corners]
    owner = smooth.corners(*mesh_of(mesh)[1:])[1]
    metric, log_stretch = (packed(f)[owner] for f in reference_fields(mesh, bent(mesh), model))
    trace = values[..., [0]] + values[..., [2]]
    wanted = metric[..., [0]] + metric[..., [2]]
    assert np.abs(values[..., :3] / trace - metric / wanted).max() <= 1e-6
    assert np.abs(values[..., 3:6] / trace - log_stretch / wanted).max() <= 1e-6
    assert np.abs(log_stretch / wanted).max() > 0.05


def test_a_vertex_on_a_seam_is_two_and_equal_coordinates_are_one():
    positions, faces, uv, face_uv = bumpy_grid(10)
    apart = Mesh(
        positions, faces, uv[face_uv].reshape(-1, 2), np.arange(face_uv.size).reshape(-1, 3)
    )
    for mesh in (Mesh(positions, faces, uv, face_uv), apart):
        vertices = UvVertices.of(mesh, unit_jacobians(mesh)[1])
        assert len(vertices.vertex) == len(uv)
        np.testing.assert_array_equal(vertices.vertex[vertices.corners], faces)
        sums = np.add.reduceat(vertices.shares, vertices.offsets[:-1])
        np.testing.assert_allclose(sums, 1, rtol=1e-6)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("udim", [1001, 1012])
def test_redrawn_maps_are_those_of_double(device, model, udim):
    mesh = sheet(udims=2)
    scene = SmoothScene(device, mesh, random_graph(5, 240, span=2.0), settings_of())
    points = drawing.crop(96, 32, 64, 64, 256)
    wanted = scene.expected_smooth(points, bent(mesh), model, udim).reshape(64, 64)
    found = scene.redrawn_smooth(bent(mesh), model, udim)[96:160, 32:96]
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted).max() <= 1e-4 * DEPTH


BINS = (
    {"count": 4, "samples": 3},
    {"count": 1, "samples": 5, "bits": 16},
    {"count": 8, "samples": 3, "merge": "mellow", "depth_factored": True},
    {"pore_samples": 7, "merge": "soft", "depth_factored": True, "tilt": True, "reach": 1.5},
    {"count": 2, "samples": 3, "merge": "signed", "depth_factored": True, "tilt": True, "bits": 16},
)


@pytest.mark.parametrize(
    ("model", "bins"),
    [
        ("tensor", BINS[0]),
        pytest.param("tensor", BINS[1], marks=pytest.mark.slow),
        pytest.param("tensor", BINS[2], marks=pytest.mark.slow),
        *(("tensor", bins) for bins in BINS[3:]),
        pytest.param("tension", BINS[0], marks=pytest.mark.slow),
        pytest.param("uv", BINS[2], marks=pytest.mark.slow),
    ],
    ids=["paper", "one", "mellow", "best", "signed", "tension-paper", "uv-mellow"],
)
def test_blended_tiles_are_those_of_double(device, model, bins):
    mesh = sheet()
    scene = SmoothBinned(device, mesh, random_graph(6), settings_of(bins={**bins, "r_max": 0.1}))
    positions = bent(mesh)
    found = scene.blended_smooth(positions, model)
    wanted, sure = scene.expected(positions, model)
    assert sure.mean() > 0.98
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted)[sure].max() <= 2e-4 * DEPTH


class SmoothBinned(BinnedScene, SmoothScene):
    """The tile of BinnedScene, blended by the stretch of each texel."""

    def blended_smooth(self, positions, model="tensor"):
        blend = Blend(self.device, self.settings, len(self.mesh.faces))
        fields = fields_of(self.device, self.mesh, positions, model)
        out = blend.smooth_tile(self.tile, fields, self.located)
        return self.device.read(out, (len(self.points),), np.float32)

    def expected(self, positions, model):
        """(P,) from the product's own codes, and whether a texel's triangle is sure."""
        settings, bins = self.settings, self.settings.bins
        padding = settings.padding / settings.resolution
        index, margin = locate.locate(self.points, self.mesh.triangle_uv(), padding)
        logs, axes = reference_sample(self.mesh, positions, model, self.points, index)
        r = reference.layer_stretch(logs, axes, bins.count)
        layers = [maps.astype(np.int64) for maps in self.layers()]
        tilted = None
        if bins.tilt:
            sides_of_bins = reference.sides_of(logs, axes, bins.count)
            tilted = reference.Tilts(self.tilts().astype(np.int64), *sides_of_bins)
        return (
            reference.blend(layers, r, settings.response, settings.shape, bins, DEPTH, tilted),
            margin > 1e-6,
        )


def across_edges(mesh, gap):
    """Pairs of points (E, 2) on both sides of the inner edges of charts, `gap` apart."""
    sides: dict[tuple[int, int], list[int]] = {}
    for t, corners in enumerate(mesh.face_uv.tolist()):
        for k in range(3):
            a, b = sorted((corners[k], corners[k - 1]))
            sides.setdefault((a, b), []).append(t)
    inner = [(edge, pair) for edge, pair in sides.items() if len(pair) == 2]
    ends = mesh.uv[[edge for edge, _ in inner]]
    along = ends[:, 1] - ends[:, 0]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return ends.mean(axis=1) - gap / 2 * normal, ends.mean(axis=1) + gap / 2 * normal


@pytest.mark.parametrize("model", MODELS)
def test_no_step_shows_at_the_edges_of_triangles(device, model):
    # The closer the points on both sides of an edge, the closer their stretch: a slope, no step.
    mesh = sheet()
    steps = {}
    for gap in (2.0**-8, 2.0**-12):
        one, other = (
            stretch_at(device, mesh, bent(mesh), p, model) for p in across_edges(mesh, gap)
        )
        steps[gap] = np.abs(one - other).max()
    assert steps[2.0**-8] > 0.003
    assert steps[2.0**-12] <= steps[2.0**-8] / 16 * 1.5 + 2e-6
    one, other = (triangle_means(device, mesh, model, p) for p in across_edges(mesh, 2.0**-12))
    assert np.abs(one - other).max() > 20 * steps[2.0**-12]


def triangle_means(device, mesh, model, points):
    """Mean log stretch of the triangles that hold the points: what nearest sampling takes."""
    stage = StretchStage(device, mesh)
    ratios, _ = stage.read(stage.run(bent(mesh), LIMIT, model))
    held = UdimTriangles(device, mesh, 1001, 256, 16).points(points.astype(np.float32))
    return np.log(ratios).mean(axis=1)[held]


@pytest.mark.parametrize("model", MODELS)
def test_one_scale_everywhere_is_exact_everywhere(device, model):
    mesh = sheet()
    found = stretch_at(device, mesh, mesh.positions * np.float32(1.25), PLACES, model)
    held = UdimTriangles(device, mesh, 1001, 256, 16).points(PLACES.astype(np.float32))
    inside = held < len(mesh.faces)
    assert 0.5 < inside.mean() < 1
    # Wrinkles take Σ d r / (Σ d + 1e-6).
    np.testing.assert_allclose(found[inside], np.log(1.25), atol=5e-6, rtol=0)
    np.testing.assert_array_equal(found[~inside], 0.0)


@pytest.mark.parametrize("model", MODELS)
def test_a_rigid_motion_is_the_neutral(device, model):
    mesh = sheet()
    moved = rotate_translate(mesh.positions, 5)
    assert np.abs(stretch_at(device, mesh, moved, PLACES, model)).max() <= 5e-6


@pytest.mark.parametrize("model", MODELS)
def test_the_neutral_frame_is_exactly_unstretched(device, model):
    mesh = sheet()
    np.testing.assert_array_equal(stretch_at(device, mesh, None, PLACES, model), 0.0)


def test_scale_of_the_mesh_does_not_matter(device):
    mesh = sheet()
    wanted = stretch_at(device, mesh, bent(mesh), PLACES)
    for factor in (2.0**-30, 2.0**30):
        scaled = Mesh(mesh.positions * np.float32(factor), mesh.faces, mesh.uv, mesh.face_uv)
        found = stretch_at(device, scaled, bent(mesh) * np.float32(factor), PLACES)
        np.testing.assert_allclose(found, wanted, atol=2e-6, rtol=0)


def flat_patch():
    """A flat sheet whose UV are an affine image of its positions, and a linear deformation."""
    positions, faces, _, _ = bumpy_grid(10)
    flat = positions * np.float32([1, 1, 0])
    plane = flat[:, :2] @ np.array([[0.3, 0.1], [-0.05, 0.2]]) + 0.5
    deformation = np.array([[1.2, 0.15, 0.1], [-0.1, 0.9, 0.05], [0, 0, 1]])
    return Mesh(flat, faces, plane, faces), (flat @ deformation).astype(np.float32)


def test_smooth_is_nearest_where_a_flat_patch_is_deformed_linearly(device):
    mesh, positions = flat_patch()
    scene = SmoothBinned(device, mesh, random_graph(7), settings_of())
    nearest = scene.redrawn(positions)
    found = scene.redrawn_smooth(positions, "tensor", 1001)
    assert np.abs(found - nearest).max() <= 1e-4 * DEPTH
    blend = Blend(device, scene.settings, len(mesh.faces))
    blended = blend.tile(scene.tile, blend.coefficients(scene.stretch(positions)))
    expected = device.read(blended, (len(scene.points),), np.float32)
    assert np.abs(scene.blended_smooth(positions) - expected).max() <= 1e-4 * DEPTH


def test_signs_of_axes_are_free(device):
    mesh = sheet()
    found = StretchStage(device, mesh).run(bent(mesh), LIMIT)
    plain = smooth_values(device, mesh, found)
    axes = device.read(found.axes, (found.count, 2, 2), np.float32)
    for signs in ((-1, 1), (1, -1), (-1, -1)):
        turned = device.upload(axes * np.array(signs, np.float32)[:, None])
        np.testing.assert_array_equal(
            smooth_values(device, mesh, replace(found, axes=turned)), plain
        )


def smooth_values(device, mesh, found):
    """The fields of UV vertices, as the device has them."""
    fields = SmoothStage(device, mesh).run(found, LIMIT)
    return device.read(fields.values, (fields.nbytes // 32, 8), np.float32)


def test_triangles_without_area_in_space_count_for_nothing(device):
    mesh = sheet()
    positions = mesh.positions.copy()
    fallen = mesh.faces[
        UdimTriangles(device, mesh, 1001, 256, 0).points(PLACES.astype("f4"))[::9] % 200
    ]
    positions[fallen[:, 1]] = positions[fallen[:, 0]]
    broken = Mesh(positions, mesh.faces, mesh.uv, mesh.face_uv)
    used = unit_jacobians(broken)[1]
    assert 0.2 < used.mean() < 0.95
    around = np.diff(UvVertices.of(broken, used).offsets)
    assert (around == 0).any()
    for model in MODELS:
        found = stretch_at(device, broken, bent(broken), PLACES, model)
        assert np.isfinite(found).all()
        assert np.abs(found).max() <= LIMIT + 1e-6
