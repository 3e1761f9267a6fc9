"""Records of plain values with the product's field names and defaults.

Every function that takes one reads attributes only, so the product's own objects fit as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Graph(NamedTuple):
    """Pores (N) and wrinkles (M) in UV; the rim of a `node_metric` (uu, uv, vv) is dᵀ·m·d = 1."""

    node_uv: NDArray[np.floating]
    node_weight: NDArray[np.floating]
    node_radius: NDArray[np.floating]
    edge_nodes: NDArray[np.integer]
    edge_weight: NDArray[np.floating]
    edge_half_width: NDArray[np.floating]
    node_metric: NDArray[np.floating] | None = None
    edge_metric: NDArray[np.floating] | None = None
    edge_copy_of: NDArray[np.integer] | None = None


@dataclass(frozen=True)
class Response:
    """Exponents of Alg. 1 (alpha) and Alg. 2 (beta)."""

    alpha_w: float = 1.0
    alpha_d: float = 4.0
    beta_w: float = 4.0
    beta_d: float = 10.0


@dataclass(frozen=True)
class Shape:
    """Bulge b of the profiles, and the sharpness and slots with which heights meet."""

    wrinkle_bulge: float = 2.5
    pore_bulge: float = 0.0
    sharpness: float = 20.0
    slots: int = 1


@dataclass(frozen=True)
class Bins:
    """The precomputed maps: N angles, M stretches over reach times -r_max to r_max."""

    count: int = 4
    samples: int = 3
    pore_samples: int | None = None
    bits: int = 8
    merge: str = "min"
    depth_factored: bool = False
    tilt: bool = False
    reach: float = 1.0
    r_max: float = 0.2
