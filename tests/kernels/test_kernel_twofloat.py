"""Two-float arithmetic against exact fractions."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import isqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kernels.one_line import evaluate
from rhytid.device.runtime import Device

BOUND = Fraction(1, 2**43)
# Two inputs.
A, B = "tf_of(a.x, a.y)", "tf_of(b.x, b.y)"
# Far from under- and overflow of the low part: the kernels scale their lengths to near 1.
signed = st.builds(
    lambda m, e, sign: sign * m * 2.0**e,
    st.floats(1.0, 2.0),
    st.integers(-20, 20),
    st.sampled_from([-1.0, 1.0]),
)


def two_parts(values: list[float]) -> np.ndarray:
    """(n, 2) high and low parts of doubles."""
    high = np.array(values).astype(np.float32)
    return np.stack([high, (np.array(values) - high).astype(np.float32)], axis=1)


def both_parts(call: str) -> str:
    """The twofloat that a call answers, as a vector."""
    return f"(float2)({call}.x, {call}.y)"


def exact(row: np.ndarray) -> Fraction:
    return Fraction(float(row[0])) + Fraction(float(row[1]))


def root(value: Fraction) -> Fraction:
    """The square root to 60 bits more than a twofloat has."""
    scaled = value * 4**108
    return Fraction(isqrt(scaled.numerator // scaled.denominator), 2**108)


def largest_error(
    device: Device, call: str, truth: Callable[..., Fraction], *columns: list
) -> None:
    parts = dict(zip("ab", map(two_parts, columns), strict=False))
    found = evaluate(device, "twofloat", both_parts(call), parts, width=2)
    for i, row in enumerate(found):
        wanted = truth(*(exact(column[i]) for column in parts.values()))
        assert abs(exact(row) - wanted) <= BOUND * abs(wanted), (call, i)


@pytest.mark.parametrize(
    ("call", "truth"),
    [
        (f"tf_add({A}, {B})", lambda a, b: a + b),
        (f"tf_sub({A}, {B})", lambda a, b: a - b),
        (f"tf_mul({A}, {B})", lambda a, b: a * b),
        (f"tf_div({A}, {B})", lambda a, b: a / b),
    ],
)
def test_operations_are_exact_to_43_bits(device, call, truth):
    rng = np.random.default_rng(1)
    a, b = rng.uniform(1, 2, (2, 4000)) * 2.0 ** rng.integers(-20, 20, (2, 4000))
    a *= rng.choice([-1, 1], 4000)
    b[::4] = -a[::4] * (1 + 2.0 ** -rng.integers(8, 40, 1000))  # sums that cancel
    largest_error(device, call, truth, list(a), list(b))


def test_square_root_is_exact_to_43_bits(device):
    rng = np.random.default_rng(2)
    largest_error(device, f"tf_sqrt({A})", root, list(rng.uniform(1, 4, 4000) * 4.0**-9))


def test_square_root_of_nothing_is_nothing(device):
    parts = {"a": two_parts([0.0, -0.0, -3.0])}
    found = evaluate(device, "twofloat", both_parts(f"tf_sqrt({A})"), parts, width=2)
    np.testing.assert_array_equal(found, 0.0)


@given(a=signed, b=signed)
def test_a_sum_and_a_product_of_floats_lose_nothing(device, a, b):
    inputs = {"a": np.array([a], np.float32), "b": np.array([b], np.float32)}
    x, y = (Fraction(float(value[0])) for value in inputs.values())
    for call, wanted in (("tf_sum(a, b)", x + y), ("tf_product(a, b)", x * y)):
        assert exact(evaluate(device, "twofloat", both_parts(call), inputs, width=2)[0]) == wanted
