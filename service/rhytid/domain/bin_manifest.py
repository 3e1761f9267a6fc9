"""What the precomputed maps of an asset are, and all numbers that blending takes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TiltLine:
    """How the depth of a bin depends on its tilts (docs/binned.md).

    node: where σ_d is taken, as a share of the way from the middle of a bin to its edge.
    share: tilts are made of two drawings in which depths were scaled by 1 ± `share` from edge to
    edge.  width: factor of the half widths in these drawings.
    """

    node: float
    share: float
    width: float


@dataclass(frozen=True)
class CushionLayer:
    """How the samples of the cushions lie under texels, and how they are blended (docs/binned.md).

    factor: texels per sample.  apron: further samples on every side of a tile.  samples: log
    stretch of each map.  exponent: of σ_d, which codes are multiplied by.
    """

    factor: int
    apron: int
    samples: tuple[float, ...]
    exponent: float


@dataclass(frozen=True)
class GrainLayer:
    """How grain follows a frame (docs/binned.md).  exponent: of its gain, over log ρ."""

    exponent: float


@dataclass(frozen=True)
class BinManifest:
    """The precomputed maps of an asset, in the order of `bin_tile`'s indices, and all numbers that
    blending them takes (docs/binned.md).

    angles: (N,) bin directions αₙ = πn/N in radians from v towards u; θₙ = (sin αₙ, cos αₙ).
    samples: (M,) log stretch of each sample of wrinkles.  pore_samples: the same of pores.
    layers: number of maps by layer: {"wrinkles": N, "pores": 1}, of which the valleys alone where
    `merge` is mellow, with {"wrinkle_bulges": N, "pore_bulges": 1} for the bulges. With tilts
    {"wrinkle_tilts": N}, of one sample: from -1 at the edge of a bin of smaller angle to 1 at the
    other. With cushions {"cushions": 1, "cushion_places": 1, "cushion_owners": 1}, coarse; the
    last two have one sample, owners are int32, rows of the graph. With grain {"grain": 1}, of one
    sample, always int8. With events {"events": 1}, of the neutral, int8 too: the sum of two maps, a
    coarse one, sample 0, and a fine one; `binned` itself has events anew in each frame.
    steps: displacement per code by layer and sample, mesh units; the step of tilts has no unit.
    bits: per code.  merge, depth_factored: as in the settings.  depth: of strength 1, mesh units.
    sharpness: β of the merge.  log_stretch_limit: log ρ is clamped to it.  scale_limit: σ stays
    within 1/scale_limit and scale_limit.  depth_exponents: of the σ_d that blending multiplies by,
    for wrinkles, pores and events; 0 where maps contain σ_d.  measured_in: where angles are taken,
    "uv" or "surface".  tilt, cushion, grain: None without them.  soft_limits: limits bend in place
    of clamping.  pore_depth_limit: limit of σ_d of pores and events.
    """

    angles: tuple[float, ...]
    samples: tuple[float, ...]
    steps: dict[str, tuple[float, ...]]
    bits: int
    merge: str
    depth_factored: bool
    layers: dict[str, int]
    pore_samples: tuple[float, ...]
    depth: float
    sharpness: float
    log_stretch_limit: float
    scale_limit: float
    depth_exponents: dict[str, float]
    measured_in: str
    tilt: TiltLine | None
    soft_limits: bool
    pore_depth_limit: float
    cushion: CushionLayer | None
    grain: GrainLayer | None
