"""Texture files of displacement for the programs that read them: profiles of `rhytid bake`.

The names of profiles and of compressions are here for the command line, which lists them before
numpy is imported.
"""

from __future__ import annotations

PROFILE_NAMES = (
    "float", "half", "png16", "normal-gl", "normal-dx", "cavity", "weights", "stretch", "blood",
    "mip", "tx",
)  # fmt: skip
# Of the profiles float and half; `dwaa` is lossy.
COMPRESSIONS = ("zip", "zips", "piz", "dwaa", "zstd", "none")
