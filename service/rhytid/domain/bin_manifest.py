"""What precomputed maps are, and the numbers that blending them takes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TiltLine:
    """How the depth of a bin depends on its tilts (docs/binned.md).

    node: how far from the middle of a bin, as a share of the way to its edge, σ_d is taken.
    share: depths were scaled by 1 ± this from edge to edge in the two drawings that tilts are made
    from.  width: what half widths were scaled by in these.
    """

    node: float
    share: float
    width: float


@dataclass(frozen=True)
class CushionLayer:
    """How the samples of the cushions are placed under texels, and merged (docs/binned.md).

    factor: texels to a sample.  apron: samples more on every side of a tile.  sharpness: β.
    """

    factor: int
    apron: int
    sharpness: float


@dataclass(frozen=True)
class GrainLayer:
    """How grain follows a frame (docs/binned.md).  exponent: of its gain over log ρ."""

    exponent: float


@dataclass(frozen=True)
class BinManifest:
    """The precomputed maps of an asset, in the order of `bin_tile`'s indices, and all numbers that
    blending them takes (docs/binned.md).

    angles (N,): bin directions αₙ = πn/N in radians from v towards u; θₙ = (sin αₙ, cos αₙ).
    samples (M,), pore_samples: log stretch of each sample, of wrinkles and of pores.
    layers: {"wrinkles": N, "pores": 1}; where merge
    is mellow these are the valleys, and {"wrinkle_bulges": N, "pore_bulges": 1} the bulges; with
    tilts {"wrinkle_tilts": N}, of one sample, from one edge of a bin in angle, -1, to the other, 1,
    which is the one of larger angle. With cushions {"cushions": N}, coarse;
    with grain {"grain": 1}, of one sample, always int8.
    steps: displacement per code, mesh units, by layer and sample; of tilts their unit.
    depth: of strength 1, mesh units.  sharpness: β of the merge.  log_stretch_limit: that log ρ is
    clamped to.  scale_limit: σ stays within 1/scale_limit and scale_limit.  depth_exponents: by
    layer, wrinkles and pores, of the σ_d that blending multiplies by; 0 where maps have it.
    soft_limits: limits are knees.  pore_depth_limit: that of σ_d of pores.
    measured_in: where angles are taken, "uv" or "surface".  tilt: None without tilts.  cushion,
    grain: None without.
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
