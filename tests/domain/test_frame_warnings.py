"""What a frame is warned of, on both sides of every limit."""

from __future__ import annotations

import numpy as np
import pytest

import face_data
from meshes import SmallMesh, deform
from reference.stretch import stretch
from rhytid.domain import warnings as limits
from rhytid.domain.frame import check_positions
from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import FrameCheck
from rhytid_lab.samples.face import procedural_face
from rhytid_lab.samples.sphere import SPHERE_STRETCHES, sphere, sphere_stretch

SAMPLE = procedural_face(32)
CHECK = FrameCheck(SAMPLE.mesh, "cm")
NEUTRAL = SAMPLE.mesh.positions


def codes(positions: np.ndarray, check: FrameCheck = CHECK) -> list[str]:
    return [w.code for w in check.warnings(np.float32(positions), "frame x")]


def test_log_stretch_is_that_of_the_reference(small_mesh: SmallMesh) -> None:
    moved = deform(small_mesh.positions, 2, 0.3)
    found = FrameCheck(Mesh(*small_mesh), "cm").log_stretch(moved)
    wanted, _ = stretch(*small_mesh, moved)
    np.testing.assert_allclose(found, np.log(wanted), atol=1e-9)


def test_a_collapsed_frame_is_at_the_clamp() -> None:
    assert codes(np.zeros_like(NEUTRAL) + 1) == [limits.FRAME_SCALED]
    assert codes(NEUTRAL * [1, 0, 1e-9]) == [limits.STRETCH_AT_CLAMP]


@pytest.mark.parametrize("name", SAMPLE.expressions)
def test_expressions_are_as_they_should_be(name: str) -> None:
    assert codes(SAMPLE.pose({name: 1.0})) == []


def test_the_neutral_itself_and_rigid_motions_are() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    assert codes(NEUTRAL) == codes(NEUTRAL @ turn + 40.0) == []


@pytest.mark.parametrize("name", SPHERE_STRETCHES)
def test_stretched_spheres_are(name: str) -> None:
    """Stretched by 1.25 in all directions at the centre: skin, for a test, and no wrong unit."""
    mesh = sphere(64)
    assert codes(sphere_stretch(mesh, *SPHERE_STRETCHES[name]), FrameCheck(mesh, "cm")) == []


def test_shuffled_vertices() -> None:
    order = np.random.default_rng(1).permutation(len(NEUTRAL))
    assert codes(SAMPLE.pose({"smile": 1.0})[order]) == [limits.STRETCH_AT_CLAMP]


def test_a_frame_of_another_mesh() -> None:
    other = sphere(96).positions[: len(NEUTRAL)] * 2
    assert codes(other) == [limits.STRETCH_AT_CLAMP]


def test_a_factor_of_units_that_are_not_the_neutrals() -> None:
    (found,) = CHECK.warnings(np.float32(NEUTRAL * 100.0), "frame x")
    assert (
        "100 times as large, as one length has in cm and in m; multiply it by 0.01" in found.detail
    )
    assert "looks like" not in found.detail


@pytest.mark.parametrize(("size", "warned"), [(0.95, False), (1.05, True)])
def test_the_median_near_the_clamp(size: float, warned: bool) -> None:
    """Stretched one way and compressed the other, by as much."""
    flat = sphere(32)
    sheet = Mesh(flat.positions * [1, 1, 1e-4], flat.faces, flat.uv, flat.face_uv)
    factor = np.exp(size * limits.CLAMP_MEDIAN)
    moved = sheet.positions * [factor, 1 / factor, 1]
    found = codes(moved, FrameCheck(sheet, "cm"))
    assert found == ([limits.STRETCH_AT_CLAMP] if warned else [])


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.01, "m beside"), (10.0, "mm beside"), (1 / 2.54, "in beside"), (1 / 30.48, "ft beside")],
)
@pytest.mark.parametrize("name", [None, "smile", "jaw_open"])
def test_another_unit(factor: float, said: str, name: str | None) -> None:
    """With an expression on top, and so shaped as no multiple of the neutral."""
    pose = SAMPLE.pose({name: 1.0} if name else {})
    (found,) = CHECK.warnings(np.float32(pose * factor), "frame x")
    assert found.code == limits.FRAME_SCALED
    assert f"looks like {said} a neutral in cm" in found.detail
    assert found.where == "frame x"


@pytest.mark.parametrize(("size", "warned"), [(0.9, False), (1.1, True), (-1.1, True)])
def test_a_scale_of_no_unit(size: float, warned: bool) -> None:
    scaled = NEUTRAL * np.exp(size * limits.SCALED_MEDIAN)
    assert codes(scaled) == ([limits.FRAME_SCALED] if warned else [])


@pytest.mark.parametrize(("factor", "warned"), [(0.8, True), (1.25, False)])
def test_a_scale_that_is_not_even(factor: float, warned: bool) -> None:
    """Stretched less along x than along y: no scale once they differ by a third of either."""
    spread = factor * 0.2 / (limits.SCALED_SPREADS + 0.5)  # of the median, the lower end
    flat = sphere(64)
    sheet = Mesh(flat.positions * [1, 1, 1e-4], flat.faces, flat.uv, flat.face_uv)
    moved = sheet.positions * [np.exp(0.2 - spread / 2), np.exp(0.2 + spread / 2), 1]
    found = codes(moved, FrameCheck(sheet, "cm"))
    assert found == ([limits.FRAME_SCALED] if warned else [])


def test_frames_far_from_their_neutral() -> None:
    assert codes(NEUTRAL + np.array([200.0, 0, 0])) == []
    assert codes(NEUTRAL + np.array([1e5, 0, 0])) == [limits.FAR_FROM_ORIGIN]


def test_float32_frames_of_a_neutral_in_doubles() -> None:
    """The centre brings them to the origin; what they have lost shows all the same."""
    moved = NEUTRAL.astype(np.float64) * (1 + 1e-9) + [1e5, 7.0, 0]
    mesh = Mesh.centred(moved, SAMPLE.mesh.faces, SAMPLE.mesh.uv, SAMPLE.mesh.face_uv)
    check = FrameCheck(mesh, "cm")
    smile = SAMPLE.pose({"smile": 1.0}).astype(np.float64) * (1 + 1e-9) + [1e5, 7.0, 0]
    assert codes(check_positions(smile, len(smile), mesh.centre), check) == []
    rounded = check_positions(smile.astype(np.float32), len(smile), mesh.centre)
    assert codes(rounded, check) == [limits.FAR_FROM_ORIGIN]


def test_frames_of_a_neutral_that_is_far_are_not_told_of_again() -> None:
    far = (NEUTRAL + np.array([1e5, 0, 0])).astype(np.float32)
    mesh = Mesh(far, SAMPLE.mesh.faces, SAMPLE.mesh.uv, SAMPLE.mesh.face_uv)
    assert codes(far, FrameCheck(mesh, "cm")) == []


@pytest.mark.face
def test_the_real_face_moves_as_it_should(face: face_data.Face) -> None:
    """Every expression, every composite and 310 captured frames."""
    check = FrameCheck(Mesh(face.positions, face.faces, face.uv, face.face_uv), "cm")
    frames = {name: face.expression(name) for name in face.expression_names}
    frames |= {name: face.composite(name) for name in face.composites}
    frames |= {str(i): face.captured(i) for i in range(0, 4030, 13)}
    assert len(frames) == 53 + 14 + 310
    assert {n: w for n, p in frames.items() if (w := check.warnings(p, n))} == {}
    medians = [np.median(np.abs(check.log_stretch(p))) for p in frames.values()]
    assert max(medians) < 0.25 * limits.CLAMP_MEDIAN


@pytest.mark.face
@pytest.mark.parametrize(
    ("factor", "code"), [(0.01, limits.FRAME_SCALED), (None, limits.STRETCH_AT_CLAMP)]
)
def test_the_real_face_wrong(face: face_data.Face, factor: float | None, code: str) -> None:
    check = FrameCheck(Mesh(face.positions, face.faces, face.uv, face.face_uv), "cm")
    order = np.random.default_rng(1).permutation(len(face.positions))
    smile = face.composite("big_smile")
    assert codes(smile[order] if factor is None else smile * factor, check) == [code]


@pytest.mark.parametrize(("factor", "warned"), [(0.97, True), (1.03, False)])
def test_a_frame_to_calibrate_by_must_stretch_the_skin(factor: float, warned: bool) -> None:
    moved = NEUTRAL * np.exp(factor * limits.STILL_STRETCH)
    found = CHECK.calibration_warnings(np.float32(moved), "frame x")
    assert [w.code for w in found] == [limits.CALIBRATION_STILL] * warned
    assert codes(moved) == []
