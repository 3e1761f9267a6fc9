"""How many wrinkles settings ask for, by their number or by the spacing of pores, and a rough
estimate of what building them takes, before the build begins."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural, rough_count
from rhytid.errors import SettingsError
from rhytid.synthesis.pore_density import EDGES_PER_PORE, PACKING, SPACING
from rhytid.synthesis.seams.charts import BORDER, SIDES, neighbours

# Measured with PoCL on two cores: 20 million wrinkles take 182 s and 4.6 GB, 300,000 3.8 s and 0.6
# GB. Along UV seams wrinkles are copied: a spacing of seam takes 2 to 13 ms more.
_SECONDS, _A_WRINKLE, _A_SEAM_SPACING = 1.0, 9.5e-6, 8e-3
_BYTES, _BYTES_A_WRINKLE = 0.6e9, 210.0
# Seconds before the first pore: of leaders, and of where skin folds.
_BEGINNING = 1.2
# From this time on it is said how to have less.
LONG = 600.0
LESS = "mask the face or raise the spacing for less"


@dataclass(frozen=True)
class RequestedCount:
    """How many wrinkles settings ask for where density is 1, and the setting that says so.

    setting: "wrinkles" or "spacing".  value: of that setting.  wrinkles: the value, or what the
    spacing makes of the area of the surface.
    """

    setting: str
    value: float
    wrinkles: float

    @classmethod
    def of(cls, settings: GraphSettings, area: float) -> RequestedCount:
        """From settings.  area: of the surface that carries pores, squared mesh units.

        Raises SettingsError where neither setting is set.
        """
        if settings.wrinkles is not None:
            return cls("wrinkles", settings.wrinkles, settings.wrinkles)
        if settings.spacing is None:
            raise SettingsError("graph.spacing or graph.wrinkles must be set for a synthesis")
        pores = PACKING * area * (SPACING / settings.spacing) ** 2
        return cls("spacing", settings.spacing, EDGES_PER_PORE * pores)

    def __str__(self) -> str:
        setting = f"graph.{self.setting} is {self.value:g}"
        if self.setting == "wrinkles":
            return f"graph.wrinkles is {self.value}"
        return f"{setting} mesh units, {plural(round(self.wrinkles), 'wrinkle')} on this mesh"

    @property
    def hint(self) -> str:
        """What to add to a message about too many wrinkles."""
        return "" if self.setting == "wrinkles" else " or more; is the unit right?"

    def at_most(self, wrinkles: float) -> str:
        """The setting, in words, for no more than so many wrinkles where density is 1."""
        if self.setting == "wrinkles":
            return f"{int(wrinkles)}"
        return self._spacing(wrinkles, up=True)

    def at_least(self, wrinkles: float) -> str:
        """The setting, in words, for no fewer than so many wrinkles where density is 1."""
        if self.setting == "wrinkles":
            return f"graph.wrinkles of {int(np.ceil(wrinkles))} or more"
        return f"graph.spacing of {self._spacing(wrinkles, up=False)} or less; is the unit right?"

    def _spacing(self, wrinkles: float, *, up: bool) -> str:
        """The spacing for so many wrinkles, to three digits, rounded up or down."""
        spacing = self.value * (self.wrinkles / max(wrinkles, 1e-9)) ** 0.5
        step = 10.0 ** (np.floor(np.log10(spacing)) - 2)
        return f"{step * (np.ceil if up else np.floor)(spacing / step):.3g}"


@dataclass(frozen=True)
class BuildSize:
    """A rough estimate of what a build takes.

    wrinkles, pores: how many there will be.  seconds: on two cores.  nbytes: peak memory of the
    process.
    """

    wrinkles: int
    pores: int
    seconds: float
    nbytes: float

    @classmethod
    def of(cls, mesh: Mesh, wrinkles: int) -> BuildSize:
        """The estimate for so many wrinkles on a mesh."""
        seconds = _SECONDS + _A_WRINKLE * wrinkles + _copying(mesh, neighbours(mesh), wrinkles)
        nbytes = _BYTES + _BYTES_A_WRINKLE * wrinkles
        return cls(wrinkles, round(wrinkles / EDGES_PER_PORE), seconds, nbytes)

    @property
    def is_long(self) -> bool:
        """Whether the build takes so long that the mesh may hold more than the skin to be seen."""
        return self.seconds > LONG

    def figures(self) -> dict[str, Any]:
        """The estimate as JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        told = (
            f"about {rough_count(self.wrinkles)} wrinkles and {rough_count(self.pores)} pores, "
            f"{_time(self.seconds)} on two cores, {self.nbytes / 1e9:.2g} GB"
        )
        return f"{told}; {LESS}" if self.is_long else told


def shares_of_time(mesh: Mesh, across: NDArray[np.integer], wrinkles: int) -> tuple[float, float]:
    """The shares of the time of a synthesis that pass before the first pore, and in copying over
    seams.

    across (F, 3): the `neighbours` of the mesh.
    """
    copying = _copying(mesh, across, wrinkles)
    whole = _BEGINNING + _A_WRINKLE * wrinkles + copying
    return _BEGINNING / whole, copying / whole


def _copying(mesh: Mesh, across: NDArray[np.integer], wrinkles: int) -> float:
    """Seconds in which so many wrinkles are copied along seams."""
    area, seams = _measured(mesh, across)
    spacing = SPACING * np.sqrt(PACKING * area / max(wrinkles / EDGES_PER_PORE, 1.0))
    return float(_A_SEAM_SPACING * seams / spacing)


def _measured(mesh: Mesh, across: NDArray[np.integer]) -> tuple[float, float]:
    """The area of a mesh, and the length of its UV seams on the surface."""
    corners = mesh.positions[mesh.faces].astype(np.float64)
    a, b, c = np.moveaxis(corners, 1, 0)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    triangle, side = np.nonzero(across == BORDER)
    ends = corners[triangle[:, None], SIDES[side]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    # Both triangles at a seam have its side, at the rim of the surface one has.
    _, place = np.unique(ends.reshape(-1, 3), axis=0, return_inverse=True)
    pairs = np.sort(place.reshape(-1, 2), axis=1)
    _, first, count = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    return area, float(length[first[count > 1]].sum())


def _time(seconds: float) -> str:
    for unit, size in (("hour", 3600.0), ("minute", 60.0)):
        if seconds >= 1.5 * size:
            return plural(round(seconds / size), unit)
    return plural(max(round(seconds), 1), "second")
