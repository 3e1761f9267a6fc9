"""Which region an expression shows, by names of several rigs."""

from __future__ import annotations

import pytest

from rhytid.domain.blendshapes import region_of
from rhytid.domain.skin import REGIONS


@pytest.mark.parametrize(
    ("name", "region"),
    [
        ("browInnerUp", "forehead"),
        ("browOuterUp_L", "forehead"),
        ("Brow_Raise.001", None),  # what stands before the dot is passed over
        ("brow_raise", "forehead"),
        ("Eyebrow Up Left", "forehead"),
        ("eyeBlinkRight", "eye_corner"),
        ("blendShape1.eyeBlink_L", "eye_corner"),
        ("Face|squint", "eye_corner"),
        ("EYE_CLOSE_R", "eye_corner"),
        ("mouthPucker", "lip"),
        ("Mouth-Funnel", "lip"),
        ("pucker", "lip"),
        ("noseSneer_L", "nose"),
        ("Nose Wrinkle R", "nose"),
        ("cheekPuff", "cheek"),
        ("cheekSquintLeft", "cheek"),
        ("mouthSmile_R", "cheek"),
        ("smile", "cheek"),
        ("jawOpen", "neck"),
        ("jaw_open", "neck"),
        ("browDown_L", None),
        ("eyeLookUp_L", None),
        ("jawLeft", None),
        ("cheekSuck", None),
        ("0001", None),
        ("", None),
    ],
)
def test_names_show_their_region(name: str, region: str | None) -> None:
    assert region_of(name) == region
    assert region is None or region in REGIONS
