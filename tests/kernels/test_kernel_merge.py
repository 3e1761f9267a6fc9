"""The merges of merge.clh, one line at a time."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.one_line import evaluate

WIDTH = 16


def lanes(values):
    return np.resize(values, (len(values) // WIDTH + 1, WIDTH)).astype(np.float32)


def soft(device, *heights, more=()):
    """Of heights in units of 4 log(2)/beta, in order."""
    inputs = {f"h{i}": lanes(h) for i, h in enumerate(heights)}
    merged = "(merge_state_t)NOTHING_MERGED"
    for name in inputs:
        merged = f"accumulate({merged}, {name})"
    options = ["-DMERGE=SOFT", "-DCODE_BITS=8", *more]
    return evaluate(device, "merge", f"height_of({merged})", inputs, width=WIDTH, options=options)


def mellow(*heights):
    """Of the same, in double."""
    power = 4 * np.log(2.0)
    sides = [[np.maximum(s * lanes(h).astype(float), 0) for h in heights] for s in (1, -1)]
    high, low = (np.log1p(sum(np.expm1(power * x) for x in side)) / power for side in sides)
    return high - low


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_lone_height_stays_as_it_is(device, sign):
    height, flat = sign * np.linspace(0, 30, 999), np.zeros(999)
    for order in ((height, flat, flat), (flat, height, flat), (flat, flat, height)):
        np.testing.assert_array_equal(soft(device, *order), lanes(height))


def test_two_soft_valleys_are_near_their_mellow_max_and_equal_ones_at_it(device):
    deep, other = (
        -v.ravel() for v in np.meshgrid(np.linspace(0, 20, 201), np.linspace(0, 20, 201))
    )
    found = soft(device, deep, other)
    np.testing.assert_array_equal(found, soft(device, other, deep))
    error = np.abs(found - mellow(deep, other))
    assert error.max() <= 0.3 / (4 * np.log(2.0))
    assert error[(lanes(deep) == lanes(other)) & (lanes(deep) < -1)].max() <= 0.02
    shallow = np.linspace(-1e-3, 0, 999)
    np.testing.assert_allclose(soft(device, shallow, shallow), 2 * lanes(shallow), rtol=5e-3)


def test_a_soft_merge_does_not_depend_on_the_order(device):
    rng = np.random.default_rng(1)
    heights = rng.uniform(-3, 2, (5, 500))
    found = soft(device, *heights)
    for _ in range(4):
        np.testing.assert_array_equal(soft(device, *rng.permutation(heights)), found)


def test_valleys_alone_merge_to_the_same_bits_without_bulges(device):
    heights = -np.abs(np.random.default_rng(2).normal(0, 1, (5, 500)))
    heights[:, ::5] = 0.0
    found = soft(device, *heights, more=["-DBULGING=0"])
    np.testing.assert_array_equal(found, soft(device, *heights))
