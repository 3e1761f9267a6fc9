"""Control maps as values: names, ranges, limits, and the middle of grey."""

from __future__ import annotations

import numpy as np
import pytest

from reference import controls as reference
from rhytid.domain import painted_maps
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.painted_maps import CONTROLS, REGION_MAPS, Controls, signed
from rhytid.domain.skin import REGIONS, WHOLE_FACE
from rhytid.errors import InputError, LimitError, SettingsError

ONE = np.ones((2, 3), np.float32)


def test_every_code_of_8_bits_is_as_light_as_the_reference_says():
    codes = np.arange(256, dtype=np.float32) / np.float32(255)
    wanted = [reference.signed(float(code)) for code in codes]
    np.testing.assert_allclose(signed(codes), wanted, atol=3e-7)
    assert (signed(codes)[[0, 127, 128, 255]] == [-1, 0, 0, 1]).all()
    assert (np.diff(signed(codes)) >= 0).all()


def test_arrays_and_back():
    made = Controls({"density": {1001: ONE, 1011: 0 * ONE}, "region_lip": {1001: ONE.T}})
    assert set(made.arrays()) == {"density.1001", "density.1011", "region_lip.1001"}
    again = Controls.of_arrays(made.arrays())
    assert again.arrays().keys() == made.arrays().keys()
    for name, map in made.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], map)
        assert not map.flags.writeable


def test_what_is_no_control_is_refused():
    with pytest.raises(InputError, match="unknown control map dens: one of density, strength"):
        Controls({"dens": {1001: ONE}})
    with pytest.raises(InputError, match="turn of UDIM 1002: numbers from 0 to 1"):
        Controls({"turn": {1001: ONE, 1002: 2 * ONE}})
    with pytest.raises(InputError, match="a map of region_nose is of UDIM 1002, which has no mesh"):
        Controls({"region_nose": {1002: ONE}}).check_udims((1001,))


def test_all_maps_together_have_a_limit(monkeypatch):
    monkeypatch.setattr(painted_maps, "MOST_TEXELS", 11)
    with pytest.raises(LimitError, match=r"turn: .* 12 texels in all: at most 11"):
        Controls({"density": {1001: ONE}, "turn": {1001: ONE}})


def test_every_region_has_a_mask_but_the_whole_face():
    assert [f"region_{name}" for name in REGIONS if name != WHOLE_FACE] == list(REGION_MAPS)
    assert set(REGION_MAPS) < set(CONTROLS)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"density": -1}, "graph.density is -1: from 0.0625 to 16"),
        ({"density": 0}, "graph.density is 0: from 0.0625 to 16"),
        ({"strength": 5}, "graph.strength is 5: from 0 to 4"),
        ({"anisotropy": 2.1}, "graph.anisotropy is 2.1: from 0 to 2"),
        ({"scale": float("nan")}, "graph.scale is nan: from 0.25 to 4"),
        ({"region": "chin"}, "graph.region is 'chin': one of 'face', 'forehead'"),
        ({"spacing": -1}, "graph.spacing is -1: from 1e-30 to 1e\\+30"),
        ({"space": 1}, "unknown setting graph.space"),
        ({"spacing": 0.05, "wrinkles": 1000}, "graph.wrinkles and graph.spacing: one fixes"),
    ],
)
def test_settings_out_of_range_are_refused(given, told):
    with pytest.raises(SettingsError, match=told):
        AssetSettings.parse({"graph": given})
