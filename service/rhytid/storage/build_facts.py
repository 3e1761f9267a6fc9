"""What is kept of the build of an asset beside its arrays."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from rhytid.domain.warnings import InputWarning
from rhytid.errors import StoreFormatError
from rhytid.storage.records import FACTS, StoredAsset


@dataclass(frozen=True)
class BuildFacts:
    """spacing, distance: of pores, mesh units.  uv_length: mesh units that a step of 1 in UV is
    long.  warnings: of the mesh.  None: the version that built the asset did not keep it."""

    spacing: float
    distance: float | None
    uv_length: float | None
    warnings: tuple[InputWarning, ...] | None

    @classmethod
    def of(cls, stored: StoredAsset) -> BuildFacts:
        """Those of an asset; raises StoreFormatError where they are not what a build writes."""
        extra = stored.extra
        try:
            spacing = float(extra["spacing"])
            distance, uv_length = (
                None if (known := extra.get(name)) is None else float(known)
                for name in ("distance", "uv_length")
            )
            kept = extra.get("warnings")
            warnings = None if kept is None else tuple(InputWarning(**one) for one in kept)
        except (KeyError, TypeError, ValueError) as exc:
            raise StoreFormatError(f"{FACTS} is of another version of rhytid: {exc!r}") from exc
        if not (isfinite(spacing) and spacing > 0):
            raise StoreFormatError(f"{FACTS}: a spacing of {spacing} is none")
        return cls(spacing, distance, uv_length, warnings)
