"""Texture files of displacement for the programs that read them: profiles of `rhytid bake`.

The names of profiles and of compressions are here for the command line, which lists them before
numpy is imported.
"""

from __future__ import annotations

from dataclasses import dataclass

PROFILE_NAMES = (
    "float", "half", "png16", "normal-gl", "normal-dx", "cavity", "weights", "stretch", "blood",
    "slopes", "roughness", "anisotropy", "mip", "tx",
)  # fmt: skip
# Of the profiles float and half; `dwaa` is lossy.
COMPRESSIONS = ("zip", "zips", "piz", "dwaa", "zstd", "none")
# Level of `Shine` where none is given.
_USUAL_LEVEL = 2


@dataclass(frozen=True)
class Shine:
    """How the profiles slopes, roughness and anisotropy are made.

    level: of the maps, each of which has half as many texels per side as the one before; None for
    the usual one, and for normals of level 0.  roughness: that of the skin without relief.
    """

    level: int | None = None
    roughness: float = 0.35

    @property
    def of_moments(self) -> int:
        """The level."""
        return _USUAL_LEVEL if self.level is None else self.level


USUAL = Shine()
