"""What is told where an asset has other settings than were sent with the same content."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import Lengths
from rhytid.domain.setting_fields import leaves, nested
from rhytid.domain.settings_changes import settings_changed

LENGTHS = Lengths.of(0.05)
SENT: list[dict[str, Any]] = [
    {},
    {"preset": "paper"},
    {"shape": {"cushion": 0.3, "grain_size": 0.01}, "depth": 0.02},
    {"bins": {"r_max": 0.1, "depth_factored": False, "tilt": False}},
]
CHANGES: list[dict[str, Any]] = [
    {"preset": "paper"},
    {"preset": "paper", "bins": {"depth_factored": True}},
    {"preset": "best"},
    {"shape": {"cushion": 0.2}},
    {"depth": 0.5, "angles": "surface"},
    {"bins": {"r_max": 0.4}},
    {"response": {"log_stretch_limit": 0.6}, "convolve": {"sigma": 0.5}},
]


def told(present: AssetSettings, sent: AssetSettings) -> str:
    found = settings_changed("0a", present, sent, LENGTHS)
    assert [warning.code for warning in found] in ([], ["settings-changed"])
    return found[0].detail if found else ""


def test_what_is_as_sent_is_not_told() -> None:
    for sent in map(AssetSettings.parse, SENT):
        assert told(sent, sent) == told(sent.with_lengths(LENGTHS), sent) == ""


def test_settings_are_named_with_both_values_and_how_to_set_them_back() -> None:
    sent = AssetSettings()
    present = sent.with_lengths(LENGTHS).changed({"shape": {"cushion": 0.2}, "depth": 0.5})
    detail = told(present, sent)
    assert "depth is 0.5, sent was null; shape.cushion is 0.2, sent was 0.7." in detail
    assert detail.endswith('PATCH /v1/assets/0a with {"depth": null, "shape": {"cushion": 0.7}}')


def test_settings_of_the_synthesis_that_name_the_same_skin_are_no_change() -> None:
    assert told(AssetSettings(), AssetSettings.parse({"graph": {"lines": "level"}})) == ""


def test_of_many_some_are_told() -> None:
    assert "; and 11 settings more." in told(
        AssetSettings.parse({"preset": "paper"}), AssetSettings()
    )


def test_a_calibration_is_no_change_unless_its_range_was_sent() -> None:
    assert told(AssetSettings().with_r_max(0.4), AssetSettings()) == ""
    sent = AssetSettings.parse({"bins": {"r_max": 0.1}})
    assert "bins.r_max is 0.4, sent was 0.1" in told(sent.with_r_max(0.4), sent)


@given(st.sampled_from(SENT), st.lists(st.sampled_from(CHANGES), min_size=1))
def test_the_patch_that_is_told_makes_the_asset_as_sent(
    given: dict[str, Any], changes: list[dict[str, Any]]
) -> None:
    sent = AssetSettings.parse(given)
    present = sent.with_lengths(LENGTHS)
    for change in changes:
        present = present.changed(change).with_lengths(LENGTHS)
    detail = told(present, sent)
    if detail:
        patch = json.loads(detail.partition(" with ")[2])
        present = present.changed(patch).with_lengths(LENGTHS)
    assert told(present, sent) == ""
    r_max = present.bins.r_max
    assert present == sent.with_lengths(LENGTHS).with_r_max(r_max)


@pytest.mark.parametrize("settings", SENT)
def test_names_and_nesting_are_inverse(settings: dict[str, Any]) -> None:
    whole = AssetSettings.parse(settings).as_json()
    assert nested(leaves(whole)) == whole
