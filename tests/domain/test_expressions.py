"""Expressions: what is refused and why, how many are looked at, and their digest."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.expressions import ENOUGH, MOST_EXPRESSIONS, Expressions, Folds
from rhytid.errors import FrameError, InputError

SHAPES = np.arange(24, dtype=np.float64).reshape(2, 4, 3)


def test_positions_are_kept_in_single_precision_less_the_centre():
    found = Expressions.checked(SHAPES + 1e7, 4, ["a", "b"], np.full(3, 1e7))
    assert found.names == ("a", "b")
    assert found.positions.dtype == np.float32
    np.testing.assert_array_equal(found.positions, SHAPES)
    assert not found.positions.flags.writeable


@pytest.mark.parametrize(
    ("shapes", "names", "told"),
    [
        (SHAPES[0], None, r"shape \(4, 3\) of float64, not numbers \(E, 4, 3\)"),
        (SHAPES[:, :3], None, r"shape \(2, 3, 3\)"),
        (SHAPES > 3, None, "of bool"),
        (SHAPES, ["one"], "1 names for 2 shapes"),
    ],
)
def test_what_does_not_fit_is_told(shapes, names, told):
    with pytest.raises(FrameError, match=told):
        Expressions.checked(shapes, 4, names)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_the_shape_and_vertex_that_is_not_finite_are_named(bad):
    shapes = SHAPES.copy()
    shapes[1, 2, 0] = bad
    with pytest.raises(FrameError, match="shape smile, vertex 2 is"):
        Expressions.checked(shapes, 4, ["a", "smile"])


def test_of_many_frames_some_are_picked_evenly():
    frames = np.repeat(np.arange(4030.0), 3).reshape(-1, 1, 3)
    found = Expressions.checked(frames, 1)
    picked = found.positions[:, 0, 0]
    assert len(found) == MOST_EXPRESSIONS == 400
    assert (picked[0], picked[-1]) == (0.0, 4029.0)
    assert set(np.diff(picked)) == {10.0, 11.0}
    assert found.names[1] == "0010"


def test_the_digest_hangs_on_names_and_every_number():
    one = Expressions.checked(SHAPES, 4)
    changed = SHAPES.copy()
    changed[1, 3, 2] += 0.5
    others = [
        Expressions.checked(SHAPES, 4, ["a", "b"]),
        Expressions.checked(changed, 4),
        Expressions.checked(SHAPES[:1], 4),
    ]
    assert one.digest() == Expressions.checked(SHAPES.astype(np.float32), 4).digest()
    assert len({one.digest(), *(other.digest() for other in others)}) == 4


def test_folds_come_back_from_their_arrays():
    tensor = np.linspace(0, 1, 24, dtype=np.float32).reshape(4, 6)
    frown, fans = np.linspace(0, 1, 4, dtype=np.float32), tensor[::-1].copy()
    folds = Folds(tensor, 3, {"lip": np.ones(4, np.float32)}, frown, fans)
    again = Folds.of_arrays(folds.arrays())
    np.testing.assert_array_equal(again.tensor, tensor)
    np.testing.assert_array_equal(again.regions["lip"], 1.0)
    np.testing.assert_array_equal(again.frown, frown)
    np.testing.assert_array_equal(again.fans, fans)
    assert (again.moving, again.known) == (3, 3 / ENOUGH)
    # As they were stored before there were frowns, and fans.
    before = Folds.of_arrays(Folds(tensor, 3).arrays())
    assert before.frown is before.fans is None
    assert Folds(tensor, 50).known == 1.0


def test_folds_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="not finite"):
        Folds(np.full((4, 6), np.nan, np.float32), 3)
