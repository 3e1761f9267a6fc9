"""What age makes of skin, as factors of what it is at 35."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import Lengths
from rhytid.domain.skin import (
    OLDEST,
    REGIONS,
    USUAL_AGE,
    YOUNGEST,
    Old,
    Region,
    aged,
    depth_factor,
    fold_factor_log,
    regions,
    wear,
)
from rhytid.errors import SettingsError

DOCS = Path(__file__).parents[2] / "docs" / "skin.md"
AGES = [YOUNGEST, 27.5, USUAL_AGE, 42.0, 50.0, 58.0, 65.0, OLDEST]


def test_at_35_nothing_differs() -> None:
    assert all(aged(region, 35.0) is region for region in REGIONS.values())
    assert wear(35.0) == 0.0
    assert depth_factor(35.0) == 1.0
    assert Lengths.of(0.3, 35.0) == Lengths.of(0.3)
    assert all(fold_factor_log(name, 35.0) == 0.0 for name in ("strength", "width", "primary"))
    assert AssetSettings().graph.age == 35.0


@pytest.mark.parametrize("name", REGIONS)
def test_lines_deepen_with_age_and_no_region_grows_smooth(name: str) -> None:
    skins = [aged(REGIONS[name], age) for age in AGES]
    depths = [skin.strength * depth_factor(age) for skin, age in zip(skins, AGES, strict=True)]
    assert depths == sorted(depths)
    assert depths[-1] > 1.15 * REGIONS[name].strength > depths[0]
    for key in ("scale", "pore_radius", "contrast", "anisotropy"):
        values = [getattr(skin, key) for skin in skins]
        assert values == sorted(values), key
    grains = [skin.grain * depth_factor(age) for skin, age in zip(skins, AGES, strict=True)]
    assert grains == sorted(grains)
    assert grains[6] == pytest.approx(REGIONS[name].grain * REGIONS[name].old.grain)
    # Pores of regions without folds: as deep as their own factor says.
    pores = [
        s.strength * s.pore_strength * depth_factor(age) for s, age in zip(skins, AGES, strict=True)
    ]
    region = REGIONS[name]
    wanted = region.strength * region.pore_strength * region.old.pore_strength
    assert pores[6] == pytest.approx(wanted)


def test_no_pore_moves_with_age() -> None:
    fixed = {"density", "turn", "bend", "folded", "leading", "old"}
    kept = {field.name for field in fields(REGIONS["face"])} & fixed
    for region in REGIONS.values():
        for age in AGES:
            assert all(getattr(aged(region, age), n) == getattr(region, n) for n in kept)


@pytest.mark.parametrize("name", REGIONS)
def test_faint_lines_of_young_skin_are_no_deeper_than_at_35(name: str) -> None:
    young, usual = aged(REGIONS[name], YOUNGEST), REGIONS[name]
    for weight in (0.02, 0.1, 0.5):
        assert young.strength * weight**young.contrast <= usual.strength * weight**usual.contrast


def test_patches_of_old_skin_differ_less_and_those_of_young_skin_as_at_35() -> None:
    region = REGIONS["forehead"]
    assert aged(region, 65.0).patchiness == region.patchiness * region.old.patchiness
    assert aged(region, 20.0).patchiness == region.patchiness > aged(region, 50.0).patchiness


@pytest.mark.parametrize("name", ["forehead", "eye_corner"])
def test_swells_of_skin_that_folds_one_way_stay_as_high_as_at_35(name: str) -> None:
    """They are a share of the depth, which grows: raised brows made bark of them, and beside the
    eye they would drown the lines of a smile."""
    region = REGIONS[name]
    assert aged(region, 20.0).undulation == region.undulation
    height = aged(region, 65.0).undulation * depth_factor(65.0)
    assert height == pytest.approx(region.undulation, rel=0.15)
    assert aged(REGIONS["cheek"], 65.0).undulation == REGIONS["cheek"].undulation


def test_lines_deepen_by_region_in_the_order_that_was_measured() -> None:
    """The order of Takema et al. 1997, of the regions that they and we have."""
    found = {n: aged(r, 65.0).strength / r.strength for n, r in REGIONS.items()}
    assert found["eye_corner"] > found["lip"] >= found["cheek"]
    # The forehead, which they have above the cheek, deepens by its folds.
    assert found["eye_corner"] > found["forehead"]


def test_ageing_is_rapid_from_40_to_60_and_slow_after() -> None:
    rates = [(wear(b) - wear(a)) / (b - a) for a, b in ((35, 40), (40, 60), (60, 70))]
    assert rates[1] > rates[0] > rates[2] > 0.0


@pytest.mark.parametrize("age", [19.9, 70.1, -1, "old", None, True])
def test_other_ages_are_refused(age: object) -> None:
    with pytest.raises(SettingsError, match=r"graph\.age is .*"):
        AssetSettings.parse({"graph": {"age": age}})


def test_the_bounds_are_taken() -> None:
    for age in (20, 70):
        assert AssetSettings.parse({"graph": {"age": age}}).graph.age == age


def even(region: Region) -> Region:
    return replace(region, undulation=1.0, folded=1.0)


def test_lines_alone_are_what_young_skin_lacks_more_of() -> None:
    skin = Region(strength=2.0, old=Old(strength=1.3, pore_strength=1.1, young=0.5))
    plain = replace(skin, old=replace(skin.old, young=1.0))
    for age, share in ((YOUNGEST, 1.0), (27.5, 0.5), (USUAL_AGE, 0.0), (65.0, 0.0)):
        found, usual = aged(skin, age), aged(plain, age)
        assert found.strength == pytest.approx(0.5**share * usual.strength), age
        # Of pores `strength` is a factor, too.
        pores = usual.strength * usual.pore_strength
        assert found.strength * found.pore_strength == pytest.approx(pores), age
        assert replace(found, strength=0, pore_strength=0, old=plain.old) == replace(
            usual, strength=0, pore_strength=0
        )


def test_coarse_regions_are_these() -> None:
    """Skin without a mouth of its own is grown from these figures, whatever the others become."""
    names = ("density", "strength", "pore_strength", "anisotropy", "scale", "pore_radius", "grain")
    wanted = {
        "face": (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
        "forehead": (1.0, 1.25, 1.0, 1.85, 1.2, 0.9, 1.0),
        "cheek": (0.85, 0.8, 1.4, 0.4, 0.85, 1.35, 1.1),
        "nose": (1.3, 0.45, 3.0, 0.2, 0.7, 1.7, 1.2),
        "lip": (1.6, 1.1, 0.6, 1.5, 0.9, 0.35, 0.7),
        "eye_corner": (1.5, 1.2, 0.8, 1.8, 0.85, 0.5, 0.8),
        "neck": (0.8, 1.1, 1.0, 1.0, 1.0, 0.7, 1.2),
        "mouth": (0.6, 1.85, 0.65, 0.9, 1.25, 1.1, 1.2),
    }
    found = regions("coarse")
    for name, figures in wanted.items():
        assert tuple(getattr(found[name], n) for n in names) == figures, name
    assert all(even(region) == region for region in found.values())
    old = {n: r.old for n, r in REGIONS.items()}
    old["face"] = Old()
    old["neck"] = replace(old["neck"], pore_strength=1.0, young=1.0)
    old["mouth"] = replace(old["mouth"], strength=1.6, pore_strength=1.3, undulation=1.0, young=1.0)
    for name in ("forehead", "eye_corner"):
        old[name] = replace(old[name], undulation=1.0)
    assert {n: r.old for n, r in found.items()} == old
    assert not any(region.event_patches for region in found.values())
    others = (found["lip"].bend, found["lip"].patchiness, found["neck"].bend)
    assert others == (0.6, 0.6, 0.5)
    patchiness = {n: found[n].patchiness for n in ("forehead", "nose", "eye_corner", "neck")}
    assert patchiness == {"forehead": 2.6, "nose": 0.9, "eye_corner": 1.2, "neck": 3.3}
    assert (found["neck"].leading, found["mouth"].leading) == (1.2, 0.55)
    assert all(region.creases == region.uneven == 0.0 for region in found.values())
    assert regions("fine") is REGIONS


def test_the_docs_tell_these_numbers() -> None:
    tables = [
        [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in block.splitlines()]
        for block in DOCS.read_text(encoding="utf-8").split("\n\n")
        if block.startswith("| region |")
    ]
    coarse = {n: r for n, r in regions("coarse").items() if r != even(REGIONS[n])}
    old = {name: region.old for name, region in REGIONS.items()}
    for (keys, _, *rows), skin in zip(tables[:3], (REGIONS, coarse, old), strict=True):
        assert [row[0] for row in rows] == list(skin)
        for name, *values in rows:
            region = skin[name]
            assert [float(v) for v in values] == [getattr(region, key) for key in keys[1:]], name
