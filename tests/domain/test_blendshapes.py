"""Blendshapes: positions out of weights, against float64, and what names of several rigs mean."""

from __future__ import annotations

import numpy as np
import pytest

from rhytid.domain.blendshapes import (
    Blendshapes,
    frowning_side,
    meant_shapes,
    name_parts,
    opens_jaw,
    region_of,
    rolls_lips,
)
from rhytid.domain.expressions import Expressions
from rhytid.domain.skin import REGIONS
from rhytid.errors import FrameError, InputError

rng = np.random.default_rng(5)
NEUTRAL = rng.normal(size=(40, 3)).astype(np.float32)
SHAPES = NEUTRAL + rng.normal(size=(3, 40, 3)).astype(np.float32)
KNOWN = Expressions.checked(SHAPES, 40, ["a_L", "a_R", "b"])


def test_weights_in_the_order_of_the_shapes() -> None:
    weights = np.array([0.25, -1.5, 3.0], np.float32)
    moved = np.tensordot(weights.astype(float), SHAPES.astype(float) - NEUTRAL, 1)
    found = Blendshapes(NEUTRAL, KNOWN).positions(weights)
    assert found.dtype == np.float32
    assert np.abs(found - (NEUTRAL + moved)).max() < 1e-5


def test_one_name_moves_both_sides_and_strange_ones_nothing() -> None:
    face = Blendshapes(NEUTRAL, KNOWN, ["c", "a"])
    assert face.unknown == ("c",)
    found = face.positions(np.array([7.0, 0.5], np.float32))
    expected = NEUTRAL + 0.5 * (SHAPES[0].astype(float) - NEUTRAL + SHAPES[1] - NEUTRAL)
    assert np.abs(found - expected).max() < 1e-5
    assert np.array_equal(face.positions(np.float32([1, 0])), NEUTRAL)


def test_names_that_mean_nothing_are_refused() -> None:
    with pytest.raises(InputError, match=r"shapes: none is known; closest to AR_3 are a_R, a_L, b"):
        Blendshapes(NEUTRAL, KNOWN, ["AR_3", "d"])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1001.0])
def test_a_weight_that_cannot_be_is_named(bad: float) -> None:
    with pytest.raises(FrameError, match="weight of a_R is"):
        Blendshapes(NEUTRAL, KNOWN).positions(np.float32([0, bad, bad]))


def test_frames_have_no_names() -> None:
    assert KNOWN.named
    assert not Expressions.checked(SHAPES, 40).named


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
        ("eyeBlink.L", "eye_corner"),  # as Blender names sides
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


@pytest.mark.parametrize(
    ("name", "rolls"),
    [
        ("mouthRollLower", True),
        ("face|mouthRollUpper", True),
        ("lips_roll_in", True),
        ("mouthPucker", False),
        ("eyeRoll", False),
        ("", False),
    ],
)
def test_names_tell_rolled_lips(name: str, rolls: bool) -> None:
    assert rolls_lips(name) is rolls


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


@pytest.mark.parametrize(
    ("name", "side"),
    [
        ("browDown_L", "left"),
        ("face|BrowDownRight", "right"),
        ("browLower_l", "left"),
        ("browDown.R", "right"),
        ("L_browDown", "left"),
        ("face|R-browDown", "right"),
        ("Left_Brow_Down", "left"),
        ("browDown", ""),
        ("AU4", ""),
        ("AU04_BrowLowerer", ""),
        ("AU4_L", "left"),
        ("R_AU4", "right"),
        ("AU43", None),
        ("AU4+AU7", None),
        ("L_browInnerUp", None),
        ("browInnerUp_L", None),
        ("mouthFrown_L", None),
    ],
)
def test_the_brow_that_a_name_draws_down(name: str, side: str | None) -> None:
    assert frowning_side(name) == side


@pytest.mark.parametrize(
    ("name", "opens"),
    [("jawOpen", True), ("face|JawOpen", True), ("mouth_open", True), ("jawLeft", False)],
)
def test_the_names_that_open_a_jaw(name: str, opens: bool) -> None:
    assert opens_jaw(name) is opens
