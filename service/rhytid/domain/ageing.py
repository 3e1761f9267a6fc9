"""How skin ages between 20 and 70, as factors of what it is at 35. Sources: docs/skin.md.

Pores stay where they are; what changes is how deep, wide and directed lines are, and which lead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhytid.domain.regions import Region

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


def worn(age: float) -> float:
    """0 at 35, 1 at 65, below 0 for the young; grows with age."""
    return float(np.interp(age, _AGES, _WORN))


def deepest(age: float) -> float:
    """Factor of the depth of a wrinkle of strength 1; 1 up to 35."""
    return float(_DEEPEST ** max(worn(age), 0.0))


def folded(name: str, age: float) -> float:
    """Logarithm of the factor of `strength`, `width` or `primary` lines where skin folds without
    end; in proportion to the share of that elsewhere."""
    return float(np.log(_FOLDED[name])) * worn(age)


def aged(region: Region, age: float) -> Region:
    """The same skin at another age, its depths against the depth of that age; at 35 the same.

    Density and turn stay: no pore moves.
    """
    if age == USUAL_AGE:
        return region
    share, old = worn(age), region.old
    depth = old.strength**share / deepest(age)
    # Of pores `strength` is a factor as well as of lines.
    pores = (old.pore_strength / old.strength) ** share
    return replace(
        region,
        strength=region.strength * depth,
        pore_strength=region.pore_strength * pores,
        anisotropy=region.anisotropy * old.anisotropy**share,
        scale=region.scale * old.scale**share,
        pore_radius=region.pore_radius * old.pore_radius**share,
        contrast=region.contrast * old.contrast**share,
        grain=region.grain * old.grain**share / deepest(age),
    )
