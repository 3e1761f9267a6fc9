"""Blendshapes of a face: positions out of their weights, and what their names mean.

Names are compared with those of ARKit, and with other spellings of the same.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.errors import FrameError, InputError

# Beyond it a weight is a mistake, and not a face that is pushed far.
MOST_WEIGHT = 1000.0
LEFT, RIGHT, BOTH = "left", "right", ""
# `Left`, `_L`, `.l`, or `L` after a lower-case letter, at the end.
_SIDE = re.compile(r"(?:[ ._-]?(?:(left)|(right))|[ ._-](?:(l)|(r)))$", re.IGNORECASE)
_LETTER = re.compile(r"(?<=[a-z])(?:(L)|(R))$")
# `Left_`, `L_` or `l-` at the beginning, where none is at the end.
_SIDE_FIRST = re.compile(r"(?:(left)|(right)|(l)|(r))[ _-]", re.IGNORECASE)
_PREFIX = re.compile(r"[.:|/]")
# Beginnings of names, in lower case, without what is not a letter.
_BEGINNINGS = {
    "forehead": (
        *("browinnerup", "browouterup", "browraise", "browsraise", "browup", "browsup"),
        *("raisebrow", "raiseeyebrow", "eyebrowraise", "eyebrowup", "eyebrowsup"),
    ),
    "eye_corner": (
        *("eyeblink", "eyesquint", "eyeclose", "eyesclose", "eyelidclose", "blink", "squint"),
        "closeeye",
    ),
    "lip": ("mouthpucker", "mouthfunnel", "pucker", "lippucker", "lipspucker", "kiss", "funnel"),
    "cheek": (
        *("cheekpuff", "cheeksquint", "cheekraise", "cheeksraise", "cheekup", "puffcheek"),
        *("raisecheek", "mouthsmile", "smile"),
    ),
    "nose": ("nosesneer", "sneer", "nosewrinkle", "wrinklenose", "nosescrunch"),
    "neck": ("jawopen", "openjaw", "jawdrop", "dropjaw", "mouthopen", "openmouth"),
}
# The same of shapes that roll the lips in.
_ROLLS = ("mouthroll", "rolllip", "liproll", "lipsroll", "rollmouth")

# The same of shapes that draw the brows down and together.
_FROWNS = (
    *("browdown", "browsdown", "browlower", "browslower", "lowerbrow", "eyebrowdown"),
    *("eyebrowsdown", "eyebrowlower", "browfurrow", "browsfurrow"),
)
# The same as an action unit of FACS, alone and with or without its name: `AU4`, `AU04_BrowLowerer`.
_LOWERED = re.compile(r"au0?4(?![0-9]|au)")


class Blendshapes:
    """Makes positions of the weights of a face's shapes.

    neutral: (V, 3).  names: of the weights, in the order in which a caller gives them; empty for
    those of the shapes.  unknown: the names that mean no shape; their weights have no effect.

    Raises InputError where no name means a shape.
    """

    def __init__(
        self, neutral: NDArray[np.float32], shapes: Expressions, names: Sequence[str] = ()
    ) -> None:
        self.names = tuple(names) or shapes.names
        meant = meant_shapes(self.names, shapes.names)
        self.unknown = tuple(n for n, found in zip(self.names, meant, strict=True) if not found)
        if len(self.unknown) == len(self.names):
            near = ", ".join(_closest(self.names[0], shapes.names))
            raise InputError(f"shapes: none is known; closest to {self.names[0]} are {near}")
        used = sorted({index for found in meant for index in found})
        self._neutral = neutral
        # One row of differences for each shape that some weight moves.
        self._differences = (shapes.positions[used] - neutral).reshape(len(used), -1)
        self._spread = np.zeros((len(used), len(self.names)), np.float32)
        for column, found in enumerate(meant):
            for index in found:
                self._spread[used.index(index), column] = 1.0

    @property
    def nbytes(self) -> int:
        """Bytes of its arrays."""
        return self._differences.nbytes + self._spread.nbytes + self._neutral.nbytes

    def positions(self, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, 3) neutral + Σ wₑ (shapeₑ - neutral).  weights: one for each name.

        Raises FrameError naming the first weight that is not finite or beyond ± 1000.
        """
        with np.errstate(invalid="ignore"):
            good = np.abs(weights) <= MOST_WEIGHT
        if not good.all():
            first = int(np.argmin(good))
            raise FrameError(
                f"weight of {self.names[first]} is {float(weights[first]):g}: must be a number "
                f"within ± {MOST_WEIGHT:g}"
            )
        # Not a product of matrices: BLAS would take several threads, which wait for each other.
        moved = np.einsum("e,ev->v", self._spread @ weights, self._differences)
        found: NDArray[np.float32] = self._neutral + moved.reshape(self._neutral.shape)
        return found


def meant_shapes(wanted: Sequence[str], known: Sequence[str]) -> list[tuple[int, ...]]:
    """For each wanted name the indices of the known shapes that it means; empty for none.

    A name that a shape has means that shape. Otherwise spellings are compared, and a name without a
    side means the shapes of both sides: `browInnerUp` of ARKit is `browInnerUp_L` and
    `browInnerUp_R`.
    """
    exact = {name: index for index, name in reversed(list(enumerate(known)))}
    by_parts: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    for index, name in enumerate(known):
        by_parts[name_parts(name)].append(index)

    def meant(name: str) -> tuple[int, ...]:
        if name in exact:
            return (exact[name],)
        stem, side = name_parts(name)
        found = by_parts.get((stem, side), [])[:1]
        if not found and side == BOTH:
            found = [i for half in (LEFT, RIGHT) for i in by_parts.get((stem, half), [])[:1]]
        return tuple(found)

    return [meant(name) for name in wanted]


def name_parts(name: str) -> tuple[str, str]:
    """The stem in lower case and the side of a shape's name: `eyeBlink_L`, `EyeBlinkLeft`,
    `L_eyeBlink` and `face|eyeBlink.L` are all ("eyeblink", "left"). The side is empty where the
    name has none."""
    side = BOTH
    found = _SIDE.search(name) or _LETTER.search(name)
    if found is not None and found.start():
        side, name = _side(found), name[: found.start()]
    name = _PREFIX.split(name)[-1]
    first = _SIDE_FIRST.match(name)
    if side == BOTH and first is not None:
        side, name = _side(first), name[first.end() :]
    return re.sub(r"[^a-z0-9]", "", name.lower()), side


def _side(found: re.Match[str]) -> str:
    """LEFT or RIGHT, by which groups of a pattern were found."""
    return LEFT if any(found.groups()[0::2]) else RIGHT


def region_of(name: str) -> str | None:
    """The region that an expression of that name shows best; None where it shows none.

    A prefix that ends in a dot, a colon, a bar or a slash is ignored, as in `face|eyeBlink_L`. A
    sneer shows the nose and an open jaw the neck by what they move around these.
    """
    plain = _plain(name)
    for region, beginnings in _BEGINNINGS.items():
        if plain.startswith(beginnings):
            return region
    return None


def rolls_lips(name: str) -> bool:
    """Whether an expression of that name rolls a lip in. A prefix is ignored as in `region_of`."""
    return _plain(name).startswith(_ROLLS)


def opens_jaw(name: str) -> bool:
    """Whether an expression of that name opens the jaw. A prefix is ignored as in `region_of`."""
    return region_of(name) == "neck"


def frowning_side(name: str) -> str | None:
    """The side of the brow that an expression of that name draws down: LEFT or RIGHT, BOTH for
    both; None for any other name."""
    stem, side = name_parts(name)
    return side if _plain(name).startswith(_FROWNS) or _LOWERED.match(stem) else None


def _closest(name: str, known: Sequence[str]) -> list[str]:
    """The three known names, at most, that are spelt most alike."""
    spelt = {one.lower(): one for one in reversed(known)}
    return [spelt[one] for one in get_close_matches(name.lower(), spelt, n=3, cutoff=0.0)]


def _plain(name: str) -> str:
    """The letters of a name in lower case, without its prefix and its side."""
    return re.sub(r"[^a-z]", "", name_parts(name)[0])
