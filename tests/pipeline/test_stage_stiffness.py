"""A painted stiffness in every method, model and sampling, against the reference."""

from __future__ import annotations

import tracemalloc
from itertools import product

import numpy as np
import pytest

from meshes import deform
from pipeline.scenes import DEPTH, MODELS, random_graph, settings_of, sheet
from pipeline.stiff_scenes import SAMPLINGS, StiffScene, painted, window
from reference import stiffness as reference
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.pipeline import stiffness as stage
from rhytid.pipeline.stiffness import stiffness_of_elements, stiffness_of_texels

GRAPH = random_graph(21, 240)
CHOICES = {
    "paper": {},
    "one": {"count": 1, "samples": 5, "bits": 16},
    "mellow": {"count": 8, "merge": "mellow", "depth_factored": True, "r_max": 0.1},
    "factored": {"samples": 7, "depth_factored": True, "r_max": 0.1},
    "best": {
        "pore_samples": 7,
        "merge": "soft",
        "depth_factored": True,
        "tilt": True,
        "reach": 1.5,
    },
    "signed": {"count": 2, "merge": "signed", "depth_factored": True, "tilt": True, "bits": 16},
}


def scene(device, stiffness, bins=None, graph=GRAPH, **more):
    return StiffScene(device, sheet(), graph, settings_of(bins=bins or {}), stiffness, **more)


def bent(made, amount=0.15):
    return deform(made.mesh.positions, 5, amount)


@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("model", MODELS)
def test_redrawn_maps_are_those_of_double(device, model, sampling):
    made = scene(device, painted())
    points, place = window()
    wanted = made.expected_redraw(points, bent(made), model, sampling).reshape(64, 64)
    found = made.redrawn_by(bent(made), model, sampling)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found[place] - wanted).max() <= 1e-4 * DEPTH
    assert np.abs(found - scene(device, None).redrawn_by(bent(made), model, sampling)).max() > (
        0.05 * DEPTH
    )


def cases():
    """Every choice with every sampling and model; the references take their time."""
    for number, (name, sampling) in enumerate(product(CHOICES, SAMPLINGS)):
        quick = name in ("best", "paper") or (name, sampling) == ("mellow", "nearest")
        for model in MODELS:
            one = model == list(MODELS)[number // 2 % len(MODELS)]
            marks = () if quick and one else pytest.mark.slow
            named = f"{name}-{sampling}-{model}"
            yield pytest.param(CHOICES[name], sampling, model, id=named, marks=marks)


@pytest.mark.parametrize(("choice", "sampling", "model"), list(cases()))
def test_blended_tiles_are_those_of_double(device, choice, sampling, model):
    made = scene(device, painted(), choice)
    wanted, sure = made.expected_blend(bent(made), model, sampling)
    found = made.blended_by(bent(made), model, sampling)
    assert sure.mean() > 0.98
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted)[sure].max() <= 2e-4 * DEPTH


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_what_is_rigid_is_drawn_as_the_neutral(device, sampling):
    made = scene(device, Stiffness({1001: np.zeros((1, 1))}))
    for model in MODELS:
        same = [made.redrawn_by(p, model, sampling) for p in (None, bent(made, 0.4))]
        np.testing.assert_array_equal(*same)
        blended = [made.blended_by(p, model, sampling) for p in (None, bent(made, 0.4))]
        np.testing.assert_array_equal(*blended)


@pytest.mark.parametrize(
    "sampling",
    [SAMPLINGS[0], *(pytest.param(more, marks=pytest.mark.slow) for more in SAMPLINGS[1:])],
)
@pytest.mark.parametrize(
    "maps",
    [
        {1001: np.ones((3, 4))},
        *(pytest.param(more, marks=pytest.mark.slow) for more in ({}, {1002: np.zeros((3, 4))})),
    ],
)
def test_a_stiffness_of_1_changes_no_bit(device, maps, sampling):
    made, plain = scene(device, Stiffness(maps)), scene(device, None)
    for model in MODELS:
        for draw in ("redrawn_by", "blended_by"):
            found, wanted = (getattr(s, draw)(bent(s), model, sampling) for s in (made, plain))
            np.testing.assert_array_equal(found, wanted)


def test_stiffness_acts_after_the_clamp(device):
    """Halved after the clamp, a stretch beyond it is half the limit, not the limit."""
    half = Stiffness({1001: np.full((2, 2), 0.5)})
    made, clamped = (
        StiffScene(
            device, sheet(), GRAPH,
            settings_of(response={"log_stretch_limit": limit}, bins={"r_max": 0.01}), stiffness,
        )
        for limit, stiffness in ((0.02, half), (0.01, None))
    )  # fmt: skip
    grown = 3.0 * made.mesh.positions  # everywhere beyond both limits
    found, wanted = (s.redrawn_by(grown, "tensor", "nearest") for s in (made, clamped))
    np.testing.assert_allclose(found, wanted, atol=1e-5 * DEPTH, rtol=0)


@pytest.mark.parametrize("udims", [1, 2])
def test_elements_take_it_on_the_skin_that_moves_them(device, udims):
    """Beyond a border of a chart the closest point of the triangle counts, in its UDIM."""
    mesh = sheet(udims=udims)
    made = painted(udims=(1001, 1002, 1012))
    rng = np.random.default_rng(4)
    triangle = rng.integers(-1, len(mesh.faces), 600)
    corners = mesh.triangle_uv()[triangle]
    inside = np.einsum("pk,pkd->pd", rng.dirichlet((2, 2, 2), 600), corners)
    moved = inside + rng.uniform(-0.1, 0.1, (600, 2))
    uv = np.where(rng.uniform(size=(600, 1)) < 0.5, inside, moved).astype(np.float32)
    held = np.where(triangle < 0, len(mesh.faces), triangle).astype(np.int32)
    found = stiffness_of_elements(made, mesh, uv, held)
    wanted = reference.at_elements(made.maps, uv, triangle, mesh.triangle_uv())
    assert len(np.unique(wanted)) > 250
    np.testing.assert_allclose(found, wanted, atol=1e-6, rtol=0)


def square(low, high):
    """Two triangles whose UV fill [low, high]²."""
    uv = np.array([[low, low], [high, low], [high, high], [low, high]])
    faces = [[0, 1, 2], [0, 2, 3]]
    return Mesh(np.c_[uv, np.zeros(4)], faces, uv, faces)


@pytest.mark.parametrize("slack", [0.0, 5e-7])
def test_a_chart_that_ends_on_a_border_is_of_its_own_udim(slack):
    """Beyond every border of [0, 1]² the skin is still that of 1001, and beyond [1, 2]² of 1012."""
    beyond = np.array([[1.004, 0.5], [0.5, 1.004], [1.2, 1.3], [-0.004, 0.5], [0.5, -0.1]])
    made = Stiffness({udim: np.full((1, 1), udim / 2000) for udim in (1001, 1002, 1011, 1012)})
    for udim, low, sign in ((1001, 0.0, 1), (1012, 1.0, 1), (1012, 1.0, -1)):
        uv = np.float32(low + 0.5 + sign * (beyond - 0.5))
        mesh = square(low - slack, low + 1 + slack)
        for triangle in (np.zeros(5, np.int32), np.ones(5, np.int32)):
            found = stiffness_of_elements(made, mesh, uv, triangle)
            np.testing.assert_array_equal(found, np.float32(udim / 2000))
            wanted = reference.at_elements(made.maps, uv, triangle, mesh.triangle_uv())
            np.testing.assert_allclose(found, wanted, atol=1e-6, rtol=0)


def test_a_triangle_over_a_border_takes_both_maps():
    made = Stiffness({1001: np.full((1, 1), 0.25), 1002: np.full((1, 1), 0.75)})
    uv = np.array([[0.9, 0.1], [1.1, 0.1]], np.float32)
    found = stiffness_of_elements(made, square(0.0, 1.5), uv, np.zeros(2, np.int32))
    np.testing.assert_array_equal(found, [0.25, 0.75])


def test_many_elements_take_no_more_memory_than_some(monkeypatch):
    monkeypatch.setattr(stage, "_AT_ONCE", 1000)
    mesh, made, rng = sheet(), painted(), np.random.default_rng(5)
    uv = rng.uniform(-0.1, 1.1, (1500, 2)).astype(np.float32)
    triangle = rng.integers(0, len(mesh.faces) + 1, 1500, np.int32)
    some = np.concatenate([
        stiffness_of_elements(made, mesh, uv[part], triangle[part])
        for part in (slice(700), slice(700, None))
    ])  # fmt: skip
    many = np.tile(uv, (40, 1)), np.tile(triangle, 40)
    tracemalloc.start()
    found = stiffness_of_elements(made, mesh, *many)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(found, np.tile(some, 40))
    assert peak < 1e6  # all of the corners alone are 2.9 MB


def test_the_smallest_level_has_room_for_a_vector(device):
    made = Stiffness({1001: np.full((1, 1), 0.25)})
    buffer = stiffness_of_texels(device, made, 1001, 1, 0, 0, 1)
    np.testing.assert_array_equal(device.read(buffer, (16,), np.float32), 0.25)
