"""The manifest of the precomputed maps: what a client needs to blend them (docs/binned.md)."""

from __future__ import annotations

import numpy as np

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.bin_manifest import BinManifest, CushionLayer, GrainLayer, TiltLine
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
from rhytid.pipeline.cushion import cushion_layers, cushion_steps
from rhytid.pipeline.cushion_layer import APRON
from rhytid.pipeline.grain import GRAIN, grain_amplitude, grain_exponent, relief
from rhytid.pipeline.reach import SCALE_LIMIT


def bin_manifest(settings: AssetSettings, cushion_factor: int | None) -> BinManifest:
    """Of an asset with resolved settings.  cushion_factor: texels to a sample of the cushions."""
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
        layers=_layers(settings),
        depth=settings.depth,
        sharpness=settings.shape.sharpness,
        log_stretch_limit=response.log_stretch_limit,
        scale_limit=SCALE_LIMIT,
        depth_exponents=factored if bins.depth_factored else dict.fromkeys(factored, 0.0),
        measured_in=settings.angles,
        tilt=tilt,
        soft_limits=response.soft_limits,
        pore_depth_limit=response.pore_depth_limit,
        cushion=_cushion(settings, cushion_factor),
        grain=GrainLayer(grain_exponent(settings)) if relief(settings) > 0.0 else None,
    )


def _cushion(settings: AssetSettings, factor: int | None) -> CushionLayer | None:
    if factor is None or settings.shape.cushion == 0.0:
        return None
    return CushionLayer(factor, APRON, settings.shape.cushion_sharpness)


def _layers(settings: AssetSettings) -> dict[str, int]:
    places = {**layers(settings.bins), **cushion_layers(settings)}
    found = {name: len(firsts) for name, firsts in places.items()}
    return {**found, GRAIN: 1} if relief(settings) > 0.0 else found


def _steps(settings: AssetSettings) -> dict[str, tuple[float, ...]]:
    bins, steps = settings.bins, quantisation_steps(settings)
    wrinkles, pores = (
        tuple(steps[layer, : bins.layer_samples[layer]].tolist()) for layer in (0, -1)
    )
    found = {name: pores if name.startswith("pore") else wrinkles for name in layers(bins)}
    if bins.tilt:
        found[TILTS] = (1.0 / code_limit(bins.bits),)
    for name in cushion_layers(settings):
        found[name] = tuple(cushion_steps(settings)[0, : bins.samples].tolist())
    if relief(settings) > 0.0:
        found[GRAIN] = (grain_amplitude(settings),)
    return found
