"""The lines of a coarse net along the edges of a fine one. Kernel: routes.cl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer
from rhytid.synthesis.pores.device_points import DevicePoints
from rhytid.synthesis.pores.lattice import Lattice
from rhytid.synthesis.surface import Points
from rhytid.synthesis.trails.paths import Paths
from rhytid.synthesis.workspace import Workspace

# Edges that a line may follow; one that has not arrived by then is not laid.
_STEPS = 64
# Weights are laid as whole numbers of this size.
_STEP = 2.0**-20


def lay_routes(
    work: Workspace,
    pores: Points,
    paths: Paths,
    hubs: NDArray[np.int32],
    ends: NDArray[np.int32],
    weight: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(E,) the largest weight of a line that an edge is part of, 0 where it is part of none.

    hubs (H,): the pores that lines go between, -1 for none.  ends (L, 2): the two hubs of each
    line.  weight (L,): in [0, 1].
    """
    with work.room() as room:
        laid = room.full(paths.edges, np.int32(0))
        wanted = room.upload(np.rint(weight / _STEP).astype(np.int32))
        room.run(
            "routes", "lay_routes", len(ends), _STEPS, room.upload(hubs[ends]), wanted,
            paths.ways.offsets, paths.ways.pairs, paths.ways.others, paths.place,
            float(paths.unit / paths.typical), laid,
        )  # fmt: skip
        found = room.read(laid, (paths.edges,), np.int32)
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
    """(H,) the pore nearest to each place on its sheet, -1 where none is within `reach` times the
    factor (H,) of the place.

    lattice: that of the pores; places lie on it too.
    """
    with work.room() as room:
        cloud = DevicePoints.of(room, pores, reach * float(factor.max(initial=0.0)), lattice)
        nearest: Buffer = room.empty(len(places), np.int32)
        at = room.upload(lattice.places(places.position))
        facing = room.upload(places.normal.astype(np.float32))
        room.run(
            "routes", "nearest_point", len(places), at, facing, *cloud.points,
            *cloud.grid.arguments, float(lattice.unit / reach), room.upload(factor), nearest,
        )  # fmt: skip
        found: NDArray[np.int32] = room.read(nearest, (len(places),), np.int32)
    return found
