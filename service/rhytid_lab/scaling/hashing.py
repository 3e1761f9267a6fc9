"""Which devices a head belongs to, by its id alone: no table that machines would have to share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_ODD = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_HALF, _THIRD, _REST = np.uint64(30), np.uint64(27), np.uint64(31)


def scattered(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The finaliser of SplitMix64 (Steele, Lea and Flood 2014): each bit of the result depends on
    every bit of a value."""
    with np.errstate(over="ignore"):
        mixed: NDArray[np.uint64] = values + _ODD
        mixed = (mixed ^ (mixed >> _HALF)) * _FIRST
        mixed = (mixed ^ (mixed >> _THIRD)) * _SECOND
        found: NDArray[np.uint64] = mixed ^ (mixed >> _REST)
    return found


def modulo(head: int, devices: Sequence[int]) -> int:
    """Naive hashing: the id, which is a hash already, modulo the number of devices."""
    ids = scattered(np.array([head], np.uint64))
    return devices[int(ids[0] % np.uint64(len(devices)))]


def preference(head: int, devices: Sequence[int], most: int | None = None) -> list[int]:
    """Rendezvous hashing (Thaler and Ravishankar 1998): all devices, or the first `most`, in the
    order in which a head prefers them. A device that goes or comes leaves the order of the others
    as it is."""
    ids = np.array(devices, np.uint64)
    with np.errstate(over="ignore"):
        own = scattered(np.array([head], np.uint64)) * _ODD
        weights = scattered(scattered(ids) ^ own)
    count = len(ids) if most is None else min(most, len(ids))
    if count < len(ids):
        best = np.argpartition(weights, len(ids) - count)[len(ids) - count :]
    else:
        best = np.arange(len(ids))
    return [devices[i] for i in best[np.argsort(weights[best])[::-1]]]
