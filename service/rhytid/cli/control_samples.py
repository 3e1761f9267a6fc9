"""Every control of the look at a low, a middle and a high value, to be seen beside each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.painted_maps import CONTROLS, NEUTRALS
from rhytid.domain.setting_fields import nested

STIFFNESS = "stiffness"
# Masks, and the greys that they are shown in.
MASKS = (*CONTROLS, STIFFNESS)
_GREYS = {"black": 0.0, "mid grey": 0.5, "white": 1.0}
# 45 degrees to either side, and factors of 1/2 and 2: the ends are the same lines, and effects.
_QUARTERS = {"dark grey, 0.25": 0.25, "mid grey": 0.5, "light grey, 0.75": 0.75}
_OTHER_GREYS = {
    # From a quarter of the density down there are no pores, and no skin to show.
    "density": {"dark grey, 0.3": 0.3, "mid grey": 0.5, "white": 1.0},
    **dict.fromkeys(("turn", "scale", "pore_radius"), _QUARTERS),
}
# Settings by their dotted names; lengths in millimetres.
SETTINGS: dict[str, tuple[float, float, float]] = {
    "graph.age": (20, 35, 70),
    "graph.spacing": (0.35, 0.5, 0.7),
    "depth": (0.0375, 0.075, 0.15),
    "shape.cushion": (0, 0.7, 1),
    "shape.cushion_width": (2, 3.3, 6),
    "shape.cushion_sharpness": (1, 5, 12),
    "shape.grain": (0, 0.02, 0.1),
    "shape.grain_size": (0.1, 0.2, 0.6),
    "shape.undulation": (0, 0.18, 0.5),
    "shape.undulation_size": (3, 6, 12),
    "shape.wave_amplitude": (0, 0.05, 0.15),
    "shape.wrinkle_bulge": (0, 1, 4),
    "shape.pore_bulge": (0, 2, 4),
    "shape.curvature": (0, 0.5, 1),
    "shape.taper": (0, 0.5, 1),
    "shape.sharpness": (3, 8, 20),
    "shape.slots": (1, 4, 16),
    "response.alpha_w": (0, 1, 3),
    "response.alpha_d": (0, 4, 8),
    "response.beta_w": (0, 4, 8),
    "response.beta_d": (0, 10, 20),
    "response.pore_depth_limit": (1.1, 1.25, 3),
}
NAMES = (*MASKS, *SETTINGS)
# Settings by their names alone, but for those that masks have, too.
_SHORT = {name.rpartition(".")[2]: name for name in SETTINGS}
# What else is set where a control by itself shows little.
_LINES_ALONE = {"shape.cushion": 0.0}
_COMPANIONS: dict[str, dict[str, float]] = {
    "shape.cushion_sharpness": {"shape.cushion": 1.0},
    "shape.grain_size": {"shape.grain": 0.1},
    "shape.undulation_size": {"shape.undulation": 0.5},
    "shape.wave_amplitude": _LINES_ALONE,
    "shape.wrinkle_bulge": _LINES_ALONE,
    "shape.curvature": _LINES_ALONE,
    "shape.taper": _LINES_ALONE,
    "response.beta_w": {"response.pore_depth_limit": 3.0},
    "response.beta_d": {"response.pore_depth_limit": 3.0},
}
# Usual values that are None until an asset is built, in millimetres.
_RESOLVED = {
    "graph.spacing": 0.5,
    "depth": 0.075,
    "shape.grain_size": 0.2,
    "shape.undulation_size": 6.0,
}
_LENGTHS = (*_RESOLVED, "shape.wave_amplitude")


@dataclass(frozen=True)
class ControlSample:
    """A control at one value.

    label: of the value, in brackets where it is the usual one.  settings: of an asset, nested, but
    for what is the same in all samples.  grey: of the mask, from 0 to 1, None for a setting.
    """

    name: str
    label: str
    settings: Mapping[str, Any]
    grey: float | None = None

    @property
    def pressed(self) -> bool:
        """Whether it shows on stretched skin alone."""
        return is_pressed(self.name)


def is_pressed(name: str) -> bool:
    """Whether a control shows on stretched skin alone."""
    return name == STIFFNESS or name.startswith("response.")


def title(name: str) -> str:
    """A control's name, and what is not as usual in its samples."""
    others = [f"at {other} {value:g}" for other, value in _COMPANIONS.get(name, {}).items()]
    parts = [f"mask {name}" if name in MASKS else name, *others]
    return ", ".join([*parts, *(["skin pressed"] if is_pressed(name) else [])])


def samples(name: str, unit_mm: float) -> tuple[ControlSample, ...]:
    """A control at its values.  name: of NAMES.  unit_mm: millimetres in a mesh unit."""
    if name not in MASKS:
        return tuple(_setting(name, value, unit_mm) for value in SETTINGS[name])
    usual = 1.0 if name == STIFFNESS else NEUTRALS[name]
    return tuple(
        ControlSample(name, f"[{label}]" if grey == usual else label, {}, grey)
        for label, grey in _OTHER_GREYS.get(name, _GREYS).items()
    )


def _setting(name: str, value: float, unit_mm: float) -> ControlSample:
    usual = _RESOLVED.get(name)
    if usual is None:
        usual = attrgetter(name)(AssetSettings())
    text = f"{value:g} mm" if name in _LENGTHS else f"{value:g}"
    given = {**_COMPANIONS.get(name, {}), name: value / unit_mm if name in _LENGTHS else value}
    return ControlSample(name, f"[{text}]" if value == usual else text, nested(given))


def full_name(name: str) -> str:
    """The name of a control, which a setting may be given without its group."""
    return name if name in NAMES else _SHORT.get(name, name)
