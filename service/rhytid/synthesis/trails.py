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

from rhytid.device.buffer import Buffer
from rhytid.synthesis.edges import DEFINES, Edges
from rhytid.synthesis.hashes import place_keys
from rhytid.synthesis.incidence import Incidence
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.progress import Progress, over_rows, part
from rhytid.synthesis.surface import Points
from rhytid.synthesis.workspace import Workspace

# The mean strength nears 1, and beyond WORN more wear draws hardly more.
UNWORN, WORN = 0.25, 8.0
# How much a worn trail keeps walkers from crossing it.
SHY = 1.5
# Appeal of an edge at right angles to the direction that walkers like.
ASKEW = 0.02
# Of all steps those that walkers take: some walks end at a border.
_TAKEN = 0.98
# Walkers that a work-item leads, as in trails.cl; and entries beyond the ways out that it may read.
TOGETHER, BEYOND = 4, 16


@dataclass(frozen=True)
class Family:
    """One kind of walkers.

    angle: between their lines and the preferred direction, radians.  share: of all walkers.
    deposit: that each step leaves on its edge, a whole number.
    """

    angle: float
    share: float
    deposit: int


@dataclass(frozen=True)
class Walks:
    """How far and how often walkers walk.

    A round carries wear as far as a walk goes: with many walkers, few rounds and short walks the
    effect of what is painted stays near it.

    rounds: after each, the deposits are worn in.  steps: of a walk.  walkers: per pore and round.
    keep: the share of its strength that an edge keeps from one round to the next.  draw: a trail
    draws walkers by (UNWORN + strength)^draw.
    """

    rounds: int
    steps: int
    walkers: float
    keep: float
    draw: float


# The main lines, and the finer ones that cut the skin between them into rhombi.
FAMILIES = (
    Family(angle=0.0, share=0.47, deposit=10),
    Family(angle=float(np.radians(72.0)), share=0.53, deposit=7),
)


# On the fine net, and on that of the primary lines, whose steps are four times as long.
FINE = Walks(rounds=3, steps=8, walkers=3.0, keep=0.4, draw=2.3)
COARSE = Walks(rounds=2, steps=6, walkers=4.5, keep=0.2, draw=3.2)


def wear(
    work: Workspace,
    paths: Paths,
    crossings: NDArray[np.int32],
    seed: int,
    degree: float,
    walks: Walks,
    progress: Progress,
    worn: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Let walkers wear trails into edges: (E,) the strength of each, never 0, on even skin near 1
    in the mean.

    crossings: (P, 2) pairs of edges that cross.  degree: edges per pore of even skin.  worn (E,):
    strengths that the first walkers find, none without it.
    """
    with work.nested() as nested:
        trails = _Trails.of(nested, paths, crossings, seed, degree, walks, worn)
        for done in range(walks.rounds):
            share = part(progress, done / walks.rounds, (done + 1) / walks.rounds)
            trails.round(done, share)
        nested.release(trails.pull, trails.appeal, trails.deposit, *trails.crossed)
        strength = nested.read(trails.strength, (paths.edges,), np.float32)
        length = nested.read(paths.length, (paths.edges,), np.float32)

    # What no walker found is fainter than all else, the longer the fainter.
    def add(rows: slice) -> None:
        strength[rows] += np.float32(1e-3 * paths.typical) / length[rows]

    over_rows(len(strength), add)
    return strength


@dataclass(frozen=True, eq=False)
class Paths:
    """Ways out of N pores along E edges, on the device.

    ways: lists of edges by pore.  direction (2E, 2) int16: cosine and sine of each way out against
    the preferred direction of the pore, times 32767.  arrival (2E, 2) int16: that of the way back.
    length (E,) float32.  typical: length of edges on even skin.  anisotropy (N,) float32: how far
    walkers keep to those directions.  place (N, 3) int32: of the pores, in steps of `unit`.
    key (N,) uint32: a word of each pore from its place in the map.
    """

    pores: int
    edges: int
    ways: Incidence
    direction: Buffer
    arrival: Buffer
    length: Buffer
    typical: float
    anisotropy: Buffer
    place: Buffer
    unit: float
    key: Buffer

    @classmethod
    def of(
        cls,
        work: Workspace,
        pores: Points,
        edges: Edges,
        along: NDArray[np.float32],
        left: NDArray[np.float32],
        anisotropy: NDArray[np.float32],
        lattice: Lattice,
        length: float,
    ) -> Paths:
        """The ways of edges on the device.

        along, left (N, 3): the frame of each pore.  anisotropy (N,): how far walkers keep to it.
        lattice: of the places of pores.  length: mean of edges on even skin.
        """
        nodes = work.lend(edges.nodes)
        ways = Incidence.of(work, nodes, len(edges), len(pores))
        work.release(nodes)
        place = work.lend(lattice.places(pores.position))
        frame = work.lend(along), work.lend(left)
        direction = work.full(ways.entries + BEYOND, np.int32(0))
        arrival = work.empty(2 * ways.entries, np.int16)
        work.run(
            "trails", "lay_directions", len(pores), ways.offsets, ways.others, place, *frame,
            direction, defines=DEFINES,
        )  # fmt: skip
        work.run(
            "trails", "lay_arrivals", len(pores), ways.offsets, ways.others, direction, arrival,
            defines=DEFINES,
        )  # fmt: skip
        work.release(*frame)
        return cls(
            len(pores), len(edges), ways, direction, arrival, work.lend(edges.length),
            length, work.lend(anisotropy), place, lattice.unit,
            work.lend(place_keys(pores.uv)),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Trails:
    """The state of trails while walkers walk: strength (E,) float32, deposit (E,) int32, and the
    pull of edges and the appeal of ways out, which follow from the strength.

    crossed: where the list of each edge starts, and the edges that cross it.  gain: strength of a
    deposit.
    """

    work: Workspace
    paths: Paths
    crossed: tuple[Buffer, Buffer]
    seed: np.uint32
    walks: Walks
    gain: float
    still: Buffer
    strength: Buffer
    deposit: Buffer
    pull: Buffer
    appeal: Buffer

    @classmethod
    def of(
        cls,
        work: Workspace,
        paths: Paths,
        crossings: NDArray[np.int32],
        seed: int,
        degree: float,
        walks: Walks,
        worn: NDArray[np.float32] | None,
    ) -> _Trails:
        members = work.lend(crossings)
        found = Incidence.of(work, members, len(crossings), paths.edges)
        work.release(members, found.pairs)  # none of them is asked for
        none = np.float32(0.0)
        strength = work.full(paths.edges, none) if worn is None else work.upload(worn)
        deposit = work.full(paths.edges, np.int32(0))
        pull = work.empty(paths.edges, np.float32)
        appeal = work.full(paths.ways.entries + BEYOND, np.float32(0.0))
        deposits = walks.walkers * walks.steps * sum(f.share * f.deposit for f in FAMILIES)
        gain = (1.0 - walks.keep) * degree / (_TAKEN * deposits)
        still = work.empty(1, np.float32)
        work.run("trails", "pull_of_unworn", 1, UNWORN, walks.draw, still, defines=DEFINES)
        trails = still, strength, deposit, pull, appeal
        crossed = found.offsets, found.others
        return cls(work, paths, crossed, np.uint32(seed), walks, gain, *trails)

    def round(self, number: int, progress: Progress) -> None:
        """All families walk, and their deposits are worn in."""
        self._run(
            "pull_of_edges", -(-self.paths.edges // 8), self.paths.edges, UNWORN, self.walks.draw,
            WORN, SHY, self.still, self.strength, *self.crossed, self.pull,
            report=lambda _: progress(0.0, "trails"),
        )  # fmt: skip
        for index, family in enumerate(FAMILIES):
            share = part(progress, index / len(FAMILIES), (index + 1) / len(FAMILIES))
            self._walk(family, number * len(FAMILIES) + index, share)
        self._run(
            "wear_edges", self.paths.edges, self.walks.keep, self.gain, self.deposit, self.strength
        )

    def _walk(self, family: Family, turn: int, progress: Progress) -> None:
        """One family walks once."""
        paths, ways = self.paths, self.paths.ways
        along = _float2(np.cos(family.angle), np.sin(family.angle))
        self._run(
            "appeal_of_ways", paths.pores, ways.offsets, paths.direction, ways.pairs, paths.length,
            self.pull, paths.anisotropy, paths.typical, along, ASKEW, self.appeal,
            report=lambda _: progress(0.0, "trails"),
        )  # fmt: skip
        walkers = self.walks.walkers * family.share
        most = int(np.ceil(walkers))
        every = most * paths.pores
        self._run(
            "walk", -(-every // TOGETHER), every, most, walkers, np.uint32(turn), self.seed,
            self.walks.steps, family.deposit, along, paths.key, ways.offsets, ways.pairs,
            ways.others, paths.direction, paths.arrival, paths.anisotropy, self.appeal,
            self.deposit, report=lambda share: progress(share, "trails"),
        )  # fmt: skip

    def _run(self, kernel: str, count: int, *arguments: Any, **named: Any) -> None:
        self.work.run("trails", kernel, count, *arguments, defines=DEFINES, **named)


def _float2(x: float, y: float) -> Any:
    """A small vector as a kernel takes it."""
    return np.array((x, y), [("x", np.float32), ("y", np.float32)])[()]
