"""Smooth sampling's helpers: weights in a triangle, and the generalised eigenproblem."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate
from reference.smooth import barycentric, principal
from rhytid.pipeline.uv_vertices import LEAST_SPEED2

LIMIT = 0.5
COUNT = 2000
FIELD = "(field_t){{g.x, g.y, g.z}, {h.x, h.y, h.z}}"
PRINCIPAL = f"principal({FIELD}, {LIMIT}f)"


def turns(rng):
    """(n, 2, 2) rotations."""
    c, s = np.cos(angle := rng.uniform(0, 2 * np.pi, COUNT)), np.sin(angle)
    return np.stack([c, -s, s, c], axis=1).reshape(-1, 2, 2)


def fields(aspect, logs=None, seed=1):
    """G and H (n, 3) float32: rows uu, uv, vv, of UV that are sheared by `aspect`."""
    rng = np.random.default_rng(seed)
    j = turns(rng) * [1.0, 1.0 / aspect] @ turns(rng) * 10.0 ** rng.uniform(-6, 6, (COUNT, 1, 1))
    logs = rng.uniform(-0.99 * LIMIT, 0.99 * LIMIT, (COUNT, 2)) if logs is None else logs
    q = turns(rng)
    plane = q * logs[:, None, :] @ np.swapaxes(q, 1, 2)
    return [packed(np.swapaxes(j, 1, 2) @ form @ j) for form in (np.eye(2), plane)]


def packed(form):
    return np.stack([form[:, 0, 0], form[:, 0, 1], form[:, 1, 1]], axis=1).astype(np.float32)


def matrix(form):
    return form[:, [0, 1, 1, 2]].astype(np.float64).reshape(-1, 2, 2)


def solved(device, g, h):
    """log ρ (n, 2) and axes (n, 2, 2)."""
    names = ("log1", "log2", "u1", "v1", "u2", "v2")
    inputs = {"g": g, "h": h}
    every = ", ".join(f"{PRINCIPAL}.{name}" for name in names)
    found = evaluate(device, "smooth", f"(float8)({every}, 0, 0)", inputs, width=8)
    return found[:, :2], found[:, 2:6].reshape(-1, 2, 2)


@pytest.mark.parametrize("aspect", [1.0, 3.0, 30.0])
def test_principal_stretches_are_those_of_double(device, aspect):
    # The entries of H are known to 2^-24 of their size: K to that times the aspect squared.
    g, h = fields(aspect)
    logs, axes = solved(device, g, h)
    wanted, directions = principal(matrix(g), matrix(h))
    bound = 4 * 2.0**-24 * aspect**2
    assert np.abs(logs - wanted).max() <= bound
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, rtol=5e-7)
    sine = axes[..., 0] * directions[..., 1] - axes[..., 1] * directions[..., 0]
    gap = wanted[:, 0] - wanted[:, 1]
    assert (np.abs(sine).max(axis=1) * gap).max() <= bound * aspect


@pytest.mark.parametrize("aspect", [1.0, 3.0, 100.0])
def test_an_even_stretch_is_exact_however_sheared_the_uv(device, aspect):
    even = np.linspace(-0.49, 0.49, COUNT)
    g, _ = fields(aspect)
    logs, axes = solved(device, g, (g * even[:, None]).astype(np.float32))
    assert np.abs(logs - even[:, None]).max() <= 4 * 2.0**-24 * aspect**2 * 0.5
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, rtol=5e-7)


def test_no_stretch_is_exactly_zero_even_where_the_metric_is_singular(device):
    g, h = fields(10.0, np.zeros((COUNT, 2)))
    g[:3] = [[1, 0, 0], [0, 0, 1], [1, 1, 1]]
    logs, axes = solved(device, g, h)
    np.testing.assert_array_equal(logs, 0.0)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=-1), 1, rtol=5e-7)


def test_a_diagonal_stretch_in_the_unit_metric_has_the_axes_of_uv(device):
    rng = np.random.default_rng(2)
    r = rng.uniform(-LIMIT, LIMIT, (COUNT, 2)).astype(np.float32)
    g = np.tile(np.array([1, 0, 1], np.float32), (COUNT, 1))
    h = np.stack([r[:, 0], np.zeros(COUNT, np.float32), r[:, 1]], axis=1)
    logs, axes = solved(device, g, h)
    np.testing.assert_allclose(logs, np.sort(r)[:, ::-1], atol=2.0**-24, rtol=0)
    along_u = (r[:, 0] > r[:, 1]).astype(np.float32)
    np.testing.assert_allclose(np.abs(axes[:, 0, 0]), along_u, atol=1e-6)
    np.testing.assert_allclose(np.abs(axes[:, 1, 0]), 1 - along_u, atol=1e-6)


def test_stretch_stays_within_the_limit(device):
    g, h = fields(1e4, np.full((COUNT, 2), 3.0))
    logs, _ = solved(device, g, h)
    assert np.abs(logs).max() <= LIMIT


def places(device, triangles, points):
    """(n, 3) weights of points (n, 2) in triangles (n, 3, 2)."""
    a, b, c = (triangles[:, k].astype(np.float32) for k in range(3))
    inputs = {"a": a, "b": b, "c": c, "p": points.astype(np.float32)}
    place = "place_in(b - a, c - a, p.x - a.x, p.y - a.y, 1)"
    found = [evaluate(device, "smooth", f"{place}.{name}", inputs) for name in ("b", "c")]
    return np.stack([1 - found[0] - found[1], *found], axis=1)


def test_weights_of_points_inside_and_outside_are_those_of_double(device):
    rng = np.random.default_rng(3)
    triangles = rng.uniform(0, 1, (COUNT, 3, 2)).astype(np.float32).astype(np.float64)
    points = rng.uniform(-0.5, 1.5, (COUNT, 2)).astype(np.float32).astype(np.float64)
    wanted = barycentric(points, triangles)
    found = places(device, triangles, points)
    # A weight is an area over the triangle's: it is known as well as the area is.
    u, w = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.abs(u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])
    size = np.linalg.norm(points[:, None] - triangles, axis=-1).max(axis=1)
    assert (np.abs(found - wanted).max(axis=1) * area / size).max() <= 2e-6
    assert found.min() >= -1e-6
    assert 0.05 < (wanted > 0).all(axis=1).mean() < 0.5


def test_a_triangle_without_area_has_weights_too(device):
    triangles = np.array([[[0, 0], [1, 0], [2, 0]], [[1, 1], [1, 1], [1, 1]]], float)
    found = places(device, triangles, np.array([[0.5, 1.0], [0.0, 0.0]]))
    feet = np.einsum("nk,nkx->nx", found, triangles)
    np.testing.assert_allclose(feet, [[0.5, 0.0], [1.0, 1.0]], atol=1e-6)


def test_the_least_metric_is_the_one_that_aprons_reckon_with(device):
    once = {"i_": np.zeros(1, np.int32)}
    assert evaluate(device, "smooth", "LEAST_DETERMINANT", once)[0] == np.float32(LEAST_SPEED2)
