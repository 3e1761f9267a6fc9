"""Positions out of weights, against float64."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.blendshapes import Blendshapes
from rhytid.domain.expressions import Expressions
from rhytid.errors import FrameError, InputError

rng = np.random.default_rng(5)
NEUTRAL = rng.normal(size=(40, 3)).astype(np.float32)
SHAPES = NEUTRAL + rng.normal(size=(3, 40, 3)).astype(np.float32)
KNOWN = Expressions.checked(SHAPES, 40, ["a_L", "a_R", "b"])


def test_weights_in_the_order_of_the_shapes() -> None:
    weights = np.array([0.25, -1.5, 3.0], np.float32)
    moved = np.tensordot(weights.astype(float), SHAPES.astype(float) - NEUTRAL, 1)
    found = Blendshapes(NEUTRAL, KNOWN).positions(weights)
    assert found.dtype == np.float32
    assert np.abs(found - (NEUTRAL + moved)).max() < 1e-5


def test_one_name_moves_both_sides_and_strange_ones_nothing() -> None:
    face = Blendshapes(NEUTRAL, KNOWN, ["c", "a"])
    assert face.unknown == ("c",)
    found = face.positions(np.array([7.0, 0.5], np.float32))
    expected = NEUTRAL + 0.5 * (SHAPES[0].astype(float) - NEUTRAL + SHAPES[1] - NEUTRAL)
    assert np.abs(found - expected).max() < 1e-5
    assert np.array_equal(face.positions(np.float32([1, 0])), NEUTRAL)


def test_names_that_mean_nothing_are_refused() -> None:
    with pytest.raises(InputError, match=r"none of the shapes c, d is known: a_L, a_R, b"):
        Blendshapes(NEUTRAL, KNOWN, ["c", "d"])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1001.0])
def test_a_weight_that_cannot_be_is_named(bad: float) -> None:
    with pytest.raises(FrameError, match="weight of a_R is"):
        Blendshapes(NEUTRAL, KNOWN).positions(np.float32([0, bad, bad]))


def test_frames_have_no_names() -> None:
    assert KNOWN.named
    assert not Expressions.checked(SHAPES, 40).named
