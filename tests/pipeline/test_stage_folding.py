"""What folds of a mesh take of log stretch: against the reference, and the laws of folding.py."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from meshes import deform, rotate_translate
from pipeline.scenes import sheet
from reference import folding as reference
from rhytid.domain.mesh import Mesh
from rhytid.pipeline import stretch
from rhytid.pipeline.folding import Folding, FoldRule
from rhytid.pipeline.stretch import StretchStage

LIMIT = 0.5
LENGTH_MM = 100.0


class Folded:
    """The stretch of a mesh in one frame, with and without its folds."""

    def __init__(self, device, mesh, positions, folds=1.0, unit="cm", model="tensor"):
        stage = StretchStage(device, mesh, unit)
        self.plain, self.taken = self._read(device, stage, mesh, positions, model, 0.0)[0], None
        self.logs, self.taken = self._read(device, stage, mesh, positions, model, folds)
        stage.release()

    def _read(self, device, stage, mesh, positions, model, folds):
        found = stage.run(positions, LIMIT, model, folds=folds)
        logs = device.read(found.logs, (len(mesh.faces) + 1, 2), np.float32)
        taken = stage.read_taken(found)
        found.release()
        return logs, taken


def pressed(mesh, seed=0, amount=0.08, height=0.2):
    """Positions that are shorter along x, with folds four columns wide, and wavy."""
    moved = deform(mesh.positions, seed, amount) * (0.4, 1.0, 1.0)
    moved[:, 2] += height * np.cos(2.5 * np.pi * mesh.positions[:, 0])
    return moved.astype(np.float32)


def wanted(mesh, positions, unit):
    rule = FoldRule.of(mesh, unit)
    sizes = (rule.length, rule.rounds, rule.normal_rounds)
    return reference.taken(mesh.positions, mesh.faces, positions, *sizes)


@pytest.mark.parametrize("unit", ["mm", "1.4mm", "1.5cm", "2cm", "furlong"])
def test_the_share_is_that_of_double(device, unit):
    # Taken for a face, a sheet of 60 columns has folds of some millimetres.
    mesh = sheet(seed=3) if unit != "furlong" else sheet(n=60, seed=3)
    positions = pressed(mesh, 3)
    if unit == "furlong":
        positions[:, 2] += 0.03 * np.cos(20 * np.pi * mesh.positions[:, 0]).astype(np.float32)
    share = wanted(mesh, positions, unit)
    assert share.max() > 0.1
    np.testing.assert_allclose(Folded(device, mesh, positions, unit=unit).taken, share, atol=2e-4)


def test_compression_keeps_its_sign_and_stretch_its_bits(device):
    mesh = sheet(seed=5)
    found = Folded(device, mesh, pressed(mesh, 5, 0.2), unit="1.5cm")
    stretched = found.plain >= 0
    np.testing.assert_array_equal(found.logs[stretched], found.plain[stretched])
    left = found.logs[~stretched] / found.plain[~stretched]
    assert left.max() <= 1.0
    assert 0.1 - 1e-6 <= left.min() < 0.5
    np.testing.assert_allclose(
        found.logs[:-1], found.plain[:-1] - found.taken[:, None] * np.minimum(found.plain[:-1], 0),
        atol=1e-6,
    )  # fmt: skip
    np.testing.assert_array_equal(found.logs[-1], 0.0)


def test_half_of_the_folds_take_half(device):
    mesh = sheet(seed=5)
    half, whole = (Folded(device, mesh, pressed(mesh, 5), k, "1.5cm").taken for k in (0.5, 1.0))
    np.testing.assert_allclose(half, 0.5 * whole, rtol=1e-6)


def test_the_neutral_and_what_moves_rigidly_have_no_folds(device):
    mesh = sheet(seed=1)
    assert StretchStage(device, mesh).run(None, LIMIT, folds=1.0).taken is None
    for positions in (mesh.positions, rotate_translate(mesh.positions, 1)):
        assert Folded(device, mesh, positions).taken.max() <= 1e-12


def test_a_rigid_motion_changes_nothing(device):
    mesh = sheet(seed=2)
    positions = pressed(mesh, 2)
    here, there = (
        Folded(device, mesh, p, unit="1.5cm").taken
        for p in (positions, rotate_translate(positions, 4))
    )
    assert here.max() > 0.1
    np.testing.assert_allclose(there, here, atol=1e-4)


def test_it_hangs_on_space_alone(device):
    """Other UV, and vertices split as exporters do, give the same folds."""
    mesh = sheet(seed=2)
    positions = pressed(mesh, 2)
    share = Folded(device, mesh, positions, unit="1.5cm").taken
    turned = Mesh(mesh.positions, mesh.faces, mesh.uv[:, ::-1].copy(), mesh.face_uv)
    np.testing.assert_array_equal(Folded(device, turned, positions, unit="1.5cm").taken, share)
    corner = mesh.faces.reshape(-1)
    split = np.arange(len(corner), dtype=np.int32).reshape(-1, 3)
    soup = Mesh(mesh.positions[corner], split, mesh.uv, mesh.face_uv)
    found = Folded(device, soup, positions[corner], unit="1.5cm").taken
    np.testing.assert_array_equal(found, share)


def test_collapsed_triangles_say_nothing_of_how_fine_a_mesh_is(device):
    """Though most of a mesh are: edges without length are none."""
    mesh = sheet(seed=2)
    positions = pressed(mesh, 2)
    share = Folded(device, mesh, positions, unit="1.5cm").taken
    points = np.zeros((2 * len(mesh.faces), 3), np.int32)
    faces, face_uv = (np.concatenate([f, points]) for f in (mesh.faces, mesh.face_uv))
    with_points = Mesh(mesh.positions, faces, mesh.uv, face_uv)
    found = Folded(device, with_points, positions, unit="1.5cm").taken
    np.testing.assert_array_equal(found[: len(share)], share)


def test_scaled_by_a_power_of_two_it_is_the_same(device):
    mesh = sheet(seed=2)
    positions = pressed(mesh, 2)
    large = Mesh(mesh.positions * 1024, mesh.faces, mesh.uv, mesh.face_uv)
    one = Folded(device, mesh, positions, unit="furlong").taken
    np.testing.assert_array_equal(
        Folded(device, large, positions * np.float32(1024), unit="furlong").taken, one
    )


@pytest.mark.parametrize("model", ["tension", "uv"])
def test_every_model_loses_the_same_share(device, model):
    mesh = sheet(seed=2)
    positions = pressed(mesh, 2)
    share = Folded(device, mesh, positions, unit="1.5cm").taken
    other = Folded(device, mesh, positions, unit="1.5cm", model=model)
    np.testing.assert_array_equal(other.taken, share)
    kept = other.plain[:-1] - share[:, None] * np.minimum(other.plain[:-1], 0)
    np.testing.assert_allclose(other.logs[:-1], kept, atol=1e-6)


def strip(height, ratio, columns=24, rows=10, edge=2.8):
    """A flat strip with edges in mm, and the same pressed along x to `ratio`, with folds of four
    columns, `height` mm high."""
    j, i = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    flat = np.stack([j, i, 0 * j], axis=-1).reshape(-1, 3) * edge
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    quads = first + np.array([0, 1, columns + 2, columns + 1])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    uv = (flat[:, :2] / flat.max()).astype(np.float32)
    folded = flat * (ratio, 1, 1)
    folded[:, 2] = height * np.cos(0.5 * np.pi * j.reshape(-1))
    return Mesh(flat.astype(np.float32), faces, uv, faces), folded.astype(np.float32)


def inner(mesh):
    """Triangles away from the rim of a strip."""
    middle = mesh.positions[mesh.faces].mean(axis=1)
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    return ((middle[:, :2] > low[:2] + 12) & (middle[:, :2] < high[:2] - 12)).all(axis=1)


@pytest.mark.parametrize(("height", "ratio"), [(0.25, 0.6), (0.3, 0.7), (0.24, 0.7)])
def test_a_folded_strip(device, height, ratio):
    """Heights of (1, 0, −1, 0) turn normals by a/h from column to column, so that every triangle
    has the curvature ±a/h², and over a fold its mean is half of that at most."""
    mesh, folded = strip(height, ratio)
    edge = 2.8 * ratio
    c = -np.log(np.hypot(edge, height) / 2.8)
    b = LENGTH_MM * c * height / edge**2
    variances = 0.75 * b**2 * (1 - (5 / 9) ** 2), b**2
    low, high = (0.9 * (1 - (1 + t) ** -0.25) for t in np.maximum(np.array(variances) - 0.5, 0))
    found = Folded(device, mesh, folded, unit="mm").taken[inner(mesh)]
    assert found.min() >= low > 0.01
    assert found.max() <= 1.05 * high


def test_what_is_left_grows_all_the_way_into_a_fold(device):
    """Lines that went deep and faded again on the way to an expression would flash."""
    left = []
    for way in np.linspace(0.05, 1, 16):
        mesh, folded = strip(0.5 * way, 1 - 0.35 * way)
        found = Folded(device, mesh, folded, unit="mm")
        left.append(-found.logs[:-1].min(axis=1)[inner(mesh)].mean())
    assert found.taken[inner(mesh)].mean() > 0.4
    assert left[-1] > 0.98 * max(left)


def test_a_bulge_is_no_fold(device):
    """Pressed onto a cylinder of 25 mm, skin keeps its lines."""
    mesh, _ = strip(0, 1)
    x, y, _ = mesh.positions.T.astype(float)
    angle = 0.75 * x / 25
    round_ = np.stack([25 * np.sin(angle), y, 25 * np.cos(angle)], axis=1).astype(np.float32)
    assert Folded(device, mesh, round_, unit="mm").taken[inner(mesh)].max() < 1e-3


def test_stretch_has_no_folds(device):
    mesh, folded = strip(0.5, 1.3)
    assert Folded(device, mesh, folded, unit="mm").taken[inner(mesh)].max() < 1e-3


def test_jitter_of_a_capture_changes_little(device):
    mesh, folded = strip(0.25, 0.65)
    rng = np.random.default_rng(1)
    noisy = folded + rng.normal(0, 0.02, folded.shape).astype(np.float32)
    calm, shaken = (Folded(device, mesh, p, unit="mm").taken for p in (folded, noisy))
    inside = inner(mesh)
    assert np.abs(shaken - calm)[inside].max() < 0.12
    still = mesh.positions + rng.normal(0, 0.02, folded.shape).astype(np.float32)
    assert Folded(device, mesh, still, unit="mm").taken.max() < 1e-4


def test_it_follows_the_frame_without_a_jump(device):
    mesh, folded = strip(0.3, 0.6)
    flat = mesh.positions
    shares = [
        Folded(device, mesh, flat + np.float32(k) * (folded - flat), unit="mm").taken
        for k in np.linspace(0, 1, 41)
    ]
    assert shares[0].max() == 0.0
    assert shares[-1].max() > 0.4
    assert max(np.abs(b - a).max() for a, b in pairwise(shares)) < 0.12


def test_a_finer_mesh_has_the_same_folds(device):
    """Folds 11 mm wide, with edges of 2.8 mm and of 1.4 mm."""
    share = []
    for finer in (1, 2):
        mesh, folded = strip(0.0, 0.65, 24 * finer, 10 * finer, 2.8 / finer)
        folded[:, 2] = 0.3 * np.cos(2 * np.pi * mesh.positions[:, 0] / 11.2)
        share.append(np.median(Folded(device, mesh, folded, unit="mm").taken[inner(mesh)]))
    assert share[0] > 0.4
    assert abs(share[1] / share[0] - 1) < 0.1


@pytest.mark.usefixtures("unknown")
@pytest.mark.parametrize("unit", ["1.5cm", "mm", "1.4mm"])
def test_parts_have_the_bits_of_the_whole(device, unit):
    """One after the other, of which each has triangles of the one before; and all after that."""
    mesh = sheet(seed=3)
    positions, stage = pressed(mesh, 3), StretchStage(device, mesh, unit)

    def read(found):
        counts = {"ratios": 2, "axes": 4, "logs": 2, "taken": 1}
        read = {name: (getattr(found, name), (found.count, n)) for name, n in counts.items()}
        values = [device.read(*one, np.float32) for one in read.values()]
        return np.concatenate(values, axis=1)

    whole = read(stage.run(positions, LIMIT, folds=1.0))
    assert whole[:, -1].max() > 0.1
    part, known = stage.unfilled(positions, "tensor", "uv", 1.0), np.zeros(len(whole), bool)
    for first, last in ((30, 80), (60, 120), (5, 6)):
        triangles = np.arange(first, last, dtype=np.int32)
        known[[*triangles, -1]] = True
        stage.fill(part, positions, LIMIT, folds=1.0, near=stage.nearby(triangles, 1.0))
        found = read(part)
        np.testing.assert_array_equal(found[known], whole[known])
        assert np.isnan(found[~known]).all()
    stage.fill(part, positions, LIMIT, folds=1.0)
    np.testing.assert_array_equal(read(part), whole)
    stage.release()


def test_folds_are_prepared_where_they_are_asked_for_alone(device, monkeypatch):
    made = []
    monkeypatch.setattr(stretch, "Folding", lambda *a: made.append(a) or Folding(*a))
    mesh = sheet(seed=3)
    stage = StretchStage(device, mesh, "1.5cm")
    for folds, count in ((0.0, 0), (1.0, 1), (0.5, 1)):
        stage.run(pressed(mesh), LIMIT, folds=folds).release()
        assert len(made) == count
    stage.release()
