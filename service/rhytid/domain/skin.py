"""Facial skin: what sets its regions apart, and how it ages between 20 and 70.

Regions are factors of what the whole face is, ages are factors of what skin is at 35. What is
measured of both, and where we had to choose, is in docs/skin.md. Angles are against the preferred
lines, which run level around the vertical axis, as relaxed skin tension lines do on the forehead,
the eyelids and the neck; Langer's lines, found on the dead, run otherwise in places. Pores stay
where they are as skin ages; lines change in depth, width, direction and contrast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

YOUNGEST, USUAL_AGE, OLDEST = 20.0, 35.0, 70.0
# How much skin is worn at an age: 0 at 35, 1 at 65. Lines at the corner of the eye deepen rapidly
# from 40 on and hardly after 60. How much younger skin lacks is by eye.
_AGES = (YOUNGEST, USUAL_AGE, 40.0, 60.0, 65.0, OLDEST)
_WORN = (-1.2, 0.0, 0.15, 0.9, 1.0, 1.05)
# The depth of strength 1 at 65, of that at 35: strengths leave no room above the deepest lines.
_DEEPEST = 1.6
# At 65, where skin folds without end, and by the share of that elsewhere: factors of the strength
# and the width of lines, and of how strong primary lines are.
_FOLDED = {"strength": 2.2, "width": 1.3, "primary": 1.35}


@dataclass(frozen=True)
class Old:
    """What skin is at 65 as factors of what it is at 35, where it does not fold.

    strength: of the depth of lines.  pore_strength: of the depth of pores.  anisotropy: of how far
    lines keep to one direction.  scale: of the width of wrinkles.  pore_radius: of the radius of
    pores.  contrast: of the power of strengths; above 1 faint lines fade, and the deep ones that
    are left stand farther apart.  grain: of the micro relief between lines.  undulation: of the
    broad swells, beside that they deepen as lines do.  patchiness: of how far patches differ. Of
    both, before 35 they are as at 35.  young: of the depth of lines at 20, beside what the rest
    makes of it there.
    """

    strength: float = 1.25
    pore_strength: float = 1.0
    anisotropy: float = 1.2
    scale: float = 1.1
    pore_radius: float = 1.1
    contrast: float = 1.25
    grain: float = 1.5
    undulation: float = 1.0
    patchiness: float = 1.0
    young: float = 1.0


@dataclass(frozen=True)
class Region:
    """Factors of synthesis in a region; 1 is as on the whole face.

    density: of pores and wrinkles per area.  strength: of all weights.  pore_strength: once more of
    the weights of pores.  turn: degrees by which lines turn left.  slant: degrees by which the main
    lines run to the right of that and of folds; half the angle between both families lays their
    rhombi along these.  anisotropy: of how far lines keep to one direction.  bend: of how far lines
    wind.  scale: of the width of wrinkles.  pore_radius: of the radius of pores.  contrast: power
    of the weights.  grain: of the micro relief between lines.  undulation: of the broad swells.
    folded: power of what folds make of the strength of lines, primary ones too: below 1 skin that
    folds is smoother at rest.  patchiness: how far patches of some millimetres differ.  leading: of
    how far skin that folds has leaders, at any age.  crossed: of how far it has long level ones,
    too, whatever else folds it.  rings: how far it has long soft lines around the vertical axis.
    rhombi: how far it has lines of some millimetres that slant to either side of the preferred ones
    and cross.  creases: how far it has upright ones close together, as lips do.  uneven: how far
    lines between leaders differ by chance from those beside them, and leaders stay as narrow with
    age.  rays: how far age draws rays from its border, where that is the outer corner of an eye.
    event_patches: how far events that follow patches, as bumps do, are lower in quiet ones, and
    higher in lively ones.  old: what age makes of the others.
    """

    density: float = 1.0
    strength: float = 1.0
    pore_strength: float = 1.0
    turn: float = 0.0
    slant: float = 0.0
    anisotropy: float = 1.0
    bend: float = 1.0
    scale: float = 1.0
    pore_radius: float = 1.0
    contrast: float = 1.0
    grain: float = 1.0
    undulation: float = 1.0
    folded: float = 1.0
    patchiness: float = 1.0
    leading: float = 1.0
    crossed: float = 0.0
    rings: float = 0.0
    rhombi: float = 0.0
    creases: float = 0.0
    uneven: float = 0.0
    rays: float = 0.0
    event_patches: float = 0.0
    old: Old = Old()


WHOLE_FACE = "face"
REGIONS: dict[str, Region] = {
    # Between the brows, too: at 20 nothing is seen there at rest, later the pair of a frown, which
    # higher swells would drown.
    WHOLE_FACE: Region(old=Old(undulation=0.69, young=0.6)),
    # Long level lines, coarse and deep, that hardly branch; pores of medium size.
    "forehead": Region(
        density=1.0,
        strength=1.15,
        pore_strength=0.9,
        anisotropy=1.85,
        bend=0.3,
        scale=1.08,
        pore_radius=1.2,
        grain=1.15,
        undulation=0.85,
        patchiness=2.5,
        leading=1.3,
        crossed=1.3,
        old=Old(strength=1.2, contrast=1.3, grain=1.3, undulation=0.69, patchiness=0.4),
    ),
    # Led by large pores; a fine net of rhombi without much of a direction, faint.
    "cheek": Region(
        density=0.85,
        strength=0.63,
        pore_strength=1.4,
        anisotropy=0.4,
        scale=0.85,
        pore_radius=1.35,
        grain=1.1,
        undulation=0.93,
        patchiness=0.35,
        leading=0.4,
        old=Old(strength=1.2, anisotropy=1.5, pore_radius=1.15, contrast=1.15, grain=1.3),
    ),
    # The largest pores of the face, close together; lines so faint that pores stand alone.
    "nose": Region(
        density=1.3,
        strength=0.45,
        pore_strength=1.5,
        anisotropy=0.2,
        scale=0.7,
        pore_radius=1.8,
        grain=1.2,
        undulation=1.7,
        patchiness=0.7,
        leading=0.25,
        old=Old(strength=1.3, anisotropy=1.0, pore_strength=1.2, contrast=1.1, grain=1.8),
    ),
    # Furrows across the lip, upright and deep, next to none across them; next to no pores to see.
    # Folds turn lines less here than elsewhere: a pucker and a smile fold lips in all directions.
    "lip": Region(
        density=0.18,
        strength=4.4,
        pore_strength=0.6,
        turn=90.0,
        anisotropy=5.0,
        bend=0.2,
        scale=0.75,
        pore_radius=0.2,
        grain=0.7,
        undulation=2.4,
        leading=0.2,
        creases=1.0,
        patchiness=1.2,
        old=Old(strength=1.3, anisotropy=1.0, contrast=1.15, grain=1.4),
    ),
    # Thin skin: fine lines that fan out from the corner, beside the eye nearly level; small pores.
    "eye_corner": Region(
        density=1.7,
        strength=1.75,
        pore_strength=1.0,
        anisotropy=1.8,
        bend=0.4,
        scale=0.74,
        pore_radius=0.5,
        grain=0.8,
        patchiness=1.2,
        undulation=1.8,
        leading=0.9,
        rays=1.0,
        old=Old(strength=1.6, scale=1.2, contrast=1.5, grain=1.8, undulation=0.6),
    ),
    # A wide net of rhombi, longer than high, that age deepens as a whole; small pores. Both
    # families slant: along the folds of a neck, which are level, and across them they were a
    # fabric. Fine lines are faint between the rhombi, for strong ones were scales.
    "neck": Region(
        density=0.57,
        strength=0.85,
        slant=36.0,
        anisotropy=0.85,
        bend=0.5,
        scale=0.68,
        pore_radius=0.7,
        grain=1.2,
        undulation=1.6,
        folded=0.35,
        patchiness=1.0,
        leading=0.12,
        rings=1.0,
        rhombi=1.0,
        event_patches=1.0,
        pore_strength=1.5,
        old=Old(
            strength=2.1, pore_strength=1.0, anisotropy=1.1, contrast=1.0, grain=1.2, young=1.4
        ),
    ),
    # Around the lips, and the chin: short slants, soft and broad, between pores of medium size. The
    # mouth folds more than all else of the face, and shows little of it at rest.
    "mouth": Region(
        density=0.5,
        strength=1.48,
        pore_strength=1.08,
        anisotropy=2.0,
        scale=1.12,
        pore_radius=1.1,
        grain=1.2,
        undulation=1.65,
        folded=0.35,
        patchiness=1.15,
        leading=0.85,
        uneven=1.0,
        old=Old(
            strength=3.0,
            pore_strength=1.2,
            anisotropy=1.3,
            contrast=1.2,
            grain=1.4,
            undulation=0.75,
            young=1.53,
        ),
    ),
}
# How finely regions are told apart.
ANATOMIES = FINE, COARSE = ("fine", "coarse")
# What regions are where the mouth is none of its own, beside undulation and folds of 1.
_COARSE: dict[str, dict[str, Any]] = {
    WHOLE_FACE: {"old": Old()},
    "forehead": {
        "strength": 1.25,
        "pore_strength": 1.0,
        "scale": 1.2,
        "pore_radius": 0.9,
        "grain": 1.0,
        "patchiness": 2.6,
        "old": Old(strength=1.2, contrast=1.3, grain=1.3, patchiness=0.4),
    },
    "cheek": {"strength": 0.8},
    "nose": {"strength": 0.45, "pore_strength": 3.0, "pore_radius": 1.7, "patchiness": 0.9},
    "lip": {
        "density": 1.6,
        "strength": 1.1,
        "anisotropy": 1.5,
        "bend": 0.6,
        "scale": 0.9,
        "pore_radius": 0.35,
        "patchiness": 0.6,
        "creases": 0.0,
    },
    "eye_corner": {
        "density": 1.5,
        "strength": 1.2,
        "pore_strength": 0.8,
        "scale": 0.85,
        "rays": 0.0,
        "old": Old(strength=1.6, scale=1.2, contrast=1.5, grain=1.8),
    },
    "neck": {
        "density": 0.8,
        "strength": 1.1,
        "slant": 0.0,
        "anisotropy": 1.0,
        "rhombi": 0.0,
        "pore_strength": 1.0,
        "scale": 1.0,
        "leading": 1.2,
        "patchiness": 3.3,
        "event_patches": 0.0,
        "old": Old(strength=2.1, anisotropy=1.1, contrast=1.0, grain=1.2),
    },
    "mouth": {
        "density": 0.6,
        "strength": 1.85,
        "pore_strength": 0.65,
        "anisotropy": 0.9,
        "scale": 1.25,
        "patchiness": 0.8,
        "leading": 0.55,
        "uneven": 0.0,
        "old": Old(strength=1.6, pore_strength=1.3, anisotropy=1.3, contrast=1.2, grain=1.4),
    },
}


def regions(anatomy: str) -> Mapping[str, Region]:
    """The regions by name, as finely told apart as one of `ANATOMIES` says."""
    if anatomy == FINE:
        return REGIONS
    return {
        name: replace(region, undulation=1.0, folded=1.0, **_COARSE.get(name, {}))
        for name, region in REGIONS.items()
    }


def aged(region: Region, age: float) -> Region:
    """A region at another age; at 35 it is the region itself.

    Its strengths are relative to the depth of strength 1 at that age (`depth_factor`). Density and
    turn stay, for no pore moves.
    """
    if age == USUAL_AGE:
        return region
    share, old = wear(age), region.old
    # Less contrast would lift the faint lines of young skin as high as at 35.
    worn = max(share, 0.0)
    young = old.young ** max(share / _WORN[0], 0.0)
    depth = young * old.strength**share / depth_factor(age)
    # Of pores `strength` is a factor as well as of lines.
    pores = (old.pore_strength / old.strength) ** share / young
    return replace(
        region,
        strength=region.strength * depth,
        pore_strength=region.pore_strength * pores,
        anisotropy=region.anisotropy * old.anisotropy**share,
        scale=region.scale * old.scale**share,
        pore_radius=region.pore_radius * old.pore_radius**share,
        contrast=region.contrast * old.contrast**worn,
        grain=region.grain * old.grain**share / depth_factor(age),
        undulation=region.undulation * old.undulation**worn,
        patchiness=region.patchiness * old.patchiness**worn,
    )


def wear(age: float) -> float:
    """How worn skin is at an age: 0 at 35, 1 at 65, below 0 before 35."""
    return float(np.interp(age, _AGES, _WORN))


def depth_factor(age: float) -> float:
    """Factor of the depth of a wrinkle of strength 1 at an age; 1 up to 35."""
    return float(_DEEPEST ** max(wear(age), 0.0))


def fold_factor_log(name: str, age: float) -> float:
    """Logarithm of the factor of `strength`, `width` or `primary` lines at an age where skin folds
    most; elsewhere it holds in proportion to how much skin folds."""
    return float(np.log(_FOLDED[name])) * wear(age)
