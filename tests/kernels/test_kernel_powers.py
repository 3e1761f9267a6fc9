"""Powers of two and their logarithms in every width that kernels take, against double."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate

# Where a width is made, and with which defines: (helper, options, width, suffix of the names).
WIDTHS = {
    "one": ("response", ("-DSCALE_LIMIT=4.0f",), 1, ""),
    "eight": ("draw", ("-DBLOCK=64", "-DROWS=64", "-DITEMS=8"), 8, "8"),
    "sixteen": ("merge", ("-DMERGE=MELLOW", "-DCODE_BITS=8"), 16, "16"),
}


@pytest.fixture(params=WIDTHS)
def power(device, request):
    return function(device, "power", *WIDTHS[request.param])


@pytest.fixture(params=("eight", "sixteen"))
def logarithm(device, request):
    return function(device, "logarithm", *WIDTHS[request.param])


def function(device, name, helper, options, width, suffix):
    def of(values):
        rows = np.asarray(values, np.float32).reshape(-1, *([width] if width > 1 else []))
        call = f"{name}{suffix}(y)"
        return evaluate(device, helper, call, {"y": rows}, width=width, options=options).ravel()

    return of


def test_powers_are_within_their_bound(power):
    y = np.concatenate([np.linspace(-3, 3, 16 * 4000), np.linspace(-125.9, 126.9, 16 * 9000)])
    y = y.astype(np.float32)
    error = np.abs(power(y) / np.exp2(y.astype(np.float64)) - 1)
    assert error.max() <= 1e-7


def test_whole_powers_are_exact(power):
    y = np.arange(-120, 120, dtype=np.float32)
    np.testing.assert_array_equal(power(y), np.exp2(y))
    np.testing.assert_array_equal(power(np.array([0.0, -0.0] * 8)), 1.0)


def test_logarithms_are_within_their_bound(logarithm):
    x = np.exp2(np.linspace(-125.9, 126.9, 16 * 2000))
    x = np.concatenate([x, np.linspace(0.5, 2, 16 * 2000)]).astype(np.float32)
    exact = np.log2(x.astype(np.float64))
    assert (np.abs(logarithm(x) - exact) <= 6e-7 + 1e-7 * np.abs(exact)).all()


def test_the_logarithm_of_one_is_nothing(logarithm):
    np.testing.assert_array_equal(logarithm(np.ones(16)), 0.0)


def test_every_lane_of_every_width_gives_the_same_bits(device):
    y = np.random.default_rng(1).uniform(-100, 100, 16 * 500).astype(np.float32)
    straight = function(device, "power", *WIDTHS["one"])(y)
    for width in WIDTHS.values():
        turned = function(device, "power", *width)(np.roll(y, 3))
        np.testing.assert_array_equal(np.roll(straight, 3), turned)
