"""Normals, roughness and its anisotropy from moments of slopes, and their files.

The slopes under a texel have a mean m and a covariance C = E[s sᵀ] - m mᵀ. The mean is the normal
(-m_x, -m_y, 1). A microfacet distribution of roughness alpha (GGX, Beckmann) adds to them:
Beckmann's has the variance alpha² / 2 of slopes along an axis, and variances add, so

    alpha_i² = alpha_0² + 2 sigma_i²

along the eigenvectors of C, whose eigenvalues are sigma_1² >= sigma_2² (Olano and Baker 2010, "LEAN
mapping"; Dupuy et al. 2013, "LEADR mapping"; 2 sigma² after Heitz 2014, "Understanding the
masking-shadowing function", 5.3). GGX has no variance: there it is the usual approximation. alpha
is the square of what shaders call roughness: OpenPBR, Standard Surface, Principled BSDF and glTF
agree.

Renderers interpolate normals between texels, which flattens them. Raw moments that are interpolated
before C is computed make up for it; a texture of roughness cannot, so that what is lost is in it
(`interpolated`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rhytid.exports.textures import USUAL, Shine
from rhytid.exports.textures.frame_map import Facts, FrameMap, attributes, nearest_known
from rhytid.exports.textures.writers import write_parts, write_png
from rhytid.formats.tiles import slope_parts

Texels = NDArray[np.float32]
_WHITE = 65535


@dataclass(frozen=True, eq=False)
class Gloss:
    """alpha (…, 2) of GGX along the axis of most variance and across it, at most 1, and the axis
    (…, 2): a unit vector along T and B, its first part not negative; (1, 0) where all are alike."""

    alpha: Texels
    axis: Texels

    @property
    def roughness(self) -> Texels:
        """(…, 2) what shaders call roughness, of both axes."""
        return np.sqrt(self.alpha)


# What the first of two profiles has left, by the map.
_left: WeakKeyDictionary[FrameMap, tuple[Shine, Gloss, FrameMap]] = WeakKeyDictionary()


def gloss(moments: Texels, roughness: float) -> Gloss:
    """Roughness of texels with moments (…, 5), of a surface whose own roughness is `roughness`."""
    x, y, xx, xy, yy = np.moveaxis(moments.astype(np.float64), -1, 0)
    xx, xy, yy = xx - x * x, xy - x * y, yy - y * y
    mean, half, size = (xx + yy) / 2, (xx - yy) / 2, np.hypot((xx - yy) / 2, xy)
    variance = np.stack([mean + size, mean - size], axis=-1).clip(0.0, None)
    alpha = np.sqrt(roughness**4 + 2.0 * variance).clip(0.0, 1.0)
    angle = np.arctan2(xy, half) / 2
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return Gloss(alpha.astype(np.float32), axis.astype(np.float32))


def interpolated(moments: Texels) -> Texels:
    """Moments (n, m, 5) with products that have what a linear filter takes from the mean slopes.

    It makes of the four means around a square m + a ξ + b η + c ξ η, both from -1 to 1, so that the
    mean of m mᵀ over the square lacks 2/3 (a aᵀ + b bᵀ) + 8/9 c cᵀ. A texel gets the mean of its
    four squares. Beyond the map it goes on as its border.
    """
    means = np.pad(moments[..., :2], ((1, 1), (1, 1), (0, 0)), mode="edge")
    along, middle = (means[:, 1:] - means[:, :-1]) / 2, (means[:, 1:] + means[:, :-1]) / 2
    a, c = (along[1:] + along[:-1]) / 2, (along[1:] - along[:-1]) / 2
    b = (middle[1:] - middle[:-1]) / 2
    out: Texels = moments.copy()
    for at, (i, j) in enumerate(((0, 0), (0, 1), (1, 1)), start=2):
        lost = (a[..., i] * a[..., j] + b[..., i] * b[..., j]) * np.float32(2 / 3)
        lost += c[..., i] * c[..., j] * np.float32(8 / 9)
        out[..., at] += (lost[1:, 1:] + lost[1:, :-1] + lost[:-1, 1:] + lost[:-1, :-1]) / 4
    return out


def mean_normals(moments: Texels) -> Texels:
    """(…, 3) unit vectors along T, B and N of the mean slopes."""
    out = np.concatenate([-moments[..., :2], np.ones_like(moments[..., :1])], axis=-1)
    found: Texels = out / np.linalg.norm(out, axis=-1, keepdims=True)
    return found


def gltf_anisotropy(found: Gloss) -> Texels:
    """(…) strength of KHR_materials_anisotropy, whose alpha across is that of the roughness and
    along is mix(alpha, 1, strength²)."""
    along, across = np.moveaxis(found.alpha, -1, 0)
    strength: Texels = np.sqrt((along - across) / np.maximum(1.0 - across, np.float32(1e-6)))
    return strength.clip(0.0, 1.0)


def slope_facts(map: FrameMap, shine: Shine = USUAL) -> Facts:
    """Facts of slopes: lengths over lengths, along T and B, and their products."""
    return {"scale": 1.0, "midlevel": 0.0, "level": shine.of_moments}


def roughness_facts(map: FrameMap, shine: Shine = USUAL) -> Facts:
    """Facts of roughness: red is that along the axis of anisotropy, green that across it."""
    values = {"red": "along the axis", "green": "across the axis", "blue": "0"}
    base = {"level": shine.of_moments, "base_roughness": shine.roughness}
    return {"scale": 1.0, "midlevel": 0.0, **base, **values}


def anisotropy_facts(map: FrameMap, shine: Shine = USUAL) -> Facts:
    """Facts of anisotropy, a texture of KHR_materials_anisotropy: red and green are the axis, 2
    value - 1 along T and B, blue is its strength."""
    values = {"red": "axis along T", "green": "axis along B", "blue": "strength"}
    base = {"level": shine.of_moments, "base_roughness": shine.roughness}
    return {"scale": 1.0, "midlevel": 0.0, **base, **values}


def normal_facts(own: Callable[[FrameMap], Facts], map: FrameMap, shine: Shine = USUAL) -> Facts:
    """Facts of normals of mean slopes.  own: those of the profile."""
    return {**own(map), "level": shine.of_moments}


def write_slopes(path: Path, map: FrameMap, facts: Facts, shine: Shine = USUAL) -> str:
    """Write moments as OpenEXR of floats."""
    values, at = _padded(map, shine)
    ends = values.min(), values.max()
    return write_parts(path, slope_parts(values, attributes(at.header, facts, *ends)))


def write_roughness(path: Path, map: FrameMap, facts: Facts, shine: Shine = USUAL) -> str:
    """Write roughness along and across as RGB PNG of 16 bits, blue 0."""
    found, at = _gloss(map, shine)
    return _write_codes(path, np.pad(found.roughness, ((0, 0), (0, 0), (0, 1))), at, facts)


def write_anisotropy(path: Path, map: FrameMap, facts: Facts, shine: Shine = USUAL) -> str:
    """Write the axis and the strength as RGB PNG of 16 bits."""
    found, at = _gloss(map, shine)
    strength = gltf_anisotropy(found)[..., None]
    return _write_codes(
        path, np.concatenate([found.axis * 0.5 + 0.5, strength], axis=-1), at, facts
    )


def _gloss(map: FrameMap, shine: Shine) -> tuple[Gloss, FrameMap]:
    """Roughness and axis of a texture, whose filter takes slopes from normals, and its map. Both
    profiles need them: the first of a map leaves them to the other one, while the map is there."""
    kept = _left.pop(map, None)
    if kept is not None and kept[0] == shine:
        return kept[1:]
    values, at = _padded(map, shine)
    found = gloss(interpolated(values), shine.roughness)
    _left[map] = shine, found, at
    return found, at


def write_mean_normals(path: Path, map: FrameMap, facts: Facts, shine: Shine = USUAL) -> str:
    """Write the normals of mean slopes as RGB PNG of 16 bits."""
    values, at = _padded(map, shine)
    normals = mean_normals(values)
    if facts["green"] == "down":
        normals[..., 1] *= -1.0
    return _write_codes(path, normals * 0.5 + 0.5, at, facts)


def _write_codes(path: Path, values: Texels, map: FrameMap, facts: Facts) -> str:
    codes = np.rint(values.clip(0.0, 1.0) * _WHITE).astype(np.uint16)
    return write_png(path, codes, map, facts, values)


def _padded(map: FrameMap, shine: Shine) -> tuple[Texels, FrameMap]:
    """Moments of a map at a level; a texel without skin has those of the nearest one with some. And
    the map with the header of that level."""
    values, coverage = map.slopes(shine.of_moments)
    side = len(values)
    filled = values.reshape(side * side, -1)[nearest_known(coverage > 0.0)]
    return filled, replace(map, header=replace(map.header, level=shine.of_moments))
