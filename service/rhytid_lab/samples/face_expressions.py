"""Expressions of the face: displacement fields over the chart, at full strength. In cm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rhytid_lab.samples.face_shape import MOUTH, MOUTH_HALF_WIDTH, Chart
from rhytid_lab.samples.fields import Field, hill, odd_pair, pair, ramp, ridge

_HINGE = (0.3, -7.5)
_JAW_ANGLE = np.radians(13.0)
_FOLD = ((1.5, -3.0), (2.9, -4.4), (3.8, -5.9))
_CORNER = (MOUTH_HALF_WIDTH, MOUTH)

Expression = Callable[[Chart, Field, NDArray[np.bool_]], Field]


def brow_raise(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Brows up: the forehead is compressed along y, the upper lids stretch."""
    lift = ramp(c.q, 0.7, 3.0) * ramp(c.q, 10.4, 3.0) * ramp(np.abs(c.x), 8.0, 3.8)
    return _move(c, up=1.05 * lift, out=0.08 * lift)


def brow_furrow(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Brows together and down: vertical folds between them."""
    x, q = c.x, c.q
    return _move(
        c,
        right=-0.65 * odd_pair(x, q, (2.4, 2.9), (1.4, 1.5)),
        up=-0.50 * pair(x, q, (1.8, 3.1), (1.8, 1.4)),
        out=0.16 * hill(x, q, (0, 2.9), (0.5, 0.8)),
    )


def smile(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Mouth corners out, up and back, cheeks raised and full, the nasolabial fold closed."""
    x, q = c.x, c.q
    return _move(
        c,
        right=0.85 * odd_pair(x, q, _CORNER, (1.45, 1.5))
        + 0.12 * odd_pair(x, q, (1.4, -3.2), (0.7, 0.6)),
        up=0.75 * pair(x, q, _CORNER, (1.3, 1.3))
        + 0.40 * pair(x, q, (3.9, -2.6), (1.6, 1.2))
        + 0.16 * pair(x, q, (3.3, -0.7), (1.4, 0.6)),
        out=0.45 * pair(x, q, (4.1, -2.2), (1.2, 1.1))
        - 0.30 * pair(x, q, _CORNER, (0.9, 0.9))
        - 0.22 * ridge(x, q, _FOLD, 0.5),
    )


def frown(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Mouth corners down, the chin boss up, the brows lowered a little."""
    x, q = c.x, c.q
    mouth = _move(
        c,
        right=0.15 * odd_pair(x, q, (2.6, -6.8), (1.2, 1.2)),
        up=-0.75 * pair(x, q, _CORNER, (1.2, 1.35))
        + 0.35 * hill(x, q, (0, -8.2), (1.3, 1.2))
        + 0.15 * hill(x, q, (0, -6.2), (1.1, 0.9)),
        out=0.22 * hill(x, q, (0, -8.6), (1.2, 0.9)) + 0.15 * pair(x, q, (3.1, -7.2), (0.8, 0.9)),
    )
    return mouth + 0.5 * brow_furrow(c, points, upper)


def jaw_open(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """The jaw turns about its hinge before the ears; lips part, cheeks stretch along y."""
    weight = ramp(c.q, -1.8, -10.2)
    across = np.clip(np.abs(c.x) / MOUTH_HALF_WIDTH, 0, 1)
    parted = (1 - across**2) ** 1.3
    weight += parted * (np.where(upper, 0.0, 1.0) - weight)
    turn = weight * _JAW_ANGLE
    y, z = points[:, 1] - _HINGE[0], points[:, 2] - _HINGE[1]
    moved = np.zeros_like(points)
    moved[:, 1] = y * np.cos(turn) - z * np.sin(turn) - y
    moved[:, 2] = y * np.sin(turn) + z * np.cos(turn) - z
    return moved + _move(c, right=-0.15 * odd_pair(c.x, c.q, _CORNER, (1.3, 1.3)))


def pucker(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Lips drawn together and forward: radial folds around the mouth."""
    x, q = c.x, c.q
    return _move(
        c,
        right=-0.80 * odd_pair(x, q, _CORNER, (1.35, 1.3)),
        out=0.75 * hill(x, q, (0, MOUTH), (1.3, 0.95)) - 0.2 * pair(x, q, (4.4, -5.2), (1.2, 1.4)),
    )


def cheek_puff(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Cheeks and lips blown out: stretch in every direction."""
    x, q = c.x, c.q
    return _move(
        c,
        right=0.25 * odd_pair(x, q, (4.4, -5.2), (1.6, 1.6)),
        out=1.5 * pair(x, q, (4.4, -5.2), (1.7, 1.7))
        + 0.30 * hill(x, q, (0, -4.9), (1.6, 0.6))
        + 0.25 * hill(x, q, (0, -7.2), (1.5, 0.5)),
    )


def squint(c: Chart, points: Field, upper: NDArray[np.bool_]) -> Field:
    """Eyes pressed shut: lower lids and cheeks up, brows down, crow's feet beside the eyes."""
    x, q = c.x, c.q
    return _move(
        c,
        right=-0.32 * odd_pair(x, q, (5.3, 0.4), (0.9, 1.1)),
        up=0.28 * pair(x, q, (3.3, -0.7), (1.5, 0.7))
        + 0.30 * pair(x, q, (3.9, -2.2), (1.6, 1.1))
        - 0.28 * pair(x, q, (3.4, 2.8), (1.9, 0.9)),
        out=0.22 * pair(x, q, (4.0, -1.7), (1.2, 0.8)),
    )


EXPRESSIONS: dict[str, Expression] = {
    f.__name__: f
    for f in (brow_raise, brow_furrow, smile, frown, jaw_open, pucker, cheek_puff, squint)
}


def _move(
    c: Chart, right: Field | float = 0.0, up: Field | float = 0.0, out: Field | float = 0.0
) -> Field:
    """(V, 3) from components along the frame of the egg."""
    parts = ((right, c.right), (up, c.up), (out, c.out))
    return sum(
        (np.broadcast_to(s, c.x.shape)[:, None] * axis for s, axis in parts), np.zeros_like(c.point)
    )
