"""Random numbers that depend on a place in the map, not on what was drawn before it.

They are those of the kernels: random.clh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.progress import over_rows

Words = NDArray[np.uint32]


def random4(x: Any, y: Any, z: Any, w: Any) -> tuple[Words, Words, Words, Words]:
    """Four random words from four words: pcg4d of Jarzynski and Olano, JCGT 9(3), 2020."""
    words = (np.atleast_1d(np.asarray(v, np.uint32)) for v in (x, y, z, w))
    spread = np.broadcast_arrays(*words)
    a, b, c, d = (v * np.uint32(1664525) + np.uint32(1013904223) for v in spread)
    a, b, c, d = _mixed(a, b, c, d)
    return _mixed(*(v ^ (v >> np.uint32(16)) for v in (a, b, c, d)))


def place_keys(uv: NDArray[np.floating]) -> Words:
    """(N,) a word for each place (N, 2), from the bits of its single precision."""
    keys = np.empty(len(uv), np.uint32)

    def find(rows: slice) -> None:
        # Adding zero turns -0.0 into 0.0.
        bits = np.ascontiguousarray(uv[rows].astype(np.float32) + np.float32(0.0)).view(np.uint32)
        keys[rows] = random4(bits[:, 0], bits[:, 1], 0, 0)[0]

    over_rows(len(uv), find)
    return keys


def triangle_keys(uv: NDArray[np.float64]) -> Words:
    """(F,) a word for each triangle (F, 3, 2), from the bits of its corners in the map."""
    bits = np.ascontiguousarray(uv.reshape(len(uv), 6) + 0.0).view(np.uint32)
    state = random4(*bits[:, :4].T)
    for first in (4, 8):
        state = random4(*(s ^ b for s, b in zip(state, bits[:, first : first + 4].T, strict=True)))
    return state[0]


def normals(key: Words, salt: int, seed: int) -> NDArray[np.float32]:
    """(N,) normal deviates, after Box and Muller.

    key (N,): a word each.  salt: another number for each purpose.  seed: of the graph.
    """
    deviates = np.empty(len(key), np.float32)

    def find(rows: slice) -> None:
        one, two, _, _ = random4(key[rows], salt, seed, 0)
        radius = np.sqrt(np.float32(-2.0) * np.log(unit_interval(one)))
        deviates[rows] = radius * np.cos(np.float32(2.0 * np.pi) * unit_interval(two))

    over_rows(len(key), find)
    return deviates


def unit_intervals(key: Words, salt: int, seed: int) -> tuple[NDArray[np.float32], ...]:
    """Four times (N,) numbers in (0, 1), evenly spread; arguments as of `normals`."""
    return tuple(unit_interval(word) for word in random4(key, salt, seed, 1))


def unit_interval(word: Words) -> NDArray[np.float32]:
    """(N,) numbers in (0, 1) from random words (N,)."""
    found: NDArray[np.float32] = (word >> np.uint32(9)).astype(np.float32)
    found += np.float32(0.5)
    found *= np.float32(2.0**-23)
    return found


def _mixed(a: Words, b: Words, c: Words, d: Words) -> tuple[Words, Words, Words, Words]:
    a = a + b * d
    b = b + c * a
    c = c + a * b
    d = d + b * c
    return a, b, c, d
