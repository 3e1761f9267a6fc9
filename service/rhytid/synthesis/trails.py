"""Wrinkle strengths: walkers wear trails into the candidate edges.

After the pedestrian trails of Weiss et al. 2023: walkers prefer edges that are short, go straight
on, follow a preferred direction, are worn already and do not cross worn ones. A walk deposits on
its edges; all edges decay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.synthesis.paths import Paths
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.surface import FloatArray, IntArray

Table = NDArray[np.float32]


@dataclass(frozen=True)
class Family:
    """Walkers of one kind.

    angle: of their lines against the preferred direction.  walkers: per pore and round.
    deposit: of one step.  focus: how closely they keep to their direction (a power of |cos|).
    """

    angle: float
    walkers: float
    deposit: float
    focus: float


# The main lines, and the finer ones that cut the skin between them into rhombi.
FAMILIES = (
    Family(angle=0.0, walkers=0.35, deposit=1.0, focus=2.5),
    Family(angle=float(np.radians(72.0)), walkers=0.40, deposit=0.7, focus=2.5),
)
ROUNDS = 14
STEPS = 14
# The share of its strength that an edge keeps from one round to the next.
KEEP = 0.82
# A trail draws walkers by (UNWORN + strength)^DRAW; the mean strength nears 1, and beyond WORN
# more wear draws hardly more.
UNWORN, DRAW, WORN = 0.25, 1.2, 8.0
# How much a worn trail keeps walkers from crossing it.
SHY = 1.5
# Power by which short edges are preferred.
SHORT = 1.5
# Appeal of an edge at right angles to the direction that walkers like.
ASKEW = 0.02


def wear(
    paths: Paths,
    length: FloatArray,
    crossings: IntArray,
    rng: np.random.Generator,
    progress: Progress,
) -> FloatArray:
    """(E,) strength of each edge, never 0; the mean is near 1.

    length: (E,).  crossings: (P, 2) pairs of edges that cross.
    """
    likings = [_liking(paths, length, family) for family in FAMILIES]
    strength = np.zeros(len(length))
    for done in range(ROUNDS):
        progress(done / ROUNDS, "trails")
        pull = _pull(strength, crossings)
        deposit = np.zeros(len(length))
        for family, liking in zip(FAMILIES, likings, strict=True):
            deposit += family.deposit * _walk(paths, family, liking, pull, rng)
        strength = KEEP * strength + (1 - KEEP) * deposit / max(deposit.mean(), 1e-9)
    # What no walker found is fainter than all else, the longer the fainter.
    strength += 1e-3 * length.mean() / length
    return strength


def _liking(paths: Paths, length: FloatArray, family: Family) -> Table:
    """(N, D) the part of an edge's appeal that never changes; 0 for a slot without edge."""
    cosine = paths.cosine * np.cos(family.angle) + paths.sine * np.sin(family.angle)
    short = np.append((length.mean() / length) ** SHORT, 0.0)
    liking = (np.abs(cosine) ** family.focus + ASKEW) * short[paths.edge]
    return np.asarray(liking, np.float32)


def _pull(strength: FloatArray, crossings: IntArray) -> Table:
    """(E + 1,) how much each edge draws walkers now; the last is the edge that is none."""
    one, two = crossings.T
    across = np.bincount(one, weights=strength[two], minlength=len(strength))
    across += np.bincount(two, weights=strength[one], minlength=len(strength))
    worn = strength / (1.0 + strength / WORN)
    pull = (UNWORN + worn) ** DRAW / (1.0 + SHY * across)
    return np.append(pull, 0.0).astype(np.float32)


def _walk(
    paths: Paths, family: Family, liking: Table, pull: Table, rng: np.random.Generator
) -> FloatArray:
    """(E,) how often the walkers of one round pass each edge."""
    pores, edges = len(paths.edge), len(pull) - 1
    count = int(np.ceil(family.walkers * pores))
    node = rng.integers(pores, size=count)
    heading = family.angle + np.pi * rng.integers(2, size=count)
    cosine, sine = np.cos(heading).astype(np.float32), np.sin(heading).astype(np.float32)
    steps = np.zeros(edges + 1)
    for _ in range(STEPS):
        onward = paths.cosine[node] * cosine[:, None] + paths.sine[node] * sine[:, None]
        appeal = _straightness(onward) * liking[node] * pull[paths.edge[node]]
        slot, stuck = _choose(appeal, rng)
        node, slot = node[~stuck], slot[~stuck]
        steps += np.bincount(paths.edge[node, slot], minlength=edges + 1)
        node, back = paths.to[node, slot], paths.back[node, slot]
        # Straight on is the way back turned round.
        cosine, sine = -paths.cosine[node, back], -paths.sine[node, back]
    return steps[:edges]


def _straightness(onward: Table) -> Table:
    """The cosine of a turn to the fourth power; nothing for a turn beyond a right angle."""
    square = np.square(np.maximum(onward, 0.0))
    return square * square


def _choose(appeal: Table, rng: np.random.Generator) -> tuple[IntArray, NDArray[np.bool_]]:
    """A slot (W,) for each row of appeal (W, D), by chance in proportion; and who has none."""
    sums = np.cumsum(appeal, axis=1)
    # In float32 the product may round up to the sum itself; the last slot with appeal is meant.
    chance = np.minimum(rng.random(len(appeal), np.float32), 1.0 - 2.0**-23) * sums[:, -1]
    slot = np.argmax(sums > chance[:, None], axis=1)
    return slot, sums[:, -1] <= 0
