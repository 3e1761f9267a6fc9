"""bounded_exp2 against powers of two in double."""

from __future__ import annotations

import numpy as np

from kernels.one_line import evaluate


def powers(device, y):
    return evaluate(device, "exponential", "bounded_exp2(y)", {"y": y.reshape(-1, 8)}, width=8)


def test_relative_error_stays_below_its_bound(device):
    fine = np.linspace(0, 1.5, 8 * 4000, dtype=np.float32)
    whole = np.linspace(0, 126.99, 8 * 40000, dtype=np.float32)
    for y in (fine, whole):
        error = np.abs(powers(device, y).ravel() / np.exp2(y.astype(np.float64)) - 1)
        assert error.max() <= 1e-7


def test_nothing_drawn_adds_exactly_nothing(device):
    np.testing.assert_array_equal(powers(device, np.array([0.0, -0.0] * 4, np.float32)), 1.0)


def test_whole_powers_are_exact(device):
    y = np.arange(120, dtype=np.float32)
    np.testing.assert_array_equal(powers(device, y).ravel(), np.exp2(y))


def test_every_lane_gives_the_same_bits(device):
    y = np.random.default_rng(1).uniform(0, 126, 8 * 500).astype(np.float32)
    straight, turned = powers(device, y).ravel(), powers(device, np.roll(y, 3)).ravel()
    np.testing.assert_array_equal(np.roll(straight, 3), turned)
