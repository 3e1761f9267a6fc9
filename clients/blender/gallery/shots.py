"""What is rendered: frames of the scene, and the views of them.

Lengths are centimetres in the space of the face: x to its left, y up, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from face import Face

# Captured frames, 30 per second: brows fall, then a frown with a squint, raised brows, a smile.
FIRST_CAPTURED, CAPTURED = 3626, 60
EXPRESSIONS = ("brows_up", "frown", "smile")


@dataclass(frozen=True)
class View:
    """A camera and a key light.

    at: what it looks at.  width: of the picture, at that distance.  turn: degrees that the camera
    goes to the left of the face.  light: direction to the key light.  size: pixels.
    """

    at: tuple[float, float, float]
    width: float
    turn: float
    light: tuple[float, float, float]
    size: tuple[int, int]


@dataclass(frozen=True)
class Shot:
    """Frames of the scene from one view, with so many samples to a pixel."""

    name: str
    view: View
    frames: range
    samples: int = 24


def weights(face: Face) -> np.ndarray:
    """Weights (N, E) of all frames of the scene, the first of which is numbered 1."""
    captured = face.captured[FIRST_CAPTURED : FIRST_CAPTURED + CAPTURED]
    return np.concatenate([captured, [face.expression(name) for name in EXPRESSIONS]])


def _still(name: str) -> range:
    number = CAPTURED + 1 + EXPRESSIONS.index(name)
    return range(number, number + 1)


FILM = Shot(
    "film",
    View((3.2, 4.7, 9.4), 8.0, 18, (0.8, 0.6, 0.12), (480, 540)),
    range(1, CAPTURED + 1),
    samples=12,
)
_WIDE = (960, 800)
FOREHEAD = View((1.8, 7.9, 9.9), 6.5, 15, (0.7, 0.8, 0.0), _WIDE)
BROWS = View((1.0, 4.8, 10.8), 6.5, 5, (0.95, 0.4, 0.1), _WIDE)
EYE = View((4.8, 2.8, 7.9), 6.0, 35, (0.9, 0.5, -0.35), _WIDE)
CLOSE = (
    Shot("forehead", FOREHEAD, _still("brows_up")),
    Shot("brows", BROWS, _still("frown")),
    Shot("eye", EYE, _still("smile")),
)
