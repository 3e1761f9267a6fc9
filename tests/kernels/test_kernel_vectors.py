"""The triangles of each vector of texels, against a loop over the texels."""

from __future__ import annotations

import numpy as np
import pytest

import rhytid_kernels
from kernels.one_line import evaluate
from rhytid.pipeline.stretch import TRIANGLES
from rhytid.pipeline.vectors import VECTOR, VectorTriangles


def tile(pattern, vectors=50):
    """int32 triangles of the texels: all in one, all apart, runs of some, some in turn."""
    rng, texels = np.random.default_rng(4), vectors * VECTOR
    if pattern == "runs":
        return np.repeat(rng.integers(0, 9, texels), rng.integers(1, 30, texels))[:texels]
    choices = {"one": 1, "few": 3, "many": 10**9}
    return rng.integers(0, choices[pattern], texels)


@pytest.mark.parametrize("pattern", ["one", "few", "many", "runs"])
def test_each_triangle_of_a_vector_is_listed_once_with_its_texels(device, pattern):
    triangles = tile(pattern).astype(np.int32)
    found = VectorTriangles.of(device, device.upload(triangles), len(triangles))
    vectors = triangles.reshape(-1, VECTOR)
    firsts = device.read(found.firsts, (len(vectors) + 1,), np.int32)
    members = device.read(found.members, (firsts[-1], 2), np.int32)
    assert found.nbytes == firsts.nbytes + members.nbytes
    for own, begin, end in zip(vectors, firsts, firsts[1:], strict=False):
        wanted = {t: sum(1 << lane for lane in np.flatnonzero(own == t)) for t in own.tolist()}
        assert end - begin == len(wanted)
        assert dict(members[begin:end].tolist()) == wanted


def test_bits_become_lanes(device):
    bits = np.array([0, 1, 1 << 15, 0xFFFF, 0x00F0, 0xABCD], np.int32)
    found = evaluate(device, "vectors", "lanes_of(bits)", {"bits": bits}, np.int32, VECTOR)
    np.testing.assert_array_equal(found, -((bits[:, None] >> np.arange(VECTOR)) & 1))


def test_a_vector_is_as_wide_on_both_sides(device):
    once = {"i_": np.zeros(1, np.int32)}
    assert evaluate(device, "vectors", "WIDTH", once, np.int32)[0] == VECTOR


@pytest.mark.parametrize(
    ("program", "lanes"),
    [("stretch", TRIANGLES), ("respond", VECTOR), ("ends", VECTOR), ("weights", VECTOR)],
)
def test_a_launch_counts_as_many_lanes_as_a_work_item_has(program, lanes):
    assert f"#define LANES {lanes}\n" in rhytid_kernels.source(program)
