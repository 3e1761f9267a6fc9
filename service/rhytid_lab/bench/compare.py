"""How far two implementations of a case are apart, and how far they may be."""

from __future__ import annotations

import numpy as np

from rhytid_lab.bench.scene import Floats, Scene

# `stretch` in log stretch; maps in units of depth. A blur reads between texels: bilinear hardware
# rounds places to a 256th of a texel.
TOLERANCES = {"stretch": 1e-4, "convolved": 5e-3}
TOLERANCE = 1e-3


def tolerance(case: str) -> float:
    """The worst difference that a case may have."""
    return TOLERANCES.get(case, TOLERANCE)


def worst_difference(case: str, scene: Scene, ours: Floats, theirs: Floats) -> float:
    """The worst difference of two results, as FrameBench.result has them.

    Of maps in units of depth. Of stretch in log stretch within the limit of the response: of the
    ratios, and of the axes as what their turning changes.
    """
    if ours.shape != theirs.shape:
        raise ValueError(f"{case}: a result of shape {theirs.shape} instead of {ours.shape}")
    if case == "stretch":
        return _stretch_difference(ours, theirs, scene.settings.response.log_stretch_limit)
    found = np.abs(theirs.astype(np.float64) - ours).max(initial=0.0)
    return float(found) / scene.depth


def _stretch_difference(ours: Floats, theirs: Floats, limit: float) -> float:
    logs, other = (np.clip(np.log(s[:, :2]), -limit, limit) for s in (ours, theirs))
    apart = logs[:, 0] - logs[:, 1]
    turned = [np.abs(ours[:, i] * theirs[:, i + 1] - ours[:, i + 1] * theirs[:, i]) for i in (2, 4)]
    axes = max(float((turn * apart).max(initial=0.0)) for turn in turned)
    return max(float(np.abs(logs - other).max(initial=0.0)), axes)
