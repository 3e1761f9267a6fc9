"""Which region of the skin a named expression shows: names as of ARKit, and others for the same."""

from __future__ import annotations

import re

# Beginnings of names, in lower case, without what is not a letter.
_BEGINNINGS = {
    "forehead": (
        *("browinnerup", "browouterup", "browraise", "browsraise", "browup", "browsup"),
        *("raisebrow", "raiseeyebrow", "eyebrowraise", "eyebrowup", "eyebrowsup"),
    ),
    "eye_corner": (
        *("eyeblink", "eyesquint", "eyeclose", "eyesclose", "eyelidclose", "blink", "squint"),
        "closeeye",
    ),
    "lip": ("mouthpucker", "mouthfunnel", "pucker", "lippucker", "lipspucker", "kiss", "funnel"),
    "cheek": (
        *("cheekpuff", "cheeksquint", "cheekraise", "cheeksraise", "cheekup", "puffcheek"),
        *("raisecheek", "mouthsmile", "smile"),
    ),
    "nose": ("nosesneer", "sneer", "nosewrinkle", "wrinklenose", "nosescrunch"),
    "neck": ("jawopen", "openjaw", "jawdrop", "dropjaw", "mouthopen", "openmouth"),
}
_SEPARATED = re.compile(r"[.:|/]")


def region_of(name: str) -> str | None:
    """The region that an expression of that name shows best; None where it shows none.

    A prefix that ends in a dot, a colon, a bar or a slash is ignored, as in `face|eyeBlink_L`. A
    sneer shows the nose and an open jaw the neck by what they move around these.
    """
    plain = re.sub(r"[^a-z]", "", _SEPARATED.split(name)[-1].lower())
    for region, beginnings in _BEGINNINGS.items():
        if plain.startswith(beginnings):
            return region
    return None
