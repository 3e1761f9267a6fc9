"""Roughness from moments of slopes, and the files of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from exports.textures.patches import all_triangles
from exports.textures.reading import read_texture
from exports.textures.test_texture_files import MESH, MOMENTS, SIDE, frame_map
from rhytid.errors import QueryError
from rhytid.exports.textures import Shine
from rhytid.exports.textures.frame_map import FrameMap
from rhytid.exports.textures.profiles import profiles_of
from rhytid.exports.textures.shine import gloss, gltf_anisotropy, interpolated, mean_normals

BASE = 0.4
CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


def cloud(angle: float, along: float, across: float, mean: tuple[float, float]) -> np.ndarray:
    """Moments of slopes with these deviations along an axis and across it."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    second = turn @ np.diag([along**2, across**2]) @ turn.T + np.outer(mean, mean)
    return np.array([*mean, second[0, 0], second[0, 1], second[1, 1]], np.float32)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.5, -1.2])
def test_roughness_is_that_of_the_axes_of_the_covariance(angle: float) -> None:
    found = gloss(cloud(angle, 0.3, 0.1, (0.2, -0.1)), BASE)

    wanted = np.sqrt(BASE**4 + 2 * np.array([0.3, 0.1]) ** 2)
    np.testing.assert_allclose(found.alpha, wanted, rtol=1e-5)
    np.testing.assert_allclose(found.axis, [np.cos(angle), np.sin(angle)], atol=1e-4)
    np.testing.assert_allclose(found.roughness**2, found.alpha, rtol=1e-6)


def test_without_relief_it_is_the_base() -> None:
    found = gloss(np.zeros((2, 5), np.float32), BASE)

    np.testing.assert_allclose(found.roughness, BASE, rtol=1e-6)
    np.testing.assert_array_equal(gltf_anisotropy(found), 0.0)


def test_the_strength_of_gltf_gives_alpha_back() -> None:
    """alpha along is mix(alpha across, 1, strength²): KHR_materials_anisotropy."""
    found = gloss(cloud(0.3, 0.4, 0.05, (0, 0)), BASE)

    share = gltf_anisotropy(found) ** 2
    np.testing.assert_allclose(found.alpha[1] * (1 - share) + share, found.alpha[0], rtol=1e-5)


def test_a_microfacet_cloud_has_the_variance_of_its_parts() -> None:
    """Beckmann's slopes have the variance alpha² / 2 an axis; those of the relief are added."""
    rng = np.random.default_rng(2)
    relief = rng.standard_normal((200_000, 2)) * [0.3, 0.1]
    facets = rng.standard_normal((200_000, 2)) * BASE**2 / np.sqrt(2)

    found = gloss(cloud(0.0, 0.3, 0.1, (0, 0)), BASE)

    variance = np.var(relief + facets, axis=0)
    np.testing.assert_allclose(found.alpha**2 / 2, variance, rtol=0.02)


def test_the_normal_is_that_of_the_mean_slope() -> None:
    x, y, z = mean_normals(cloud(0.3, 0.4, 0.05, (0.5, -0.25)))

    np.testing.assert_allclose([-x / z, -y / z], [0.5, -0.25], rtol=1e-6)


def test_what_a_linear_filter_takes_from_the_means_is_given_back() -> None:
    """Gauss' two points an axis are exact for products of bilinear functions."""
    moments = np.random.default_rng(3).standard_normal((5, 6, 5)).astype(np.float32)
    means = np.pad(moments[..., :2].astype(np.float64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    lost = np.zeros((5, 6, 2, 2))
    for down, right in product((0, 1), repeat=2):
        corners = [means[down + i : down + i + 5, right + j : right + j + 6] for i, j in CORNERS]
        for share in product((0.5 - 12**-0.5, 0.5 + 12**-0.5), repeat=2):
            weights = [abs(1 - i - share[0]) * abs(1 - j - share[1]) for i, j in CORNERS]
            seen = sum(w * m for w, m in zip(weights, corners, strict=True))
            all_of_it = sum(
                w * m[..., None] * m[..., None, :] for w, m in zip(weights, corners, strict=True)
            )
            lost += (all_of_it - seen[..., None] * seen[..., None, :]) / 16

    found = interpolated(moments)

    np.testing.assert_array_equal(found[..., :2], moments[..., :2])
    wanted = np.stack([lost[..., 0, 0], lost[..., 0, 1], lost[..., 1, 1]], -1)
    np.testing.assert_allclose(found[..., 2:] - moments[..., 2:], wanted, atol=2e-6)


@pytest.mark.parametrize("name", ["slopes", "roughness", "anisotropy", "normal-gl"])
def test_files_are_of_their_level(name: str, tmp_path: Path) -> None:
    (profile,) = profiles_of([name], how=Shine(2, BASE))
    file = tmp_path / profile.file_name("face", 1002, "0007")
    drawn = frame_map(MESH, all_triangles(MESH, SIDE))

    profile.write(file, drawn, profile.all_facts(drawn))

    found = read_texture(file, 0)
    assert found.texels.shape[:2] == (SIDE // 4, SIDE // 4)
    assert str(found.attributes["level"]) == "2"
    moments = MOMENTS[0]
    if name == "slopes":
        order = [("x", "y", "xx", "xy", "yy").index(c.split(".")[1]) for c in found.channels]
        np.testing.assert_array_equal(found.texels, moments[..., order])
        return
    values, seen = found.texels / 65535.0, interpolated(moments)
    wanted = {
        "roughness": np.pad(gloss(seen, BASE).roughness, ((0, 0), (0, 0), (0, 1))),
        "anisotropy": np.concatenate(
            [
                gloss(seen, BASE).axis / 2 + 0.5,
                gltf_anisotropy(gloss(seen, BASE))[..., None],
            ],
            axis=-1,
        ),
        "normal-gl": mean_normals(moments) / 2 + 0.5,
    }[name]
    np.testing.assert_allclose(values, wanted, atol=1e-5)


def test_two_profiles_of_a_map_take_its_slopes_once(tmp_path: Path) -> None:
    """Other settings, and other maps, have their own."""
    asked: list[int] = []

    def counted(map: FrameMap) -> FrameMap:
        def slopes(level: int) -> tuple[np.ndarray, np.ndarray]:
            asked.append(level)
            return map.slopes(level)

        return replace(map, slopes=slopes)

    def written(name: str, map: FrameMap, shine: Shine) -> bytes:
        [profile] = profiles_of([name], how=shine)
        profile.write(tmp_path / name, map, profile.all_facts(map))
        return (tmp_path / name).read_bytes()

    names, shine, other = ("roughness", "anisotropy"), Shine(2, BASE), Shine(2, 0.2)
    plain = frame_map(MESH, all_triangles(MESH, SIDE))
    alone = [written(name, replace(plain), shine) for name in names]
    map = counted(plain)
    assert [written(name, map, shine) for name in names] == alone
    assert asked == [2]
    written("roughness", map, shine)
    assert written("anisotropy", map, other) != alone[1]
    assert asked == [2] * 3
    written("anisotropy", counted(plain), other)
    assert asked == [2] * 4


def test_level_0_has_no_roughness() -> None:
    with pytest.raises(QueryError, match="level 0"):
        profiles_of(["roughness"], how=Shine(0))
    assert profiles_of(["slopes", "normal-gl"], how=Shine(0))


def test_files_are_baked_again_for_what_they_are_made_of_alone() -> None:
    names = ["slopes", "normal-gl", "roughness", "anisotropy"]
    one, rougher, coarser = (
        [profile.key for profile in profiles_of(names, how=how)]
        for how in (Shine(2, BASE), Shine(2, BASE + 0.1), Shine(3, BASE))
    )
    same = [a == b for a, b in zip(one, rougher, strict=True)]
    kept = dict(zip((p.name for p in profiles_of(names)), same, strict=True))
    assert kept == {"normal-gl": True, "slopes": True, "roughness": False, "anisotropy": False}
    assert not set(one) & set(coarser)
