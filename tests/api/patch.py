"""A small curved patch as OBJ text, and frames of it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIDE = 5
SETTINGS = {"resolution": 256, "tile_size": 64, "graph": {"wrinkles": 200}}


def positions() -> NDArray[np.float32]:
    """(25, 3) the neutral vertices, in the order of `obj`."""
    v, u = np.mgrid[0:SIDE, 0:SIDE] / (SIDE - 1)
    z = 0.1 * np.sin(3 * u) * np.cos(2 * v)
    return np.stack([u, v, z], axis=-1).reshape(-1, 3).astype(np.float32)


def obj(scale: float = 1.0) -> bytes:
    """The patch, within UDIM 1001; another `scale` is another asset."""
    v = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in scale * positions()]
    vt = [f"vt {0.1 + 0.8 * x:.9g} {0.1 + 0.8 * y:.9g}" for x, y, _ in positions()]
    corner = [SIDE * j + i + 1 for j in range(SIDE - 1) for i in range(SIDE - 1)]
    quads = [(c, c + 1, c + SIDE + 1, c + SIDE) for c in corner]
    f = ["f " + " ".join(f"{c}/{c}" for c in quad) for quad in quads]
    return "\n".join([*v, *vt, *f, ""]).encode()


def smile(amount: float = 0.1) -> NDArray[np.float32]:
    """(25, 3) the patch, wider by `amount`."""
    return positions() * np.float32([1 + amount, 1, 1])


def upload(mesh: bytes | None = None, name: str = "patch.obj", **changes: Any) -> dict[str, Any]:
    """The `files` of a POST of an asset, `changes` put into its settings."""
    settings = json.dumps({**SETTINGS, **changes})
    return {"mesh": (name, obj() if mesh is None else mesh), "settings": (None, settings)}
