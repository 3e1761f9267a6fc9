"""A wrinkle graph as somebody else would make it: numpy and safetensors, nothing of ours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save_file

WRINKLES = 7


def seven_wrinkles() -> dict[str, np.ndarray[Any, Any]]:
    """A star of seven wrinkles around one pore on the left chart of `bumpy_grid`; the required
    arrays alone."""
    angle = 2 * np.pi * np.arange(WRINKLES) / WRINKLES
    middle = np.array([0.27, 0.5])
    tips = middle + 0.08 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return {
        "node_uv": np.concatenate([middle[None], tips]).astype(np.float32),
        "node_weight": np.linspace(1.0, 0.3, WRINKLES + 1).astype(np.float32),
        "node_radius": np.full(WRINKLES + 1, 0.01, np.float32),
        "edge_nodes": np.stack([0 * angle, 1 + np.arange(WRINKLES)], axis=1).astype(np.int32),
        "edge_weight": np.linspace(1.0, 0.4, WRINKLES).astype(np.float32),
        "edge_half_width": np.full(WRINKLES, 0.008, np.float32),
    }


def write(file: Path, **changes: Any) -> Path:
    """The graph as a file; an array of None is left out."""
    arrays = {**seven_wrinkles(), **changes}
    save_file({name: a for name, a in arrays.items() if a is not None}, file)
    return file


# What can be wrong with such a file, and what is said of it.
BAD = {
    "missing": ({"edge_weight": None}, "the tensor edge_weight is missing"),
    "unknown": ({"edge_colour": np.zeros(7, np.float32)}, "unknown tensor 'edge_colour'"),
    "dtype": ({"edge_nodes": np.zeros((7, 2), np.int64)}, "edge_nodes has dtype I64, not I32"),
    "shape": ({"node_uv": np.zeros((8, 3), np.float32)}, "node_uv has shape (8, 3)"),
    "count": ({"edge_weight": np.ones(6, np.float32)}, "edge_weight has 6 rows, edge_nodes has 7"),
    "range": (
        {"edge_nodes": np.array([[0, i] for i in range(2, 9)], np.int32)},
        "edge_nodes[6] is [0, 8]: must be from 0 to 7",
    ),
    "value": (
        {"node_weight": np.full(8, 2, np.float32)},
        "node_weight[0] is 2.0: must be from 0 to 1",
    ),
    "length": (
        {"edge_nodes": np.array([[i, i] for i in range(7)], np.int32)},
        "edge_nodes[0] is [0, 0]: must be two pores at different places",
    ),
    "triangle": (
        {"edge_triangle": np.full(7, 10**6, np.int32)},
        "edge_triangle[0] is 1000000: the mesh has",
    ),
}
