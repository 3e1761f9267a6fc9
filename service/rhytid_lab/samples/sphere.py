"""The front half of a sphere and the deformations of Fig. 5. In cm, facing +z."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.errors import FrameError, MeshError
from rhytid_lab.samples.grids import grid_faces, rounded

RADIUS = 5.0

# Stretch ratios along x and y at the centre: isotropic twice, then anisotropic twice.
SPHERE_STRETCHES: dict[str, tuple[float, float]] = {
    "stretch": (1.25, 1.25),
    "compression": (0.8, 0.8),
    "stretch_x": (1.25, 0.8),
    "stretch_y": (0.8, 1.25),
}


def sphere(resolution: int = 96) -> Mesh:
    """A hemisphere of 2 · resolution² triangles and radius 5 cm, its centre at +z.

    UV is Lambert's equal-area projection onto a disc in the middle of UDIM 1001, u along x and
    v along y: without stretch at the centre. Raises MeshError unless `resolution` is 2 to 512.
    """
    if not 2 <= resolution <= 512:
        raise MeshError(f"resolution {resolution}: a number from 2 to 512")
    t = np.linspace(-1, 1, resolution + 1)
    x, y = (axis.ravel() for axis in rounded(*np.meshgrid(t, t), 1.0))
    square = np.minimum(x * x + y * y, 1.0)
    lift = np.sqrt(2 - square)
    points = RADIUS * np.stack([x * lift, y * lift, 1 - square], axis=-1)
    faces = grid_faces(resolution)
    return Mesh(points.astype(np.float32), faces, 0.5 + 0.48 * np.stack([x, y], axis=-1), faces)


def sphere_stretch(mesh: Mesh, a: float, b: float) -> NDArray[np.float32]:
    """(V, 3) the sphere as an ellipsoid: at its centre ρ = a along x and b along y.

    Raises FrameError unless both are above 0.
    """
    if not (a > 0 and b > 0):
        raise FrameError(f"stretch ratios {a} and {b}: both must be above 0")
    scaled: NDArray[Any] = mesh.positions * np.array([a, b, 1.0], np.float32)
    return scaled
