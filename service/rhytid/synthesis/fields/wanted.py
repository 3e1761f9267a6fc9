"""How dense pores are to be: the spacing or the number of wrinkles, and each from the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.wording import plural
from rhytid.errors import SettingsError
from rhytid.synthesis.pores.even_skin import PACKING, SPACING

# Wrinkles per pore; a triangulation would have three.
EDGES_PER_PORE = 2.1


@dataclass(frozen=True)
class Wanted:
    """The setting that says how dense pores are, and how many wrinkles it makes where density is 1.

    value: of the setting.  wrinkles: the area over the squared spacing decides, or the setting.
    """

    setting: str
    value: float
    wrinkles: float

    @classmethod
    def of(cls, settings: GraphSettings, area: float) -> Wanted:
        """area: of the surface that carries pores, squared mesh units.

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
        """What else may be wrong where there are too many."""
        return "" if self.setting == "wrinkles" else " or more; is the unit right?"

    def at_most(self, wrinkles: float) -> str:
        """What the setting can be for no more than so many wrinkles where density is 1."""
        if self.setting == "wrinkles":
            return f"{int(wrinkles)}"
        return self._spacing(wrinkles, up=True)

    def at_least(self, wrinkles: float) -> str:
        """What the setting can be for no fewer."""
        if self.setting == "wrinkles":
            return f"graph.wrinkles of {int(np.ceil(wrinkles))} or more"
        return f"graph.spacing of {self._spacing(wrinkles, up=False)} or less; is the unit right?"

    def _spacing(self, wrinkles: float, *, up: bool) -> str:
        """To three digits, rounded to the safe side."""
        spacing = self.value * (self.wrinkles / max(wrinkles, 1e-9)) ** 0.5
        step = 10.0 ** (np.floor(np.log10(spacing)) - 2)
        return f"{step * (np.ceil if up else np.floor)(spacing / step):.3g}"
