"""Singular values and vectors of a deformation gradient against numpy's SVD in double."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate

GRADIENT = "(gradient_t){g.x, g.y, g.z}"
EXPONENT = "edge_exponent(point_of(p), point_of(q), point_of(r))"


def both(function: str) -> str:
    """The pair that a function of a gradient answers, as a vector."""
    return f"(float2)({function}({GRADIENT}).x, {function}({GRADIENT}).y)"


def gradients(kind: str, count: int = 4000) -> np.ndarray:
    """(n, 3) float32 rows f11, f12, f22 with f11, f22 >= 0, as lengths and heights are."""
    rng = np.random.default_rng(3)
    g = rng.uniform(0, 2, (count, 3)) * (1, rng.choice([-1, 1]), 1)
    if kind == "slivers":  # sheared and squeezed over ten decades each
        g *= 10.0 ** rng.uniform(-5, 5, (count, 3))
    if kind == "extremes":
        g *= 10.0 ** rng.choice([-15.0, 15.0], (count, 1))
    if kind == "nearly rigid":
        g = np.array([1, 0, 1]) + rng.uniform(-1, 1, (count, 3)) * 1e-6
    return g.astype(np.float32)


def svd(g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) singular values, the second from the determinant, and (n, 2) first right vectors."""
    f11, f12, f22 = g.astype(np.float64).T
    matrix = np.stack([f11, f12, 0 * f11, f22], axis=1).reshape(-1, 2, 2)
    _, values, right = np.linalg.svd(matrix)
    return np.stack([values[:, 0], f11 * f22 / values[:, 0]], axis=1), right[:, 0]


KINDS = ("plain", "slivers", "extremes", "nearly rigid")


@pytest.mark.parametrize("kind", KINDS)
def test_singular_values_are_exact_to_1e_6(device, kind):
    g = gradients(kind)
    found = evaluate(device, "stretch", both("singular_values"), {"g": g}, width=2)
    assert np.abs(found / svd(g)[0] - 1).max() <= 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_right_singular_vector_is_as_exact_as_its_gap_allows(device, kind):
    # An error e of the entries turns the vector by e ρ₁² / (ρ₁² - ρ₂²) at most.
    g = gradients(kind)
    found = evaluate(device, "stretch", both("right_singular_vector"), {"g": g}, width=2)
    values, wanted = svd(g)
    sine = np.abs(found[:, 0] * wanted[:, 1] - found[:, 1] * wanted[:, 0])
    gap = 1 - np.square(values[:, 1] / values[:, 0])
    assert (sine * gap).max() <= 1e-6
    np.testing.assert_allclose(np.hypot(*found.T), 1, rtol=3e-7)


def test_a_triangle_that_collapses_to_a_line_or_a_point(device):
    g = np.array([[0, 3, 0], [0, 0, 2], [2, 0, 0], [3, 4, 0], [0, 0, 0]], np.float32)
    found = evaluate(device, "stretch", both("singular_values"), {"g": g}, width=2)
    np.testing.assert_allclose(found, [[3, 0], [2, 0], [2, 0], [5, 0], [0, 0]], rtol=1e-6)
    vector = evaluate(device, "stretch", both("right_singular_vector"), {"g": g}, width=2)
    along = np.array([[0, 1], [0, 1], [1, 0], [0.6, 0.8], [1, 0]])
    np.testing.assert_allclose(np.abs(vector), along, atol=1e-6)


def test_edge_exponent_brings_the_longest_edge_near_one(device):
    rng = np.random.default_rng(4)
    p, q, r = rng.uniform(-1, 1, (3, 500, 3)) * 10.0 ** rng.uniform(-18, 18, (500, 1))
    points = {"p": p.astype(np.float32), "q": q.astype(np.float32), "r": r.astype(np.float32)}
    exponent = evaluate(device, "stretch", EXPONENT, points, np.int32)
    longest = np.maximum(np.abs(q - p), np.abs(r - p)).max(axis=1)
    scaled = np.ldexp(longest, exponent)
    assert (scaled >= 1.99).all()
    assert (scaled <= 4.01).all()


def test_edge_exponent_of_a_point_is_none(device):
    point = np.full((1, 3), 7.5, np.float32)
    points = {"p": point, "q": point, "r": point}
    assert evaluate(device, "stretch", EXPONENT, points, np.int32)[0] == 0
