"""Requests as a studio makes them: few heads are used much, many hardly at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Requests:
    """times: (n,) seconds, ascending.  heads: (n,) which head each asks for."""

    times: NDArray[np.float64]
    heads: NDArray[np.int64]


def shares(heads: int, exponent: float) -> NDArray[np.float64]:
    """(heads,) the share of each head of all requests, by Zipf's law: 1 / rank to that power."""
    weights = np.arange(1, heads + 1, dtype=float) ** -exponent
    found: NDArray[np.float64] = weights / weights.sum()
    return found


def zipf_requests(count: int, rate: float, heads: int, exponent: float, seed: int) -> Requests:
    """So many requests, `rate` per second on average at random times; the same for the same
    seed."""
    random = np.random.default_rng(seed)
    times = np.cumsum(random.exponential(1.0 / rate, count))
    return Requests(times, random.choice(heads, count, p=shares(heads, exponent)))
