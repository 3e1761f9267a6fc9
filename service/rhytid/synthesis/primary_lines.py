"""The primary lines of skin: a coarse net, long and deep, between whose lines the fine ones lie.
Kernel: routes.cl.

Skin has lines of two orders: primary ones from pore to pore, in two directions that enclose
rhombi, and secondary ones, shorter and shallower, across these. The coarse net is made like the
fine one, then laid along its edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis import shapes
from rhytid.synthesis.candidate_graph import CandidateGraph, Cut, Ground, priorities
from rhytid.synthesis.fields import Directions, looked_up
from rhytid.synthesis.lattice import DevicePoints, Lattice
from rhytid.synthesis.pore_density import FAINTEST_PRIMARY, PACKING, PRIMARY_STRENGTH, spacings
from rhytid.synthesis.progress import Progress, part
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.trails import COARSE, Paths
from rhytid.synthesis.workspace import Workspace

# Spacing of the coarse net in spacings of the fine one.
COARSER = 4.0
# Below so many coarse pores on even skin there is no net to speak of.
_FEWEST = 50
# What sets strong primary lines apart from weak ones, beyond what their short walks do.
_SHARPER = np.float32(1.2)
# Strength of secondary lines, of that which walkers make; and that of a primary line of weight 1.
SECONDARY, PRIMARY = 0.7, 8.0
# Another number than that of the fine net.
_SALT = 0x5BD1E995
# Edges that a line may follow; one that has not arrived by then is not laid.
_STEPS = 64
# Weights are laid as whole numbers of this size.
_STEP = 2.0**-20


@dataclass(frozen=True, eq=False)
class Primary:
    """Coarse pores, the lines between them (L, 2) and their weights (L,)."""

    pores: Points
    ends: NDArray[np.int32]
    weight: NDArray[np.float32]

    @classmethod
    def build(
        cls,
        ground: Ground,
        radius: float,
        count: int,
        seed: int,
        directions: Directions,
        progress: Progress,
    ) -> Primary:
        """Grow the coarse net.  radius, count, seed: those of the fine net."""
        other = seed ^ _SALT
        net = CandidateGraph.build(ground, COARSER * radius, count, other, part(progress, 0.0, 0.5))
        if not has_primary_lines(ground.surface, radius) or not len(net.edges):
            return cls(net.pores, np.empty((0, 2), np.int32), np.empty(0, np.float32))
        with ground.work.nested() as nested:
            paths = net.paths(nested, directions, ground.fields, part(progress, 0.5, 0.6))
            strength = net.worn(nested, paths, other, COARSE, part(progress, 0.6, 0.9))
        factor = looked_up(ground.fields.primary, net.pores)
        strength *= factor[net.edges.nodes].mean(axis=1)
        priority = priorities(ground.work, net, strength, part(progress, 0.9, 1.0))
        chosen = Cut.at_strength(FAINTEST_PRIMARY).drawn(net.edges, priority)
        weight = shapes.edge_weights(strength[chosen] ** _SHARPER, PRIMARY_STRENGTH)
        return cls(net.pores, net.edges.nodes[chosen], weight)

    def laid(
        self, ground: Ground, net: CandidateGraph, paths: Paths, radius: float
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """(E,) the weight that primary lines give to each edge of the fine net, 0 where none runs;
        and (H,) the pores of the fine net at which primary lines meet."""
        factor = looked_up(partial(spacings, ground.fields), self.pores)
        hubs = nearest_pores(ground.work, net.pores, self.pores, 2.0 * radius, factor, net.lattice)
        weight = lay_routes(ground.work, net.pores, paths, hubs, self.ends, self.weight)
        return weight, meeting(hubs[self.ends], len(net.pores))


def meeting(ends: NDArray[np.int32], pores: int) -> NDArray[np.int32]:
    """(H,) those of so many pores that are among ends, -1 for none; ascending."""
    used = np.zeros(pores, np.bool_)
    used[ends[ends >= 0]] = True
    return np.flatnonzero(used).astype(np.int32)


def has_primary_lines(surface: Surface, radius: float) -> bool:
    """Whether a surface is large enough for primary lines, whatever is painted on it.

    radius: of the fine net.
    """
    return float(PACKING * surface.area.sum() / (COARSER * radius) ** 2) >= _FEWEST


def with_primary_lines(
    strength: NDArray[np.float32], primary: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(E,) strengths of edges, raised where primary lines run and lowered elsewhere.

    primary (E,): the weight of the primary line along each edge, 0 for none.
    """
    secondary: NDArray[np.float32] = SECONDARY * strength
    secondary += PRIMARY * primary
    return secondary


def lay_routes(
    work: Workspace,
    pores: Points,
    paths: Paths,
    hubs: NDArray[np.int32],
    ends: NDArray[np.int32],
    weight: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Lay lines along the shortest ways between pores: (E,) the largest weight of a line that runs
    along each edge, 0 where none does.

    hubs (H,): the pores that lines go between, -1 for none.  ends (L, 2): the two hubs of each
    line.  weight (L,): in [0, 1].
    """
    with work.nested() as nested:
        laid = nested.readable(paths.edges, np.int32, zero=True)
        steps = nested.upload(np.rint(weight / _STEP).astype(np.int32))
        nested.run(
            "routes", "lay_routes", len(ends), _STEPS, nested.upload(hubs[ends]), steps,
            paths.ways.offsets, paths.ways.pairs, paths.ways.others, paths.place,
            float(paths.unit / paths.typical), laid,
        )  # fmt: skip
        found = nested.read(laid, (paths.edges,), np.int32)
    weights: NDArray[np.float32] = found.astype(np.float32) * np.float32(_STEP)
    return weights


def nearest_pores(
    work: Workspace,
    pores: Points,
    places: Points,
    reach: float,
    factor: NDArray[np.float32],
    lattice: Lattice,
) -> NDArray[np.int32]:
    """(H,) the pore nearest to each place, on the same sheet; -1 where none is within `reach` times
    the factor (H,) of the place.

    lattice: of the places of the pores, and of `places`.
    """
    with work.nested() as nested:
        cloud = DevicePoints.of(nested, pores, reach * float(factor.max(initial=0.0)), lattice)
        nearest: Buffer = nested.empty(len(places), np.int32)
        at = nested.upload(lattice.places(places.position))
        facing = nested.upload(places.normal.astype(np.float32))
        nested.run(
            "routes", "nearest_point", len(places), at, facing, *cloud.points,
            *cloud.grid.arguments, float(lattice.unit / reach), nested.upload(factor), nearest,
        )  # fmt: skip
        found: NDArray[np.int32] = nested.read(nearest, (len(places),), np.int32)
    return found
