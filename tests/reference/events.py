"""Single features of the skin: what they add to a displacement map.

Kinds by `node_kind`, from 1: bump, papule, scar, milium, mole, wide pore.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from reference.drawing import disc_metric, metric_distance
from reference.inputs import Array, Graph, Response
from reference.redraw import ORIGIN
from reference.response import pore_stretch, scales

# Depths in the height of an event of weight 1.
TALLEST = 16.0
# Of each kind from 1 on: whether it rises, which power of t its shoulder has, the wall of a pit,
# and the share of the log stretch that it answers to.
RISES = (1, 1, -1, 1, 1, -1)
POWERS = (2, 2, 2, 2, 4, 2)
WALLS = (0.0, 0.0, 2.2, 0.0, 0.0, 1.15)
ANSWERS = (0.5, 0.35, 0.25, 0.25, 0.25, 1.0)


def profile(t: ArrayLike, kind: int) -> Array:
    """Height at a distance t from the middle, in rims: 1 in the middle, 0 from the rim on."""
    near = np.minimum(np.asarray(t, np.float64), 1.0)
    found: Array = (1 - near ** POWERS[kind - 1]) ** 2 * (1 - WALLS[kind - 1] * near**2)
    return found


def added(
    points: Array,
    graph: Graph,
    kinds: ArrayLike,
    logs: Array,
    response: Response,
    depth: float,
    origin: ArrayLike = ORIGIN,
) -> Array:
    """(P,) displacement that the events of a graph add at points (P, 2), local to the UDIM.

    kinds (N,): 0 for a pore, which adds nothing.  logs (N, 2): clamped log stretch at the nodes.
    """
    metric = disc_metric(graph.node_radius)
    if graph.node_metric is not None:
        metric = np.asarray(graph.node_metric, np.float64)
    place = np.asarray(graph.node_uv, np.float64) - np.asarray(origin, np.float64)
    height = np.zeros(len(points))
    for node in np.flatnonzero(np.asarray(kinds)):
        kind = int(np.asarray(kinds)[node])
        r = ANSWERS[kind - 1] * pore_stretch(logs[node])
        width, lower = scales(r, response.beta_w, response.beta_d)
        t = metric_distance(points, place[node], metric[node]) / width
        tall = TALLEST * RISES[kind - 1] * float(graph.node_weight[node]) * lower
        height += depth * tall * profile(t, kind)
    return height
