"""What is probably wrong with a frame; `warnings.py` has the limits and their reasons.

A frame is judged by a sample of its triangles, on the host and in double: the cost is the same for
a mesh of any size, and the device is not needed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.mesh_warnings import far_detail, median_edge
from rhytid.domain.origin import number_step, put_back
from rhytid.domain.units import unit_pair
from rhytid.domain.warnings import (
    CLAMP_MEDIAN,
    FAR_FROM_ORIGIN,
    FRAME_SCALED,
    SCALED_MEDIAN,
    SCALED_SPREADS,
    STEP_OF_EDGE,
    STRETCH_AT_CLAMP,
    UNIT_TOLERANCE,
    InputWarning,
)

# Triangles that are sampled: their median is off by some 4 % of the spread.
_TRIANGLES = 512
# Log stretch of a triangle that has no area left.
_NOTHING = 1e-30


class FrameCheck:
    """Some triangles of a neutral mesh, spread evenly over the file, ready for its frames."""

    def __init__(self, mesh: Mesh, unit: str) -> None:
        self.unit, self.centre = unit, mesh.centre
        usable = np.flatnonzero(mesh.usable_triangles())
        step = -(-len(usable) // _TRIANGLES)
        corners = mesh.faces[usable[::step]]
        self._corners = np.ascontiguousarray(corners.T)
        first, second = self._edges(mesh.positions)
        length = np.linalg.norm(first, axis=0)
        height = np.linalg.norm(_cross(first, second), axis=0) / length
        along = _dot(first, second) / length
        # The columns of F in the frame of the first edge, from the edges of the deformed triangle.
        self._one = 1.0 / length
        self._two = -along / (length * height), 1.0 / height
        self._edge = median_edge(mesh.positions, corners)
        self._neutral_far = self._is_far(mesh.positions)

    def warnings(self, positions: NDArray[np.float32], where: str) -> tuple[InputWarning, ...]:
        """About positions (V, 3) in mesh units, less the centre; `where` names the frame."""
        return tuple(self._found(positions, where))

    def _found(self, positions: NDArray[np.float32], where: str) -> Iterator[InputWarning]:
        logs = self.log_stretch(positions)
        places = [int(share * (logs.size - 1)) for share in (0.1, 0.5, 0.9)]
        low, middle, high = np.partition(logs, places, axis=None)[places].tolist()
        if abs(middle) >= max(SCALED_MEDIAN, SCALED_SPREADS * (high - low)):
            yield InputWarning(FRAME_SCALED, self._scaled(float(np.exp(middle))), where)
        elif np.count_nonzero(np.abs(logs) >= CLAMP_MEDIAN) * 2 > logs.size:
            size = float(np.exp(np.median(np.abs(logs))))
            detail = (
                f"half of the triangles are stretched or compressed by {size:.3g} times or more; "
                "faces do not reach 1.5. Are its vertices in the order of the neutral mesh, and is "
                "it a frame of this mesh?"
            )
            yield InputWarning(STRETCH_AT_CLAMP, detail, where)
        # Where the neutral is far itself, there is a warning already.
        if not self._neutral_far and self._is_far(positions):
            step = number_step(positions, self.centre)
            sent = put_back(positions, self.centre)
            detail = far_detail(step, self._edge, float(np.abs(sent).max()), self.unit)
            yield InputWarning(FAR_FROM_ORIGIN, detail, where)

    def log_stretch(self, positions: NDArray[np.float32]) -> NDArray[np.float64]:
        """(K, 2) log ρ of the sampled triangles, the larger first, unclamped."""
        first, second = self._edges(positions)
        one = first * self._one
        two = first * self._two[0] + second * self._two[1]
        a, b, c, across = _dot(one, one), _dot(one, two), _dot(two, two), _cross(one, two)
        root = np.sqrt((0.5 * (a - c)) ** 2 + b * b)
        larger = np.maximum(0.5 * (a + c) + root, _NOTHING)
        # The determinant over the larger one: the difference would lose its digits.
        smaller = np.maximum(_dot(across, across) / larger, _NOTHING)
        logs: NDArray[np.float64] = 0.5 * np.log(np.stack([larger, smaller], axis=1))
        return logs

    def _edges(
        self, positions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3, K) from the first corner to the second and to the third."""
        a, b, c = positions[self._corners].transpose(0, 2, 1).astype(np.float64, order="C")
        return b - a, c - a

    def _is_far(self, positions: NDArray[np.float32]) -> bool:
        return number_step(positions, self.centre) > STEP_OF_EDGE * self._edge

    def _scaled(self, factor: float) -> str:
        detail = f"it is the neutral mesh made {factor:.4g} times as large"
        pair = unit_pair(factor, self.unit, UNIT_TOLERANCE)
        if pair is not None:
            times = f"multiply it by {1.0 / factor:.4g}"
            return f"{detail}: it looks like {pair[1]} beside a neutral in {pair[0]}; {times}"
        return f"{detail}: skin does not grow everywhere by the same factor"


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    products: NDArray[np.float64] = np.einsum("ik,ik->k", a, b)
    return products


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, K) cross products; numpy's own takes longer to begin than these few take."""
    (x, y, z), (u, v, w) = a, b
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u])
