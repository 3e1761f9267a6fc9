"""Half floats are those that numpy finds."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.formats.half_floats import OVERFLOW, extremes, half_floats


def same(values: np.ndarray) -> bool:
    """Whether all bits of the half floats of numbers are those that numpy finds."""
    found = half_floats(values)
    assert found.shape == values.shape
    assert found.dtype == np.float16
    return bool((found.view(np.uint16) == values.astype(np.float16).view(np.uint16)).all())


def test_every_half_float_and_what_lies_between_two_is_rounded_as_numpy_does() -> None:
    every = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    here = every[np.isfinite(every)]
    low = here[here < here.max()]
    between = (low.astype(np.float32) + np.nextafter(low, here.max())) / np.float32(2)
    beside = [np.nextafter(between, np.float32(end)) for end in (-np.inf, np.inf)]
    assert same(here.astype(np.float32))
    assert all(same(values) for values in (between, *beside))
    assert same(np.float32([OVERFLOW, -OVERFLOW]) - np.float32([0.01, -0.01]))


def test_numbers_of_any_size_are_rounded_as_numpy_does() -> None:
    bits = np.random.default_rng(1).integers(0, 1 << 32, 1 << 20, dtype=np.uint32)
    values = bits.view(np.float32)
    assert same(values[np.abs(values) < OVERFLOW])


@pytest.mark.parametrize("shape", [(0, 4), (1, 1), (181, 182), (300, 200, 5)])
def test_arrays_of_any_shape_are_taken(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(2).normal(0.0, 1e-3, shape).astype(np.float32)
    assert same(values)
    assert same(values.swapaxes(0, 1))


@pytest.mark.parametrize("ends", [(-3.0, 2.0), (1e-7, 0.25), (-5.0, -6e-8), (0.0, 0.0)])
def test_extremes_are_the_least_and_the_greatest(ends: tuple[float, float]) -> None:
    values = np.random.default_rng(3).uniform(*ends, (40, 50)).astype(np.float16)
    assert extremes(values) == (values.min(), values.max())
    assert all(one.dtype == np.float16 for one in extremes(values))
