"""Stretch of every triangle in a frame, by one of three models: the stretch tensor (section 2.2,
after Nagano et al. 2015), mesh tension (Raman et al. 2023), and stretch along the UV axes (Zoss et
al. 2020). Kernels: stretch.cl, tension.cl, uv_stretch.cl."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.launches import whole_groups
from rhytid.device.runtime import Device, OnFirstUse
from rhytid.domain.lengths import USUAL_UNIT
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.folding import Folding, NearbyFolds
from rhytid.pipeline.nearby import Groups, Numbers, Wanted, groups_of, united
from rhytid.pipeline.uv_vertices import unit_jacobians
from rhytid.pipeline.work import Place

# Of a work-item of stretch.cl.
TRIANGLES = 8


@dataclass(frozen=True)
class StretchBuffers(BufferGroup):
    """Stretch on the device, F triangles and one neutral entry for points in no triangle.

    count: F + 1.  ratios: float2, unclamped.  axes: float4, (ŝ₁, ŝ₂).
    logs: float2, log ρ within its limit, less what folds of the mesh take.  model: what measured
    it.  tension: ρ of each vertex, by the model `tension` only, less that, too.
    jacobians: float4, ∂X/∂(u, v) of the neutral for angles on the surface, or None; the stage's.
    taken: the share that folds take of negative logs, or None where they take nothing.
    filled: UDIMs and squares that have the stretch that they need; None: all.
    """

    count: int
    ratios: Buffer
    axes: Buffer
    logs: Buffer
    model: str = "tensor"
    tension: Buffer | None = None
    jacobians: Buffer | None = None
    taken: Buffer | None = None
    filled: set[Place | None] = field(default_factory=set, init=False)

    @classmethod
    def allocate(
        cls, device: Device, model: str, triangles: int, vertices: int, jacobians: Buffer | None,
        folds: bool = False,
    ) -> StretchBuffers:  # fmt: skip
        """Buffers for the stretch of that many triangles and vertices, not initialised.  folds:
        whether they take something."""
        count = triangles + 1
        ratios, axes, logs = (device.empty(width * count, np.float32) for width in (2, 4, 2))
        tension = device.empty(vertices, np.float32) if model == "tension" else None
        taken = device.empty(count, np.float32) if folds else None
        return cls(count, ratios, axes, logs, model, tension, jacobians, taken)

    @property
    def _buffers(self) -> tuple[Buffer | None, ...]:
        return (self.ratios, self.axes, self.logs, self.tension, self.taken)


@dataclass(frozen=True)
class NearbyTriangles(BufferGroup):
    """The triangles whose stretch is wanted, the last of them none, their groups, and what is found
    for their folds; None where these take nothing."""

    numbers: Wanted
    groups: Groups
    folds: NearbyFolds | None = None

    @property
    def _buffers(self) -> tuple[Wanted | NearbyFolds | None, ...]:
        return self.numbers, self.groups, self.folds


class StretchStage:
    """The triangles of an asset, ready to be stretched by any model."""

    def __init__(self, device: Device, mesh: Mesh, unit: str = USUAL_UNIT) -> None:
        """unit: of the mesh, for the size of its folds."""
        self._device = device
        self.triangles = len(mesh.faces)
        self._neutral = mesh.positions
        self._faces = device.upload(mesh.faces)
        self._jacobians = device.upload(_surface_jacobians(mesh))
        self._tensor = Tensor(device, mesh)
        # They take long on dense meshes, and few ask for the other models.
        fold = partial(Folding, device, mesh, self._faces, self._tensor.rest, unit)
        self._folding = OnFirstUse(device, fold)
        self._others: dict[str, OnFirstUse[StretchModel]] = {
            "tension": OnFirstUse(device, partial(Tension, device, mesh)),
            "uv": OnFirstUse(device, partial(UvStretch, device, mesh)),
        }

    def run(
        self,
        positions: NDArray[np.float32] | None,
        limit: float,
        model: str = "tensor",
        angles: str = "uv",
        soft: bool = False,
        folds: float = 0.0,
    ) -> StretchBuffers:
        """The stretch of deformed positions (V, 3), or for None that of the neutral, which is 1 by
        definition.

        limit: of |log ρ|.  model: "tensor", "tension" or "uv".  angles: whether directions are
        compared in "uv" or on the "surface".  soft: log stretch goes to its limit by a knee.
        folds: factor of what folds of the mesh take of log stretch; 0 leaves it.
        """
        found = self.unfilled(positions, model, angles, folds)
        self.fill(found, positions, limit, soft, folds)
        return found

    def unfilled(
        self, positions: NDArray[np.float32] | None, model: str, angles: str, folds: float
    ) -> StretchBuffers:
        """Buffers for `fill`, with the arguments of `run`."""
        jacobians = self._jacobians if angles == "surface" else None
        if positions is None:  # it is unstretched in every model
            model, folds = "tensor", 0.0
        counts = self.triangles, len(self._neutral)
        return StretchBuffers.allocate(self._device, model, *counts, jacobians, folds > 0.0)

    def fill(
        self,
        found: StretchBuffers,
        positions: NDArray[np.float32] | None,
        limit: float,
        soft: bool = False,
        folds: float = 0.0,
        near: NearbyTriangles | None = None,
    ) -> None:
        """Fill what `unfilled` has made, with the arguments of `run`.  near: what is wanted, by the
        model `tensor` of a deformed frame; None: all."""
        # The neutral frame is unstretched by definition, in every model, without rounding errors.
        deformed = positions is not None
        frame = self._device.upload_again(positions if positions is not None else self._neutral)
        triangles, within = self.triangles if deformed else 0, LogLimit(limit, soft)
        wanted = Wanted(found.count) if near is None else near.numbers
        if found.model == "tensor":
            self._tensor.launch(frame, self._faces, triangles, within, found, wanted)
        else:
            measure = self._others[found.model].get()
            measure.launch(frame, self._faces, triangles, within, found)
        if found.taken is not None:
            of_folds = None if near is None else near.folds
            into = (found.logs, found.tension, found.taken)
            self._folding.get().take(frame, folds, *into, wanted, of_folds)
        frame.release()

    def nearby(self, triangles: Numbers, folds: float) -> NearbyTriangles:
        """For `fill`: some triangles, and none.  folds: as of `run`."""
        own, none = triangles[triangles < self.triangles], np.array([self.triangles], np.int32)
        every = np.concatenate([own, none])
        return NearbyTriangles(
            Wanted.upload(self._device, every, TRIANGLES),
            Groups.upload(self._device, united([groups_of(every)])),
            self._folding.get().nearby(own) if folds > 0.0 else None,
        )

    def read(self, found: StretchBuffers) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(ratios (F, 2) unclamped, axes (F, 2, 2) with axes[f, i] = ŝᵢ) on the host."""
        ratios = self._device.read(found.ratios, (self.triangles, 2), np.float32)
        axes = self._device.read(found.axes, (self.triangles, 2, 2), np.float32)
        return ratios, axes

    def read_taken(self, found: StretchBuffers) -> NDArray[np.float32]:
        """(F,) on the host: the share that folds take of negative log stretch."""
        if found.taken is None:
            return np.zeros(self.triangles, np.float32)
        return self._device.read(found.taken, (self.triangles,), np.float32)

    def release(self) -> None:
        """Give the memory back."""
        for part in (self._faces, self._jacobians, self._tensor, self._folding):
            part.release()
        for model in self._others.values():
            model.release()


def _surface_jacobians(mesh: Mesh) -> NDArray[np.float32]:
    """(F + 1, 4) J of each neutral triangle; the identity, whose angles are those of UV, for
    triangles without area and for the last entry, which stands for none."""
    jacobians, used, _ = unit_jacobians(mesh)
    found = np.tile(np.array([1, 0, 0, 1], np.float32), (len(jacobians) + 1, 1))
    found[:-1][used] = jacobians[used]
    return found


def r_max_of(ratios: NDArray[np.float32], limit: float) -> float:
    """The calibrated maximal log stretch (section 2.4): the 90th percentile of |log ρ|,
    unclamped, over all triangles and both axes, kept within [0.01, limit]."""
    with np.errstate(divide="ignore"):
        size = np.abs(np.log(ratios.astype(np.float64)))
    # Between two infinities there is no percentile; far beyond the limit one number does as well.
    return float(np.clip(np.percentile(np.minimum(size, 1e6), 90.0), 0.01, limit))


@dataclass(frozen=True)
class LogLimit:
    """The limit of log ρ, ±most, kept by a clamp, or where soft by a knee (limits.clh)."""

    most: float
    soft: bool = False

    @property
    def defines(self) -> dict[str, object]:
        """The defines of kernels that use the limit."""
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


@dataclass(frozen=True)
class Rest:
    """The rest shape of every triangle, from which its stretch is measured; made once in double.

    shape: (F, 8) float32: 1/l, d/l, 1/h, each as a high and a low part; l is the length of the
    first edge, (d, h) the second edge in its frame. All zero for a triangle without usable area.
    frame_to_uv: (F, 4) float32: the matrix from that frame to UV, row by row.
    """

    shape: NDArray[np.float32]
    frame_to_uv: NDArray[np.float32]

    @classmethod
    def of(cls, mesh: Mesh) -> Rest:
        """The rest shapes of a mesh; every length is in mesh units."""
        usable = mesh.usable_triangles()
        corners = mesh.positions[mesh.faces].astype(np.float64)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        length = np.where(usable, np.linalg.norm(first, axis=1), 1.0)
        d = np.where(usable, np.sum(first * second, axis=1) / length, 0.0)
        h = np.where(usable, np.linalg.norm(np.cross(first, second), axis=1) / length, 1.0)
        values = np.stack([1.0 / length, d / length, 1.0 / h], axis=1) * usable[:, None]
        return cls(in_two_parts(values), _frame_to_uv(mesh, length, d, h))


def _frame_to_uv(
    mesh: Mesh, length: NDArray[np.float64], d: NDArray[np.float64], h: NDArray[np.float64]
) -> NDArray[np.float32]:
    # B A⁻¹: A = [[l, d], [0, h]] holds the edges in the frame, B the same edges in UV. Only the
    # direction of its columns counts, so it is scaled to stay inside float32.
    corners = mesh.triangle_uv()
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = first / length[:, None]
    across = (second - along * d[:, None]) / h[:, None]
    matrix = np.stack([along[:, 0], across[:, 0], along[:, 1], across[:, 1]], axis=1)
    size = np.abs(matrix).max(axis=1, keepdims=True)
    return np.where(size > 0, matrix / np.where(size > 0, size, 1.0), 0.0).astype(np.float32)


class Tensor:
    """The stretch tensor of every triangle (section 2.2, after Nagano et al. 2015).

    rest: shapes of `Rest`, (F, 8) on the device.
    """

    def __init__(self, device: Device, mesh: Mesh) -> None:
        rest = Rest.of(mesh)
        self._device = device
        self.rest = device.upload(rest.shape)
        self._frame_to_uv = device.upload(rest.frame_to_uv)

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers,
        wanted: Wanted | None = None,
    ) -> None:  # fmt: skip
        """Fill `found` for the first `triangles`; the rest is unstretched.  wanted: of all; None:
        all."""
        wanted = wanted or Wanted(found.count)
        self._device.launch(
            "stretch", "stretch_tensor", (whole_groups(-(-wanted.items // TRIANGLES)),),
            wanted.numbers, frame, faces, self.rest, self._frame_to_uv,
            np.int32(triangles), np.int32(wanted.items), np.float32(limit.most),
            found.ratios, found.axes, found.logs,
            defines=limit.defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        self.rest.release()
        self._frame_to_uv.release()


class Tension:
    """Mesh tension, an isotropic stretch (Raman et al. 2023): per vertex the mean ratio of the
    lengths of its edges, per triangle the mean of their logs."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        offsets, neighbours, rest = edges_by_vertex(mesh)
        self._device = device
        self._vertices = len(mesh.positions)
        self._edges = (device.upload(offsets), device.upload(neighbours), device.upload(rest))

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers
    ) -> None:
        """Fill `found` for the first `triangles`; the rest is unstretched."""
        self._device.launch(
            "tension", "vertex_tension", (self._vertices,), frame, *self._edges, found.tension
        )
        self._device.launch(
            "tension", "stretch_tension", (found.count,),
            found.tension, faces, np.int32(triangles), np.float32(limit.most),
            found.ratios, found.axes, found.logs, defines=limit.defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self._edges:
            buffer.release()


def edges_by_vertex(
    mesh: Mesh,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """The edges of each vertex: offsets (V + 1,), the other ends (2E,), 1 / neutral length (2E,).

    An edge counts once however many triangles share it. One without length does not count, nor
    one so short that no float32 holds the inverse of its length.
    """
    pairs = np.stack([mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)], axis=1)
    edges = np.unique(np.sort(pairs, axis=1), axis=0)
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    ends = mesh.positions[both].astype(np.float64)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    usable = length >= np.finfo(np.float32).tiny
    both, length = both[usable], length[usable]
    count = np.bincount(both[:, 0], minlength=len(mesh.positions))
    offsets = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return offsets, both[:, 1].astype(np.int32), (1.0 / length).astype(np.float32)


class UvStretch:
    """Stretch along the UV axes (Zoss et al. 2020): ρ_u = |J'e_u| / |J e_u| and ρ_v likewise, with
    J = ∂X/∂(u, v); the axes are those of UV."""

    def __init__(self, device: Device, mesh: Mesh) -> None:
        self._device = device
        self._weights = device.upload(in_two_parts(uv_weights(mesh)))

    def launch(
        self, frame: Buffer, faces: Buffer, triangles: int, limit: LogLimit, found: StretchBuffers
    ) -> None:
        """Fill `found` for the first `triangles`; the rest is unstretched."""
        self._device.launch(
            "uv_stretch", "stretch_uv", (found.count,),
            frame, faces, self._weights, np.int32(triangles), np.float32(limit.most),
            found.ratios, found.axes, found.logs, defines=limit.defines,
        )  # fmt: skip

    def release(self) -> None:
        """Give the memory back."""
        self._weights.release()


def uv_weights(mesh: Mesh) -> NDArray[np.float64]:
    """(F, 4): (a, b) with J e_u / |J e_u| = a e₁ + b e₂ of the neutral edges, then for e_v.

    All zero for a triangle without usable area.
    """
    usable = mesh.usable_triangles()
    uv = mesh.triangle_uv()
    edges_uv = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=2)
    edges_uv[~usable] = np.eye(2)
    # Column 0 of the inverse holds the weights of e_u, column 1 those of e_v.
    weights = np.linalg.inv(edges_uv)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    length = np.linalg.norm(edges @ weights, axis=1)
    scaled = weights / np.where(usable[:, None], length, 1.0)[:, None, :]
    return np.concatenate([scaled[:, :, 0], scaled[:, :, 1]], axis=1) * usable[:, None]


def in_two_parts(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """(F, 8) float32: up to four columns of doubles, each as a high and a low part."""
    high = values.astype(np.float32)
    low = (values - high).astype(np.float32)
    parts = np.zeros((len(values), 8), np.float32)
    columns = 2 * values.shape[1]
    parts[:, 0:columns:2], parts[:, 1:columns:2] = high, low
    return parts
