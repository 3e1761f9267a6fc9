"""Which shapes a name means, in the spellings that faces come with."""

from __future__ import annotations

import pytest

from rhytid.domain.blendshapes import meant_shapes, name_parts

# As of ICT FaceKit, an excerpt.
ICT = ("browInnerUp_L", "browInnerUp_R", "eyeBlink_L", "eyeBlink_R", "jawLeft", "jawOpen")


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("eyeBlinkLeft", ("eyeblink", "left")),
        ("EyeBlink_L", ("eyeblink", "left")),
        ("face|eyeBlink.l", ("eyeblink", "left")),
        ("bs:eyeBlinkL", ("eyeblink", "left")),
        ("eye_blink_right", ("eyeblink", "right")),
        ("mouthRollLower", ("mouthrolllower", "")),
        ("jawLeft", ("jaw", "left")),
        ("mouthFunnel", ("mouthfunnel", "")),
        ("L", ("l", "")),
        ("left", ("left", "")),
    ],
)
def test_parts_of_a_name(name: str, parts: tuple[str, str]) -> None:
    assert name_parts(name) == parts


def test_names_of_arkit_mean_shapes_of_other_spellings() -> None:
    wanted = ("eyeBlinkRight", "browInnerUp", "JawLeft", "jawOpen", "tongueOut", "jawRight")
    assert meant_shapes(wanted, ICT) == [(3,), (0, 1), (4,), (5,), (), ()]


def test_a_name_that_is_there_comes_before_one_that_is_spelled_alike() -> None:
    assert meant_shapes(["smile_L", "smileL"], ["smileLeft", "smile_L", "smileL"]) == [(1,), (2,)]


def test_one_side_alone_is_what_there_is_of_both() -> None:
    assert meant_shapes(["browInnerUp"], ["browInnerUp_R"]) == [(0,)]
