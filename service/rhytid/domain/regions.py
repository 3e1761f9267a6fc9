"""Named regions of facial skin: what sets the skin of each apart from that of the whole face.

What is measured of them, and where we had to choose, is in docs/skin.md. Angles are against the
preferred lines, which run level around the vertical axis, as relaxed skin tension lines do on the
forehead, the eyelids and the neck; Langer's lines, found on the dead, run otherwise in places.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Old:
    """Factors at 65 of what skin is at 35, where it does not fold.

    strength: of the depth of lines, pore_strength of that of pores.  anisotropy: how far lines keep
    to one direction.  scale: of the width of wrinkles.  pore_radius: of pores.  contrast: power of
    strengths; above 1 faint lines fade and leave those that are deep, farther apart.  grain: of the
    micro relief between lines.
    """

    strength: float = 1.25
    pore_strength: float = 1.0
    anisotropy: float = 1.2
    scale: float = 1.1
    pore_radius: float = 1.1
    contrast: float = 1.25
    grain: float = 1.5


@dataclass(frozen=True)
class Region:
    """Factors of synthesis, 1 = as on the whole face.

    density: of pores and wrinkles per area.  strength: of weights, and pore_strength once more of
    those of pores.  turn: degrees by which the lines turn left.  anisotropy: how far they keep to
    one direction.  bend: of how far they wind.  scale: of the width of wrinkles.  pore_radius: of
    the radius of pores.  contrast: power of weights.  grain: of the micro relief between lines.
    old: what age makes of these.
    """

    density: float = 1.0
    strength: float = 1.0
    pore_strength: float = 1.0
    turn: float = 0.0
    anisotropy: float = 1.0
    bend: float = 1.0
    scale: float = 1.0
    pore_radius: float = 1.0
    contrast: float = 1.0
    grain: float = 1.0
    old: Old = Old()


WHOLE_FACE = "face"
REGIONS: dict[str, Region] = {
    WHOLE_FACE: Region(),
    # Long level lines, coarse and deep, that hardly branch; pores of medium size.
    "forehead": Region(
        density=1.0,
        strength=1.25,
        anisotropy=1.85,
        bend=0.3,
        scale=1.2,
        pore_radius=0.9,
        old=Old(strength=1.2, contrast=1.3, grain=1.3),
    ),
    # Led by large pores; a fine net of rhombi without much of a direction, faint.
    "cheek": Region(
        density=0.85,
        strength=0.8,
        pore_strength=1.4,
        anisotropy=0.4,
        scale=0.85,
        pore_radius=1.35,
        grain=1.1,
        old=Old(strength=1.2, anisotropy=1.5, pore_radius=1.15, contrast=1.15, grain=1.3),
    ),
    # The largest pores of the face, close together; lines so faint that pores stand alone.
    "nose": Region(
        density=1.3,
        strength=0.45,
        pore_strength=3.0,
        anisotropy=0.2,
        scale=0.7,
        pore_radius=1.7,
        grain=1.2,
        old=Old(strength=1.3, anisotropy=1.0, pore_strength=1.2, contrast=1.1, grain=1.8),
    ),
    # Furrows across the lip, upright and fine, joined by faint ones; next to no pores to see.
    "lip": Region(
        density=1.6,
        strength=1.1,
        pore_strength=0.6,
        turn=90.0,
        anisotropy=1.5,
        bend=0.6,
        scale=0.9,
        pore_radius=0.35,
        grain=0.7,
        old=Old(strength=1.3, anisotropy=1.0, contrast=1.15, grain=1.4),
    ),
    # Thin skin: fine lines that fan out from the corner, beside the eye nearly level; small pores.
    "eye_corner": Region(
        density=1.5,
        strength=1.2,
        pore_strength=0.8,
        anisotropy=1.8,
        bend=0.4,
        scale=0.85,
        pore_radius=0.5,
        grain=0.8,
        old=Old(strength=1.6, scale=1.2, contrast=1.5, grain=1.8),
    ),
    # A wide net of rhombi, longer than high, that age deepens as a whole; small pores.
    "neck": Region(
        density=0.8,
        strength=1.1,
        anisotropy=1.0,
        bend=0.5,
        scale=1.0,
        pore_radius=0.7,
        grain=1.2,
        old=Old(strength=2.1, anisotropy=1.1, contrast=1.0, grain=1.2),
    ),
}
