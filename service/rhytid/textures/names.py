"""The names of the profiles, for the command line, which lists them before anything is imported."""

from __future__ import annotations

PROFILE_NAMES = (
    "float", "half", "png16", "normal-gl", "normal-dx", "cavity", "weights", "mip", "tx",
)  # fmt: skip
