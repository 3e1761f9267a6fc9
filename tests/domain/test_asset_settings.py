"""Settings of an asset: what each means, what presets set, and what overrides them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rhytid.domain.asset_settings import PRESETS, AssetSettings, BinSettings
from rhytid.domain.setting_fields import settings_of
from rhytid.errors import SettingsError


def test_the_docstrings_say_what_every_setting_means() -> None:
    meanings = {setting.name: setting.meaning for setting in settings_of(AssetSettings())}

    assert [name for name, meaning in meanings.items() if not meaning] == []
    assert meanings["response.beta_w"] == "how much stretch widens a pore (Alg. 2)"
    # Of three lines in the docstring.
    assert meanings["response.ends"].startswith("how far the log stretch at the ends")
    assert meanings["response.ends"].endswith("at each end and are linear between")


def test_the_default_is_the_preset_best_and_bins_alone_are_the_papers() -> None:
    assert AssetSettings() == AssetSettings.parse({}) == AssetSettings.parse({"preset": "best"})
    assert AssetSettings().bins == PRESETS["best"].bins != PRESETS["paper"].bins == BinSettings()


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_sets_the_bins(name: str) -> None:
    settings = AssetSettings.parse({"preset": name})

    assert settings.preset == name
    assert settings.bins == PRESETS[name].bins


def test_keys_of_bins_go_before_the_preset() -> None:
    bins = AssetSettings.parse({"preset": "best", "bins": {"count": 2, "r_max": 0.3}}).bins

    assert bins == replace(PRESETS["best"].bins, count=2, r_max=0.3)


def test_a_preset_keeps_the_calibration() -> None:
    calibrated = AssetSettings().with_r_max(0.123)

    assert calibrated.changed({"preset": "best"}).bins == replace(PRESETS["best"].bins, r_max=0.123)


def test_other_changes_leave_the_bins_of_a_preset() -> None:
    best = AssetSettings.parse({"preset": "best"})

    assert best.changed({"depth": 0.5}).bins == PRESETS["best"].bins


@pytest.mark.parametrize("bins", [BinSettings(), BinSettings(count=16, merge="mellow")])
@pytest.mark.parametrize("name", PRESETS)
def test_settings_read_back_what_they_write(name: str, bins: BinSettings) -> None:
    settings = replace(AssetSettings.parse({"preset": name}), bins=bins)

    assert AssetSettings.parse(settings.as_json()) == settings


@pytest.mark.parametrize("name", ["fastest", 1, None, ["best"]])
def test_an_unknown_preset_is_refused(name: object) -> None:
    with pytest.raises(SettingsError, match=r"preset is .*'paper', 'best'"):
        AssetSettings.parse({"preset": name})


PAPER = {
    "response": {"ends": 0.0, "soft_limits": False, "pore_depth_limit": 4.0, "folds": 0.0},
    "graph": {"rank": 0.0, "patches": 0.0, "events": 0.0, "anatomy": "coarse"},
    "shape": {
        "wrinkle_bulge": 2.5,
        "curvature": 0.0,
        "taper": 0.0,
        "least_half_width": 0.0,
        "cushion": 0.0,
        "grain": 0.0,
        "undulation": 0.0,
    },
}


def test_the_preset_paper_draws_hard_and_straight() -> None:
    settings = AssetSettings.parse({"preset": "paper"}).as_json()

    for part, values in PAPER.items():
        assert {key: settings[part][key] for key in values} == values
        usual = AssetSettings().as_json()[part]
        assert all(usual[key] != value for key, value in values.items())


def test_presets_set_the_same_keys() -> None:
    for preset in PRESETS.values():
        assert {part: set(getattr(preset, part)) for part in PAPER} == {
            part: set(values) for part, values in PAPER.items()
        }


def test_a_change_of_the_preset_leaves_the_graph_as_it_was_grown() -> None:
    grown = AssetSettings.parse({"graph": {"rank": 0.5}})

    assert grown.changed({"preset": "paper"}).graph == grown.graph
    assert AssetSettings.parse({"preset": "paper", "graph": {"rank": 0.5}}).graph.rank == 0.5


def test_keys_beside_a_preset_go_before_it_and_others_stay() -> None:
    sharp = AssetSettings.parse({"shape": {"sharpness": 5.0}, "response": {"alpha_d": 3.0}})
    settings = sharp.changed({"preset": "paper", "shape": {"curvature": 0.5}})

    assert (settings.shape.curvature, settings.shape.taper) == (0.5, 0.0)
    assert (settings.shape.sharpness, settings.response.alpha_d) == (5.0, 3.0)
    assert settings.changed({"preset": "best"}) == sharp
