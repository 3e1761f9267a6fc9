"""What may be asked for of a map: how it is drawn, and what its texels have."""

from __future__ import annotations

METHODS = ("neutral", "redraw", "binned", "convolved")
STRETCH_MODELS = ("tensor", "tension", "uv")
SAMPLINGS = ("nearest", "smooth")
# What a texel has: its displacement, or moments of the slopes under it.
LAYERS = DISPLACEMENT, SLOPES = ("displacement", "slopes")
