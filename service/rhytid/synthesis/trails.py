"""Wrinkle strengths: walkers wear trails into the candidate edges. Kernel: trails.cl.

After the pedestrian trails of Weiss et al. 2023: walkers prefer edges that are short, go straight
on, follow a preferred direction, are worn already and do not cross worn ones. A walk deposits on
its edges; all edges decay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Buffer
from rhytid.synthesis.edges import DEFINES
from rhytid.synthesis.incidence import Incidence
from rhytid.synthesis.paths import Paths
from rhytid.synthesis.progress import Progress, part
from rhytid.synthesis.workspace import Workspace


@dataclass(frozen=True)
class Family:
    """Walkers of one kind.

    angle: of their lines against the preferred direction.  walkers: per pore and round.
    deposit: of one step, a whole number.
    """

    angle: float
    walkers: float
    deposit: int


# The main lines, and the finer ones that cut the skin between them into rhombi.
FAMILIES = (
    Family(angle=0.0, walkers=0.35, deposit=10),
    Family(angle=float(np.radians(72.0)), walkers=0.40, deposit=7),
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
# Appeal of an edge at right angles to the direction that walkers like.
ASKEW = 0.02
# Edges whose deposits one work-item adds up.
_STRETCH = 4096


def wear(
    work: Workspace, paths: Paths, crossings: NDArray[np.int32], seed: int, progress: Progress
) -> NDArray[np.float32]:
    """(E,) strength of each edge, never 0; the mean is near 1.

    crossings: (P, 2) pairs of edges that cross.
    """
    with work.room() as room:
        trails = _Trails.of(room, paths, crossings, seed)
        for done in range(ROUNDS):
            trails.round(done, part(progress, done / ROUNDS, (done + 1) / ROUNDS))
        strength = room.read(trails.strength, (paths.edges,), np.float32)
        length = room.read(paths.length, (paths.edges,), np.float32)
    # What no walker found is fainter than all else, the longer the fainter.
    strength += np.float32(1e-3 * paths.mean_length) / length
    return strength


@dataclass(frozen=True, eq=False)
class _Trails:
    """What changes while walkers walk: strength (E,) float32, deposit (E,) int32, and the pull of
    edges and the appeal of ways out that follow from the strength."""

    work: Workspace
    paths: Paths
    crossings: Incidence
    seed: np.uint32
    strength: Buffer
    deposit: Buffer
    pull: Buffer
    appeal: Buffer

    @classmethod
    def of(cls, work: Workspace, paths: Paths, crossings: NDArray[np.int32], seed: int) -> _Trails:
        found = Incidence.of(work, work.upload(crossings), len(crossings), paths.edges)
        strength = work.full(paths.edges, np.float32(0.0))
        deposit = work.full(paths.edges, np.int32(0))
        pull = work.empty(paths.edges, np.float32)
        appeal = work.empty(paths.ways.entries, np.float32)
        return cls(work, paths, found, np.uint32(seed), strength, deposit, pull, appeal)

    def round(self, number: int, progress: Progress) -> None:
        """All families walk, and what they leave is worn in."""
        self._run(
            "pull_of_edges", self.paths.edges, UNWORN, DRAW, WORN, SHY, self.strength,
            self.crossings.offsets, self.crossings.others, self.pull,
            report=lambda _: progress(0.0, "trails"),
        )  # fmt: skip
        for index, family in enumerate(FAMILIES):
            share = part(progress, index / len(FAMILIES), (index + 1) / len(FAMILIES))
            self._walk(family, number * len(FAMILIES) + index, share)
        gain = (1.0 - KEEP) / max(self._deposits() / max(self.paths.edges, 1), 1e-9)
        self._run("wear_edges", self.paths.edges, KEEP, gain, self.deposit, self.strength)

    def _walk(self, family: Family, turn: int, progress: Progress) -> None:
        """One family walks once."""
        paths, ways = self.paths, self.paths.ways
        along = _float2(np.cos(family.angle), np.sin(family.angle))
        self._run(
            "appeal_of_ways", paths.pores, ways.offsets, paths.direction, ways.pairs, paths.length,
            self.pull, paths.anisotropy, paths.mean_length, along, ASKEW, self.appeal,
            report=lambda _: progress(0.0, "trails"),
        )  # fmt: skip
        walkers = int(np.ceil(family.walkers * paths.pores))
        self._run(
            "walk", walkers, walkers, paths.pores, np.uint32(turn), self.seed, STEPS,
            family.deposit, along, ways.offsets, ways.pairs, ways.others, paths.direction,
            paths.anisotropy, self.appeal, self.deposit,
            report=lambda share: progress(share, "trails"),
        )  # fmt: skip

    def _deposits(self) -> float:
        """The sum of all deposits."""
        stretches = -(-self.paths.edges // _STRETCH)
        sums = self.work.empty(stretches, np.uint64)
        self._run("sum_deposits", stretches, self.paths.edges, _STRETCH, self.deposit, sums)
        total = float(self.work.read(sums, (stretches,), np.uint64).sum())
        self.work.release(sums)
        return total

    def _run(self, kernel: str, count: int, *arguments: Any, **named: Any) -> None:
        self.work.run("trails", kernel, count, *arguments, defines=DEFINES, **named)


def _float2(x: float, y: float) -> Any:
    """A small vector as a kernel takes it."""
    return np.array((x, y), [("x", np.float32), ("y", np.float32)])[()]
