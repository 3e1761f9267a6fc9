"""Positions far from the origin: when a centre is subtracted, and what is left of the numbers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes import SmallMesh, deform
from reference.stretch import stretch
from rhytid.domain.frame import check_positions
from rhytid.domain.mesh import FAR_SIZES, Mesh, add_centre, centre_for, float_step, subtract_centre


def doubles(mesh: SmallMesh, where: float) -> NDArray[np.float64]:
    """The sheet, 2 wide, that many units away; its numbers have more digits than float32."""
    rng = np.random.default_rng(3)
    return mesh.positions * (1 + 1e-9 * rng.random(mesh.positions.shape)) + [where, 0.0, -where / 3]


def test_what_is_near_stays_as_it_is(small_mesh: SmallMesh) -> None:
    near = doubles(small_mesh, 0.99 * FAR_SIZES * 2 - 1)
    assert not centre_for(near).any()
    mesh = Mesh.centred(near, *small_mesh[1:])
    np.testing.assert_array_equal(mesh.positions, near.astype(np.float32))


def test_what_is_far_is_brought_to_the_origin(small_mesh: SmallMesh) -> None:
    far = doubles(small_mesh, 1.01 * FAR_SIZES * 2 + 1)
    centre = centre_for(far)
    mesh = Mesh.centred(far, *small_mesh[1:])
    assert centre.any()
    np.testing.assert_array_equal(mesh.centre, centre)
    assert np.abs(mesh.positions).max() < 2.5
    np.testing.assert_array_equal(mesh.positions, (far - centre).astype(np.float32))


@pytest.mark.parametrize("kind", ["f4", "f8", "text"])
def test_float32_stays_as_it_is(small_mesh: SmallMesh, kind: str) -> None:
    """Rounded already: a centre would bring nothing, and nothing of it may change."""
    sent = (small_mesh.positions + np.float32(5000)).astype("f4" if kind == "f4" else "f8")
    if kind == "text":
        sent = np.array([[float(f"{x:.7g}") for x in row] for row in sent])
        sent = sent.astype(np.float32) + 1e-6
    mesh = Mesh.centred(sent, *small_mesh[1:])
    assert not mesh.centre.any()
    np.testing.assert_array_equal(mesh.positions, sent.astype(np.float32))


@pytest.mark.parametrize("where", [1e4, 1e6, 1e8])
def test_stretch_does_not_depend_on_the_place(small_mesh: SmallMesh, where: float) -> None:
    """At a million units, rounded where they are, ratios were off by 2."""
    moved = deform(small_mesh.positions, 4).astype(np.float64)
    offset = np.array([where, -where / 7, where / 3])
    neutral = small_mesh.positions.astype(np.float64)
    mesh = Mesh.centred(doubles(small_mesh, 0) + offset, *small_mesh[1:])
    frame = check_positions(moved + offset, len(moved), mesh.centre)
    about = (small_mesh.faces, small_mesh.uv, small_mesh.face_uv)
    wanted, _ = stretch(neutral, *about, moved)
    found, _ = stretch(mesh.positions, *about, frame)
    # A double at 1e8 has steps of 1.5e-8; an edge is 0.2.
    np.testing.assert_allclose(found, wanted, atol=3e-6)


def test_positions_come_back_where_they_were(small_mesh: SmallMesh) -> None:
    far = doubles(small_mesh, 12345.678)
    mesh = Mesh.centred(far, *small_mesh[1:])
    np.testing.assert_allclose(add_centre(mesh.positions, mesh.centre), far, rtol=0, atol=2e-7)
    assert add_centre(mesh.positions, np.zeros(3)) is mesh.positions


def test_subtracting_the_centre_from_float32_loses_nothing(small_mesh: SmallMesh) -> None:
    far = doubles(small_mesh, 12345.678)
    centre = centre_for(far)
    sent = far.astype(np.float32)
    np.testing.assert_array_equal(check_positions(sent, len(sent), centre) + centre, sent)


def test_the_step_is_that_of_the_numbers_as_they_were_sent(small_mesh: SmallMesh) -> None:
    far = doubles(small_mesh, 1e6)
    centre = centre_for(far)
    exact = subtract_centre(far, centre).astype(np.float32)
    rounded = subtract_centre(far.astype(np.float32), centre).astype(np.float32)
    assert float_step(rounded, centre) == np.spacing(np.float32(1e6))
    assert float_step(exact, centre) < 2e-7
    assert float_step(far.astype(np.float32), np.zeros(3)) == np.spacing(np.float32(1e6))
