"""Stretch of a frame on the device, as every stretch model leaves it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device


@dataclass(frozen=True)
class StretchBuffers(BufferGroup):
    """Stretch on the device, F triangles and one neutral entry for points in no triangle.

    count: F + 1.  ratios: float2, unclamped.  axes: float4, (ŝ₁, ŝ₂).
    logs: float2, log ρ within its limit.  model: what measured it.
    tension: ρ of each vertex, by the model `tension` only.
    jacobians: float4, ∂X/∂(u, v) of the neutral for angles on the surface, or None; the stage's.
    """

    count: int
    ratios: Buffer
    axes: Buffer
    logs: Buffer
    model: str = "tensor"
    tension: Buffer | None = None
    jacobians: Buffer | None = None

    @classmethod
    def allocate(
        cls, device: Device, model: str, triangles: int, vertices: int, jacobians: Buffer | None
    ) -> StretchBuffers:
        """Room for the stretch of that many triangles, not initialised."""
        count = triangles + 1
        ratios, axes, logs = (device.empty(width * count, np.float32) for width in (2, 4, 2))
        tension = device.empty(vertices, np.float32) if model == "tension" else None
        return cls(count, ratios, axes, logs, model, tension, jacobians)

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return (self.ratios, self.axes, self.logs, self.tension)


@dataclass(frozen=True)
class LogLimit:
    """What log ρ is kept within, ±most: by a clamp, or where soft by a knee (limits.clh)."""

    most: float
    soft: bool = False

    @property
    def defines(self) -> dict[str, object]:
        """What the kernels that use it are compiled with."""
        return {"SOFT_LIMITS": 1} if self.soft else {}


class StretchModel(Protocol):
    """One way to measure stretch, with what it needs of the neutral on the device."""

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers
    ) -> None:
        """Fill `found` for the first `triangles`; the rest is unstretched."""
        ...

    def release(self) -> None:
        """Give the memory back."""
        ...


def in_two_parts(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """(F, 8) float32: up to four columns of doubles, each as a high and a low part."""
    high = values.astype(np.float32)
    low = (values - high).astype(np.float32)
    parts = np.zeros((len(values), 8), np.float32)
    columns = 2 * values.shape[1]
    parts[:, 0:columns:2], parts[:, 1:columns:2] = high, low
    return parts
