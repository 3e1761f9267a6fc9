"""Percentiles of log stretch: those of numpy, after the clamp was changed too."""

from __future__ import annotations

import numpy as np
import pytest

from engine.engines import built, new_asset
from meshes import deform
from pipeline.scenes import sheet
from rhytid.engine.frames import LogStretch

BENT = deform(sheet().positions, 3, 0.15)


def plain(ratios, limit):
    """By numpy alone, in double."""
    with np.errstate(divide="ignore"):
        logs = np.clip(np.log(ratios.astype(np.float64)), -limit, limit)
    found = {f"p{p}": np.percentile(logs, p) for p in (1, 10, 50, 90, 99)}
    return {**found, "abs_p90": np.percentile(np.abs(logs), 90)}


@pytest.mark.parametrize("triangles", [1, 2, 7, 1000])
@pytest.mark.parametrize("limit", [0.01, 0.3, 4.0])
def test_percentiles_are_those_of_the_clamped_values(triangles, limit):
    ratios = np.exp(np.random.default_rng(1).normal(0, 0.3, (triangles, 2))).astype(np.float32)
    ratios[0, 1] = 0.0
    found = LogStretch.of(ratios).percentiles(limit)
    assert found == pytest.approx(plain(ratios, limit), rel=1e-12, abs=1e-300)


def test_percentiles_of_stored_frames_follow_the_clamp(engine):
    asset = built(engine, new_asset())
    put = engine.frames.put(asset, "bent", BENT).log_stretch
    ratios = engine.frames.stretch(asset, "bent").ratios
    assert put == pytest.approx(plain(ratios, 0.5), rel=1e-12)
    for limit in (0.05, 2.0):
        changes = {"response": {"log_stretch_limit": limit}, "bins": {"r_max": 0.04}}
        engine.assets.change(asset, changes)
        wanted = plain(ratios, limit)
        assert engine.frames.info(asset, "bent").log_stretch == pytest.approx(wanted, rel=1e-12)
        listed = {info.name: info.log_stretch for info in engine.frames.all(asset)}
        assert listed["bent"] == pytest.approx(wanted, rel=1e-12)
        assert set(listed["neutral"].values()) == {0.0}
        assert (wanted["abs_p90"] == limit) == (limit == 0.05)
