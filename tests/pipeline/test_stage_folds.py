"""Where skin folds, against float64: per triangle, at vertices, and what must not change it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshes import bumpy_grid
from reference import folds as reference
from rhytid.device.runtime import Device
from rhytid.domain.expressions import COLUMNS, ROWS, Expressions, Folds
from rhytid.domain.mesh import Mesh
from rhytid.errors import CancelledError
from rhytid.pipeline.diffusion import Diffusion
from rhytid.pipeline.folds import FoldStage, in_space, measured_folds
from rhytid.synthesis.workspace import directly

LIMIT = 0.5


def mesh_of(small) -> Mesh:
    return Mesh(small.positions, small.faces, small.uv, small.face_uv)


def sheet(cells: int, size: float = 4.0) -> Mesh:
    """A flat square of `size` a side in the plane z = 0, two triangles a cell."""
    line = np.linspace(0.0, size, cells + 1)
    x, y = np.meshgrid(line, line)
    positions = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(cells), np.arange(cells))
    a = (j * (cells + 1) + i).ravel()
    b, c, d = a + 1, a + cells + 2, a + cells + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(positions.astype(np.float32), faces, positions[:, :2] / (2 * size) + 0.1, faces)


def measured(device: Device, mesh: Mesh, shapes, unit: str = "cm") -> Folds | None:
    expressions = Expressions.checked(np.stack(shapes), len(mesh.positions))
    return measured_folds(device, mesh, expressions, LIMIT, unit, lambda *_: None, directly)


def moved(mesh: Mesh, seed: int, size: float = 0.02) -> np.ndarray:
    rng = np.random.default_rng(seed)
    shape = mesh.positions + size * rng.normal(size=mesh.positions.shape)
    return shape.astype(np.float32)


def full(tensor: np.ndarray) -> np.ndarray:
    matrix = np.empty((len(tensor), 3, 3))
    matrix[:, ROWS, COLUMNS] = matrix[:, COLUMNS, ROWS] = tensor
    return matrix


def test_each_triangle_is_folded_as_in_double(device, small_mesh):
    mesh = mesh_of(small_mesh)
    shape = moved(mesh, 1)
    stage = FoldStage(device, mesh, directly)
    folds, moves = stage.measure(shape, LIMIT)
    stage.release()
    wanted = reference.triangle_folds(mesh.positions, mesh.faces, [shape], LIMIT)
    assert moves
    assert wanted.max() > 0.01
    found = full(in_space(mesh, folds.astype(float)))
    assert np.abs(found - wanted).max() < 4e-6 * (1 + LIMIT) ** 2


def test_the_field_at_vertices_is_that_of_double(device, small_mesh):
    mesh = mesh_of(small_mesh)
    shapes = [moved(mesh, seed) for seed in range(3)]
    folds = measured(device, mesh, shapes)
    wanted = reference.spread(
        mesh.positions, mesh.faces,
        reference.triangle_folds(mesh.positions, mesh.faces, shapes, LIMIT), 0.35,
    )  # fmt: skip
    assert folds.moving == 3
    assert np.abs(full(folds.tensor) - wanted).max() < 1e-5 * wanted.max()


def test_turning_the_head_changes_nothing(device, small_mesh):
    mesh = mesh_of(small_mesh)
    shapes = [moved(mesh, seed) for seed in range(3)]
    turns = Rotation.random(3, random_state=4)
    away = [
        (turn.apply(s.astype(float)) + np.array([3.0, -2.0, 1.0])).astype(np.float32)
        for turn, s in zip(turns, shapes, strict=True)
    ]
    still, turned = measured(device, mesh, shapes), measured(device, mesh, away)
    assert np.abs(still.tensor - turned.tensor).max() < 1e-5 * still.tensor.max()


def test_what_moves_rigidly_adds_nothing(device, small_mesh):
    mesh = mesh_of(small_mesh)
    shape, turn = moved(mesh, 0), Rotation.from_euler("xyz", [0.3, 0.5, -0.2])
    rigid = (turn.apply(mesh.positions.astype(float)) + 1.0).astype(np.float32)
    assert measured(device, mesh, [rigid]) is None
    assert measured(device, mesh, [mesh.positions] * 3) is None
    one, more = measured(device, mesh, [shape]), measured(device, mesh, [rigid, shape, rigid])
    assert (one.moving, more.moving) == (1, 1)
    np.testing.assert_array_equal(one.tensor, more.tensor)


def test_a_strip_compressed_along_x_has_lines_along_y(device):
    mesh = sheet(20)
    folds = measured(device, mesh, [mesh.positions * np.float32([0.8, 1.0, 1.0])])
    size, eccentricity, axis = folds.axes()
    np.testing.assert_allclose(size, -np.log(0.8), rtol=1e-4)
    assert eccentricity.min() > 0.99
    assert np.abs(axis[:, 0]).min() > 0.9999


def test_stretch_is_no_fold(device):
    mesh = sheet(10)
    assert measured(device, mesh, [mesh.positions * np.float32([1.3, 1.0, 1.0])]) is None


def smooth_shape(mesh: Mesh) -> np.ndarray:
    """Compressed along directions that turn over the sheet."""
    x, y = mesh.positions.astype(float)[:, :2].T
    shape = mesh.positions.astype(float)
    shape[:, 0] -= 0.25 * np.exp(-((x - 1.4) ** 2 + (y - 2.0) ** 2)) * (x - 1.4)
    shape[:, 1] -= 0.4 * np.exp(-((x - 2.6) ** 2 + (y - 1.6) ** 2)) * (y - 1.6)
    return shape.astype(np.float32)


def test_a_finer_mesh_has_the_same_field(device):
    coarse, fine = sheet(24), sheet(48)
    one, two = (measured(device, mesh, [smooth_shape(mesh)]) for mesh in (coarse, fine))
    same = np.arange(49 * 49).reshape(49, 49)[::2, ::2].ravel()
    size, eccentricity, axis = one.axes()
    other = tuple(values[same] for values in two.axes())
    np.testing.assert_allclose(other[0], size, atol=0.04 * size.max())
    told = (size > 0.2 * size.max()) & (eccentricity > 0.2)
    assert np.count_nonzero(told) > 100
    turn = np.degrees(np.arccos(np.clip(np.abs((axis * other[2]).sum(1)), 0, 1)))[told]
    assert turn.max() < 3.0


@pytest.mark.parametrize("cells", [40, 81])
def test_heat_spreads_by_the_length_that_is_set(cells):
    mesh = sheet(cells)
    spreading = Diffusion(mesh, 0.35, np.arange(len(mesh.positions)))
    spike = np.zeros((len(mesh.faces), 1))
    centre = mesh.positions[mesh.faces].mean(axis=1)[:, :2]
    spike[np.linalg.norm(centre - 2.0, axis=1).argmin()] = 1.0
    found = spreading.of_triangles(spike)[:, 0]
    found /= found.sum()
    x = mesh.positions[:, 0]
    deviation = np.sqrt((found * (x - (found * x).sum()) ** 2).sum())
    assert deviation == pytest.approx(0.35, rel=0.03)
    assert found.min() >= -1e-9


def test_vertices_that_an_exporter_split_are_one(device):
    whole = sheet(16)
    centre = whole.positions[whole.faces].mean(axis=1)[:, 0]
    split = np.concatenate([whole.positions, whole.positions])
    faces = whole.faces + np.where(centre > 2.0, len(whole.positions), 0)[:, None]
    uv = np.concatenate([whole.uv, whole.uv + np.array([0.0, 1.0])])
    cut = Mesh(split, faces, uv, faces)
    shape = smooth_shape(whole)
    one = measured(device, whole, [shape])
    two = measured(device, cut, [np.concatenate([shape, shape])])
    used = np.unique(faces)
    np.testing.assert_allclose(two.tensor[used], one.tensor[used % len(whole.positions)], atol=1e-7)


def test_lips_that_touch_are_two(device):
    lower, upper = sheet(8, 2.0), sheet(8, 2.0)
    above = upper.positions + np.float32([0.0, 2.0, 0.0])
    faces = np.concatenate([lower.faces, upper.faces + len(lower.positions)])
    uv = np.concatenate([lower.uv, upper.uv + np.array([0.0, 1.0])])
    mesh = Mesh(np.concatenate([lower.positions, above]), faces, uv, faces)
    shape = mesh.positions.copy()
    shape[len(above) :, 1] += 0.5  # opens
    shape[len(above) :, 0] *= 0.8
    folds = measured(device, mesh, [shape])
    assert folds.axes()[0][: len(above)].max() < 1e-6
    assert folds.axes()[0][len(above) :].min() > 0.2


def test_it_can_be_cancelled_between_expressions(device, small_mesh):
    mesh = mesh_of(small_mesh)
    expressions = Expressions.checked(np.stack([moved(mesh, 1)] * 4), len(mesh.positions))
    used, seen = device.budget.used, []

    def progress(share: float, stage: str) -> None:
        seen.append((share, stage))
        if share > 0.3:
            raise CancelledError("enough")

    with pytest.raises(CancelledError):
        measured_folds(device, mesh, expressions, LIMIT, "cm", progress, directly)
    assert [stage for _, stage in seen] == ["folds"] * 3
    assert device.budget.used == used


def test_many_triangles_without_area_say_nothing(device):
    grid = bumpy_grid(6, seed=2)
    faces = np.concatenate([grid.faces, np.zeros((5, 3), np.int32)])
    face_uv = np.concatenate([grid.face_uv, np.zeros((5, 3), np.int32)])
    mesh = Mesh(grid.positions, faces, grid.uv, face_uv)
    folds = measured(device, mesh, [moved(mesh, 3)])
    plain = mesh_of(grid)
    np.testing.assert_allclose(folds.tensor, measured(device, plain, [moved(plain, 3)]).tensor)


def test_a_frown_has_two_crests_between_the_brows(device):
    """Each brow is pressed towards the middle, and what is between them by both."""
    mesh = sheet(40, 8.0)
    x = mesh.positions[:, 0] - 4.0

    def drawn(side: float) -> np.ndarray:
        shape = mesh.positions.copy()
        own = 1.0 / (1.0 + np.exp(-side * x / 0.5))
        shape[:, 0] -= own * side * 0.25 * np.tanh((side * x - 0.8) / 0.5)
        return shape

    both = drawn(-1.0) + drawn(1.0) - mesh.positions

    def crests(shapes: list[np.ndarray], *names: str) -> np.ndarray | None:
        expressions = Expressions.checked(np.stack(shapes), len(x), names)
        report = (lambda *_: None, directly)
        found = measured_folds(device, mesh, expressions, LIMIT, "cm", *report)
        assert found is not None
        return found.frown

    assert crests([drawn(-1.0)], "browDownLeft") is None
    pair = crests([drawn(-1.0), drawn(1.0)], "browDownRight", "L_browDown")
    for found in (pair, crests([both], "AU4")):
        assert found is not None
        for side in (-1.0, 1.0):
            high = side * x[side * found > 0.5]
            assert len(high) > 20
            assert (np.abs(high - 0.8) < 0.5).all()
        assert np.abs(found[np.abs(x) < 0.25]).max() < 0.1
        assert np.abs(found[np.abs(x) > 2.0]).max() == 0.0
