"""What the server answers, as frozen dataclasses. Keys that are not known here are left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray


@final
@dataclass(frozen=True)
class InputWarning:
    """Something that is probably wrong with what was sent.

    code: stable, as "uv-overlap".  detail: what, in plain text.  where: the mesh or the frame, and
    the place on it.
    """

    code: str
    detail: str = ""
    where: str = ""

    def __str__(self) -> str:
        return f"{self.code}: {self.where}: {self.detail}"


@final
@dataclass(frozen=True)
class Notice:
    """Something worth knowing of an asset that is no mistake.

    code: stable, as "grain-not-drawn".  detail: what, and what to do, in plain text.
    """

    code: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.code}: {self.detail}"


@dataclass(frozen=True)
class Device:
    """An OpenCL device of the server; memory in bytes, `budget` and `used` are the server's own."""

    name: str
    platform: str = ""
    kind: str = ""
    version: str = ""
    compute_units: int = 0
    memory: int = 0
    budget: int = 0
    used: int = 0
    selected: bool = False


@final
@dataclass(frozen=True)
class Job:
    """Long work. `state`: queued, running, done, failed or cancelled; `progress` from 0 to 1.

    `warnings`: of a calibration, what is probably wrong with its frame.
    """

    id: str
    state: str
    progress: float = 0.0
    stage: str = ""
    detail: str = ""
    asset: str = ""
    kind: str = ""
    warnings: tuple[InputWarning, ...] = ()

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self.state in ("done", "failed", "cancelled")


@final
@dataclass(frozen=True)
class Asset:
    """A mesh with its wrinkles. `state`: building, ready or failed (with `reason`).

    `levels` counts the levels of a map; `pores` and `wrinkles` are 0 until the graph exists.
    `statistics`, None until then, has the `spacing` of pores where density is 1, which usual
    lengths are in proportion to, their mean `distance` as it came out, both in mesh units, the mean
    `degree`, `strengths`, wrinkles by weight in tenths from 0 to 1, and `events`, numbers of single
    features by kind.  `warnings`: what is probably wrong with the mesh, in the answer to
    `create_asset` also with its frames and settings.  `notices`: what is worth knowing of its
    present settings and no mistake.
    `centre`: what the server subtracts from positions, which it keeps as float32.
    """

    id: str
    state: str
    job: str | None = None
    reason: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    udims: tuple[int, ...] = ()
    levels: int = 0
    vertices: int = 0
    triangles: int = 0
    pores: int = 0
    wrinkles: int = 0
    statistics: Mapping[str, Any] | None = None
    warnings: tuple[InputWarning, ...] = ()
    notices: tuple[Notice, ...] = ()
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def name(self) -> str | None:
        """What people call it: of the settings, at first that of the mesh's file."""
        name = self.settings.get("name")
        return None if name is None else str(name)


@dataclass(frozen=True)
class Frame:
    """A stored frame; `log_stretch` maps percentiles ("p50", "abs_p90", …) to values.

    `warnings`: what is probably wrong with it.
    """

    name: str
    log_stretch: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[InputWarning, ...] = ()


@dataclass(frozen=True)
class Bins:
    """The precomputed maps of an asset, and the numbers that blending them takes: docs/binned.md
    of the server has the formulas.

    angles: direction of each bin, radians from v towards u, θ = (sin, cos).  samples,
    pore_samples: log stretch of each sample, of wrinkles and of pores.
    steps: mesh units per code, by layer and sample.  layers: bins of each layer: wrinkles and
    pores; where merge is mellow these are the valleys, with wrinkle_bulges and pore_bulges; with
    tilts also wrinkle_tilts, of one sample, whose codes run from one edge of a bin in angle, -1, to
    the other, 1; with cushions also cushions, cushion_places and cushion_owners; with grain also
    grain, one map.
    depth: of strength 1, mesh units.  sharpness: β of the merge.  log_stretch_limit: that log ρ is
    clamped to.  scale_limit: σ stays within 1 over it and it.  depth_exponents: of wrinkles and
    pores.  measured_in: "uv" or "surface".  tilt: None, or `node`, `share` and `width`.
    soft_limits: limits are knees.  pore_depth_limit: that of σ_d of pores.
    cushion: None, or `factor`, texels to a sample, `apron`, samples more around a tile,
    `samples`, log stretches, and `exponent`.  grain: None, or `exponent`.
    """

    angles: tuple[float, ...]
    samples: tuple[float, ...]
    steps: Mapping[str, tuple[float, ...]]
    bits: int
    merge: str
    depth_factored: bool
    layers: Mapping[str, int]
    pore_samples: tuple[float, ...] = ()
    depth: float = 0.0
    sharpness: float = 0.0
    log_stretch_limit: float = 0.0
    scale_limit: float = 0.0
    depth_exponents: Mapping[str, float] = field(default_factory=dict)
    measured_in: str = "uv"
    tilt: Mapping[str, float] | None = None
    soft_limits: bool = False
    pore_depth_limit: float = 4.0
    cushion: Mapping[str, Any] | None = None
    grain: Mapping[str, float] | None = None


@dataclass(frozen=True, eq=False)
class Stretch:
    """axes (F, 2, 2) float32 with axes[f, i] = ŝᵢ in UV; ratios (F, 2) float32, unclamped; folds
    (F,) float32, the share that folds of the mesh take of negative log stretch."""

    axes: NDArray[np.float32]
    ratios: NDArray[np.float32]
    folds: NDArray[np.float32]
