"""What is told of the precomputed maps: enough to blend them elsewhere (docs/binned.md)."""

from __future__ import annotations

import numpy as np

from rhytid.domain.asset_settings import AssetSettings
from rhytid.engine.messages import BinManifest, TiltLine
from rhytid.pipeline.bins import (
    TILT_NODE,
    TILT_SHARE,
    TILTS,
    code_limit,
    layers,
    quantisation_steps,
    sample_stretches,
    tilt_width,
)
from rhytid.pipeline.elements import SCALE_LIMIT


def bin_manifest(settings: AssetSettings) -> BinManifest:
    """Of an asset with resolved settings."""
    assert settings.depth is not None
    bins, response = settings.bins, settings.response
    factored = {"wrinkles": response.alpha_d, "pores": response.beta_d}
    tilt = TiltLine(TILT_NODE, TILT_SHARE, tilt_width(settings)) if bins.tilt else None
    return BinManifest(
        angles=tuple(float(np.pi * n / bins.count) for n in range(bins.count)),
        samples=tuple(sample_stretches(settings).tolist()),
        pore_samples=tuple(sample_stretches(settings, -1).tolist()),
        steps=_steps(settings),
        bits=bins.bits,
        merge=bins.merge,
        depth_factored=bins.depth_factored,
        layers={name: len(places) for name, places in layers(bins).items()},
        depth=settings.depth,
        sharpness=settings.shape.sharpness,
        log_stretch_limit=response.log_stretch_limit,
        scale_limit=SCALE_LIMIT,
        depth_exponents=factored if bins.depth_factored else dict.fromkeys(factored, 0.0),
        measured_in=settings.angles,
        tilt=tilt,
        soft_limits=response.soft_limits,
        pore_depth_limit=response.pore_depth_limit,
    )


def _steps(settings: AssetSettings) -> dict[str, tuple[float, ...]]:
    bins, steps = settings.bins, quantisation_steps(settings)
    wrinkles, pores = (
        tuple(steps[layer, : bins.layer_samples[layer]].tolist()) for layer in (0, -1)
    )
    found = {name: pores if name.startswith("pore") else wrinkles for name in layers(bins)}
    if bins.tilt:
        found[TILTS] = (1.0 / code_limit(bins.bits),)
    return found
