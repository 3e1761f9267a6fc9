"""Measures where a face folds: how far its skin is compressed in expressions, and along which axis.
Wrinkles run across that axis. Kernel: folds.cl.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.expressions import COLUMNS, ROWS, Expressions, Folds
from rhytid.domain.lengths import millimetres
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import FINE
from rhytid.pipeline.diffusion import Diffusion, triangle_areas
from rhytid.pipeline.frown import Frown
from rhytid.pipeline.mouth_corners import MouthCorners
from rhytid.pipeline.region_masks import RegionMasks
from rhytid.pipeline.stretch import Rest

FloatArray = NDArray[np.float64]
Caller = Callable[..., Any]
Report = Callable[[float, str], None]
# Standard deviation of the Gaussian that smooths the field: about the distance of two lines of a
# brow.
SIGMA_MM = 3.5
# The same where the unit is not known: its share of the root of the area, on a face.
_SIGMA_OF_ROOT = 0.012
# Root mean square of log compression over the whole surface: an expression below it moves nothing.
# What turning a whole head in float32 leaves is a tenth of it.
_STILL = 1e-3
_STAGE = "folds"


class FoldStage:
    """The triangles of a mesh, ready to be folded by one expression after the other.

    call: runs each step in a task of the device.
    """

    def __init__(self, device: Device, mesh: Mesh, call: Caller) -> None:
        self._device, self._call, self._count = device, call, len(mesh.faces)
        rest = Rest.of(mesh).shape
        area = np.where(rest[:, 0] > 0, triangle_areas(_corners(mesh)), 0.0)
        self._share = area / area.sum()
        self._buffers = call(self._upload, mesh.faces, rest)

    def measure(
        self, positions: NDArray[np.float32], limit: float
    ) -> tuple[NDArray[np.float32], bool]:
        """(F, 3) xx, yy, xy of Σ min(log ρᵢ, 0)² q̂ᵢq̂ᵢᵀ of one expression (V, 3), in frames of the
        triangles whose x runs along their first edges; and whether it moves anything.

        limit: of |log ρ|.
        """
        folds: NDArray[np.float32] = self._call(self._measure, positions, limit)
        size = float(self._share @ (folds[:, 0].astype(np.float64) + folds[:, 1]))
        return folds, size > _STILL**2

    def release(self) -> None:
        """Give the memory back."""
        self._call(self._release)

    def _upload(self, faces: Any, rest: Any) -> tuple[Any, ...]:
        device = self._device
        return device.upload(faces), device.upload(rest), device.empty(3 * self._count, np.float32)

    def _measure(self, positions: NDArray[np.float32], limit: float) -> NDArray[np.float32]:
        faces, rest, folds = self._buffers
        frame = self._device.upload(positions)
        self._device.launch(
            "folds", "fold_tensor", (self._count,), frame, faces, rest, np.float32(limit), folds
        )
        found: NDArray[np.float32] = self._device.read(folds, (self._count, 3), np.float32)
        frame.release()
        return found

    def _release(self) -> None:
        for buffer in self._buffers:
            buffer.release()


def measured_folds(
    device: Device,
    mesh: Mesh,
    expressions: Expressions,
    limit: float,
    unit: str,
    progress: Report,
    call: Caller,
    anatomy: str = FINE,
) -> Folds | None:
    """Measure where expressions fold a mesh; None where no expression moves anything.

    The folds are C = Σ w Σ min(log ρᵢ, 0)² q̂ᵢq̂ᵢᵀ at the vertices, with w one over the number of
    expressions that move anything, masks of the regions that expressions of known names show, and
    the crests of a frown, and the folds of an open jaw around the corners of the mouth.

    limit: of |log ρ|.  unit: of the mesh.  progress(fraction, stage) is called for each expression
    and may raise CancelledError.  call: runs each step in a task of the device.  anatomy: how
    finely regions are told apart.
    """
    stage = FoldStage(device, mesh, call)
    total, moving, regions = np.zeros((len(mesh.faces), 3)), 0, RegionMasks(mesh, anatomy)
    frown, corners = Frown(mesh), MouthCorners(mesh)
    try:
        every = zip(expressions.names, expressions.positions, strict=True)
        for done, (name, positions) in enumerate(every):
            progress(0.8 * done / len(expressions), _STAGE)
            folds, moves = stage.measure(positions, limit)
            if moves:
                total += folds
                moving += 1
                regions.add(name, positions, folds)
                frown.add(name, positions)
                corners.add(name, positions, folds)
        both = frown.positions if anatomy == FINE else None
        frowned = None if both is None else stage.measure(both, limit)[0]
    finally:
        stage.release()
    if not moving:
        return None
    progress(0.8, _STAGE)
    surface = Diffusion(mesh, _sigma(mesh, unit), moving_as_one(mesh, expressions))
    tensor = surface.of_triangles(in_space(mesh, total / moving))
    progress(0.95, _STAGE)
    crests = None
    if frowned is not None:
        crests = frown.crests(surface, in_space(mesh, frowned.astype(np.float64)))
    masks, fans = regions.masks(surface), None
    if corners.folds is not None and anatomy == FINE:
        fans = corners.fans(surface, in_space(mesh, corners.folds), masks.get("lip"))
    return Folds(tensor.astype(np.float32), moving, masks, crests, fans)


def in_space(mesh: Mesh, folds: FloatArray) -> FloatArray:
    """(F, 6) xx, yy, zz, xy, xz, yz in space of tensors (F, 3) in frames of the triangles."""
    corners = _corners(mesh)
    x = corners[:, 1] - corners[:, 0]
    normal = np.cross(x, corners[:, 2] - corners[:, 0])
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-300)
    y = np.cross(normal, x)
    y /= np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-300)
    xx, yy, xy = (column[:, None] for column in folds.T)
    a, b = ROWS, COLUMNS
    both = x[:, a] * y[:, b] + y[:, a] * x[:, b]
    found: FloatArray = xx * x[:, a] * x[:, b] + yy * y[:, a] * y[:, b] + xy * both
    return found


def moving_as_one(mesh: Mesh, expressions: Expressions) -> NDArray[np.intp]:
    """(V,) equal numbers for vertices at the same place in the neutral and in every expression:
    what an exporter has split at UV seams is one there; lips that only touch are not."""
    keys = np.zeros(len(mesh.positions), np.uint64)
    for positions in (mesh.positions, *expressions.positions):
        # Adding zero turns -0.0 into 0.0. Mixed after Steele et al. 2014 (SplitMix64).
        for bits in (positions + np.float32(0.0)).view(np.uint32).T:
            keys = (keys ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
            keys ^= keys >> np.uint64(31)
    numbers: NDArray[np.intp] = np.unique(keys, return_inverse=True)[1].reshape(-1)
    return numbers


def _sigma(mesh: Mesh, unit: str) -> float:
    length = millimetres(unit)
    if length is not None:
        return SIGMA_MM / length
    return _SIGMA_OF_ROOT * float(np.sqrt(triangle_areas(_corners(mesh)).sum()))


def _corners(mesh: Mesh) -> FloatArray:
    corners: FloatArray = mesh.positions.astype(np.float64)[mesh.faces]
    return corners
