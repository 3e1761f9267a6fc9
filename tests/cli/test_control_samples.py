"""Every control of the look is shown at three values, or left out for a reason."""

from __future__ import annotations

from dataclasses import fields
from operator import attrgetter
from typing import Any

import pytest

from rhytid.cli.control_samples import MASKS, NAMES, SETTINGS, full_name, samples, title
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import MILLIMETRES
from rhytid.domain.painted_maps import CONTROLS

# What is not shown, and why.
LEFT_OUT = {
    "graph.wrinkles": "fixes the spacing",
    "graph.seed": "gives another skin, no other look",
    "graph.neighbours": "costs time, shows little",
    "graph.lines": "needs expressions",
    "graph.region": "its masks are shown",
    "graph.rank": "needs expressions",
    "graph.anatomy": "needs expressions",
    "graph.patches": "varies over more skin than a sample has",
    "response.log_stretch_limit": "is for slivers",
    "response.ends": "shows in motion",
    "response.folds": "shows in motion",
    "response.soft_limits": "shows in motion",
    "shape.least_half_width": "is in texels",
    "shape.wave_frequency": "changes nothing at the usual amplitude of 0",
}


def test_every_setting_of_the_look_is_shown_or_left_out_for_a_reason() -> None:
    groups = ("graph", "response", "shape")
    names = [f"{g}.{f.name}" for g in groups for f in fields(getattr(AssetSettings(), g))]
    masked = {f"graph.{name}" for name in CONTROLS}
    assert set(names) == {*SETTINGS, *LEFT_OUT} - {"depth"} | (masked & set(names))
    assert not set(SETTINGS) & {*LEFT_OUT, *masked}


def test_every_mask_is_shown() -> None:
    assert set(MASKS) == {*CONTROLS, "stiffness"}
    assert len(NAMES) == len(set(NAMES)) == len(MASKS) + len(SETTINGS)


@pytest.mark.parametrize("name", NAMES)
def test_values_rise_and_are_accepted(name: str) -> None:
    for unit in ("mm", "cm", "m"):
        shown = samples(name, MILLIMETRES[unit])
        values = [_value(sample) for sample in shown]
        assert len(values) == 3
        assert values == sorted(set(values))
        assert [AssetSettings.parse(sample.settings) for sample in shown]


def _value(sample: Any) -> float:
    if sample.grey is not None:
        return float(sample.grey)
    value = sample.settings
    for part in sample.name.split("."):
        value = value[part]
    return float(value)


@pytest.mark.parametrize("name", ["graph.spacing", "depth", "shape.grain_size"])
def test_lengths_are_those_of_the_unit(name: str) -> None:
    millimetres = [_value(sample) for sample in samples(name, 1.0)]
    assert millimetres == list(SETTINGS[name])
    assert [10 * _value(s) for s in samples(name, 10.0)] == pytest.approx(millimetres)
    assert all(sample.label.strip("[]").endswith(" mm") for sample in samples(name, 10.0))


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
def test_brackets_are_around_the_usual_value(unit: str) -> None:
    # What an asset of that unit has once it is built.
    grown = AssetSettings(unit=unit).for_synthesis()
    usual = grown.resolved(grown.graph.spacing or 0.0)
    marked = 0
    for name in SETTINGS:
        for sample in samples(name, MILLIMETRES[unit]):
            is_usual = _value(sample) == pytest.approx(attrgetter(name)(usual))
            assert sample.label.startswith("[") is is_usual, (name, sample.label)
            marked += is_usual
    assert marked == len(SETTINGS)


def test_masks_that_change_nothing_are_in_brackets() -> None:
    labels = {name: [s.label for s in samples(name, 10.0)] for name in MASKS}
    assert labels["scale"] == ["dark grey, 0.25", "[mid grey]", "light grey, 0.75"]
    assert labels["direction"] == labels["region_lip"] == ["[black]", "mid grey", "white"]
    assert labels["stiffness"] == ["black", "mid grey", "[white]"]
    # Darker there are no pores; black and white turn lines to the same side.
    assert [s.grey for s in samples("density", 10.0)] == [0.3, 0.5, 1.0]
    assert [s.grey for s in samples("turn", 10.0)] == [0.25, 0.5, 0.75]


def test_titles_say_what_else_is_set() -> None:
    assert title("turn") == "mask turn"
    assert title("depth") == "depth"
    assert title("stiffness") == "mask stiffness, skin pressed"
    assert title("shape.grain_size") == "shape.grain_size, at shape.grain 0.1"
    (sample, *_) = samples("shape.grain_size", 10.0)
    assert sample.settings == {"shape": {"grain": 0.1, "grain_size": pytest.approx(0.01)}}


def test_what_shows_on_stretched_skin_alone() -> None:
    pressed = {name for name in NAMES if samples(name, 10.0)[0].pressed}
    assert pressed == {"stiffness", *(n for n in SETTINGS if n.startswith("response."))}


def test_a_setting_may_be_named_without_its_group() -> None:
    assert [full_name(name) for name in ("age", "grain", "graph.age")] == [
        "graph.age", "shape.grain", "graph.age",
    ]  # fmt: skip
    assert [full_name(name) for name in (*NAMES, "none")] == [*NAMES, "none"]
