"""Painted maps: names, ranges, limits and the middle of grey of controls; stiffness between texel
centres."""

from __future__ import annotations

import numpy as np
import pytest

from reference import controls as reference_controls
from reference import stiffness as reference_stiffness
from rhytid.domain import painted_maps
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.painted_maps import CONTROLS, REGION_MAPS, Controls, Stiffness, signed
from rhytid.domain.skin import REGIONS, WHOLE_FACE
from rhytid.domain.tiles import texel_centres
from rhytid.errors import InputError, LimitError, SettingsError

ONE = np.ones((2, 3), np.float32)


def test_every_code_of_8_bits_is_as_light_as_the_reference_says():
    codes = np.arange(256, dtype=np.float32) / np.float32(255)
    wanted = [reference_controls.signed(float(code)) for code in codes]
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


def test_all_controls_together_have_a_limit(monkeypatch):
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


RNG = np.random.default_rng(7)
SHAPES = [(1, 1), (1, 5), (7, 1), (16, 16), (13, 40)]


def painted(shape):
    return RNG.uniform(0, 1, shape).astype(np.float32)


@pytest.mark.parametrize("shape", SHAPES)
def test_points_are_bilinear_between_centres(shape):
    map, points = painted(shape), RNG.uniform(-0.1, 1.1, (200, 2))
    found = Stiffness({1001: map}).at(1001, points)
    np.testing.assert_allclose(found, reference_stiffness.bilinear(map, points), atol=3e-7, rtol=0)


def test_row_0_is_the_top_and_centres_are_exact():
    map = np.array([[0.0, 0.25], [0.5, 1.0]], np.float32)
    made = Stiffness({1011: map})
    centres = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]])
    np.testing.assert_array_equal(made.at(1011, centres), map.ravel())
    np.testing.assert_array_equal(made.texels(1011, 2, 0, 0, 2), map)
    corners = np.array([[0.0, 1.0], [1.0, 0.0]])
    np.testing.assert_array_equal(made.at(1011, corners), [0.0, 1.0])


@pytest.mark.parametrize("shape", SHAPES)
def test_texels_are_points_at_their_centres(shape):
    made = Stiffness({1001: painted(shape)})
    side, row, column, count = 64, 16, 40, 24
    u = texel_centres(column, count, side)
    v = 1.0 - texel_centres(row, count, side)
    points = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    found = made.texels(1001, side, row, column, count)
    np.testing.assert_allclose(found.ravel(), made.at(1001, points), atol=2e-7, rtol=0)
    whole = made.texels(1001, side, 0, 0, side)
    crop = whole[row : row + count, column : column + count]
    np.testing.assert_array_equal(found, crop)


def test_between_equal_texels_nothing_is_lost():
    for value in (0.0, 0.3, 1.0):
        made = Stiffness({1001: np.full((5, 3), value, np.float32)})
        assert (made.at(1001, RNG.uniform(0, 1, (500, 2))) == np.float32(value)).all()


def test_where_all_is_1_there_are_no_texels():
    map = np.ones((8, 8), np.float32)
    map[0, 0] = 0.5
    made = Stiffness({1001: map})
    assert made.texels(1001, 64, 32, 32, 32) is None
    assert made.texels(1002, 64, 0, 0, 32) is None
    assert made.texels(1001, 64, 0, 0, 32).min() == 0.5
    np.testing.assert_array_equal(made.at(1002, RNG.uniform(0, 1, (5, 2))), 1.0)


def test_maps_are_copies_that_do_not_change():
    map = painted((4, 4))
    made = Stiffness({1001: map})
    before = map[0, 0]
    map[0, 0] = 0.0
    assert made.maps[1001][0, 0] == before
    with pytest.raises(ValueError, match="read-only"):
        made.maps[1001][0, 0] = 0.0
    again = Stiffness.of_arrays(made.arrays())
    np.testing.assert_array_equal(again.maps[1001], made.maps[1001])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_codes_are_shares_of_the_largest_and_stay_codes(dtype):
    codes = RNG.integers(0, np.iinfo(dtype).max, (13, 9), endpoint=True).astype(dtype)
    floats = Stiffness({1001: codes.astype(np.float32) / np.float32(np.iinfo(dtype).max)})
    made = Stiffness({1001: codes})
    np.testing.assert_array_equal(made.maps[1001], codes, strict=True)
    points = RNG.uniform(-0.1, 1.1, (200, 2))
    np.testing.assert_array_equal(made.at(1001, points), floats.at(1001, points), strict=True)
    texels = [k.texels(1001, 64, 16, 40, 24) for k in (made, floats)]
    np.testing.assert_array_equal(*texels, strict=True)
    again = Stiffness.of_arrays(made.arrays())
    np.testing.assert_array_equal(again.maps[1001], codes, strict=True)


def test_codes_that_8_bits_hold_are_kept_in_8_bits():
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    made = Stiffness({1001: codes.astype(np.uint16) * 257})
    np.testing.assert_array_equal(made.maps[1001], codes, strict=True)
    assert not made.maps[1001].flags.writeable


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_what_stands_on_bytes_is_not_copied(dtype):
    stored = np.frombuffer(bytes(range(64)), dtype).reshape(4, -1)
    assert np.shares_memory(Stiffness({1001: stored}).maps[1001], stored)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_codes_of_a_caller_are_copied(dtype):
    codes = np.array([[3, 4]], dtype)
    view = codes[:]
    view.setflags(write=False)
    made = Stiffness({1001: view})
    codes[:] = 9
    np.testing.assert_array_equal(made.maps[1001], [[3, 4]])


@pytest.mark.parametrize("value", [-1e-7, 1.0000001, np.nan, np.inf])
def test_what_is_not_from_0_to_1_is_refused(value):
    map = painted((3, 3))
    map[1, 2] = value
    with pytest.raises(InputError, match="stiffness of UDIM 1002: numbers from 0 to 1"):
        Stiffness({1001: painted((3, 3)), 1002: map})


@pytest.mark.parametrize("map", [np.zeros((3, 3, 3)), np.zeros(3), np.zeros((0, 3))])
def test_other_shapes_are_refused(map):
    with pytest.raises(InputError, match="stiffness of UDIM 1001"):
        Stiffness({1001: map})


def test_all_stiffness_maps_together_have_a_limit(monkeypatch):
    monkeypatch.setattr(painted_maps, "MOST_TEXELS", 40)
    with pytest.raises(LimitError, match=r"UDIM 1002: .* 50 texels in all: at most 40"):
        Stiffness({1001: painted((5, 5)), 1002: painted((5, 5))})


def test_a_udim_without_mesh_is_refused():
    made = Stiffness({1002: painted((2, 2))})
    made.check_udims((1001, 1002))
    with pytest.raises(InputError, match="UDIM 1002, which has no mesh; the mesh has 1001, 1011"):
        made.check_udims((1001, 1011))
