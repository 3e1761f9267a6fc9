"""The attributes of a displacement tile or map."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from rhytid.support.build_identity import file_attributes


@dataclass(frozen=True)
class TileHeader:
    """The attributes of a tile or map: what it shows, and where. A whole map is row 0, column 0 of
    its level.

    unit: of length.  stretch, sampling: the model and the sampling of stretch.  scale: the
    displacement, in that unit, that png stores as its largest value.
    """

    unit: str
    frame: str
    asset: str
    method: str
    stretch: str
    sampling: str
    udim: int
    level: int
    row: int
    column: int
    scale: float

    def attributes(self) -> dict[str, str | int]:
        """The attributes that are written into a file beside the texels. `scale` is not among them:
        the texels of such a file are in the unit itself."""
        values = {name: value for name, value in asdict(self).items() if name != "scale"}
        return {**values, **file_attributes()}
