"""The cases in plain numpy: float32, whole arrays at a time, in pieces that stay in the cache."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rhytid_lab.bench.peers import HostRun, Unsupported
from rhytid_lab.bench.peers.response import pore_scales, sample_weights, unit_scales, wrinkle_scales
from rhytid_lab.bench.scene import Floats, Scene

# Texels of the boxes around all elements: one takes about 0.2 µs.
_MOST_TEXELS = 100_000_000
_CHUNK = 1 << 20
_STRIP = 32
Boxes = tuple[NDArray[np.int64], NDArray[np.int64]]


def stretch(scene: Scene) -> HostRun:
    """Section 2.2 for all triangles, in double: float32 loses three digits on slivers."""
    corners = scene.mesh.positions[scene.mesh.faces].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    usable = scene.mesh.usable_triangles()
    neutral = np.where(usable[:, None, None], _frame(first, second), np.eye(2))
    uv = scene.mesh.triangle_uv()
    edges_uv = np.stack([uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]], axis=-1)
    inverse = np.linalg.inv(neutral)
    to_uv = edges_uv @ inverse

    def run() -> Floats:
        p = scene.deformed[scene.mesh.faces].astype(np.float64)
        gradient = _frame(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) @ inverse
        a, b, d = gradient[:, 0, 0], gradient[:, 0, 1], gradient[:, 1, 1]
        rho1 = 0.5 * (np.hypot(a + d, b) + np.hypot(a - d, b))
        angle = 0.5 * np.arctan2(2 * a * b, (a - d) * (a + d) - b * b)
        cos, sin = np.cos(angle), np.sin(angle)
        right = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], axis=1)
        axes = to_uv @ right
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        found = np.empty((len(p), 6), np.float32)
        found[:, 0], found[:, 1] = rho1, a * d / rho1
        found[:, 2:4], found[:, 4:] = axes[:, :, 0], axes[:, :, 1]
        found[~usable] = (1, 1, 1, 0, 0, 1)
        return found

    return HostRun(run)


def redraw(scene: Scene) -> HostRun:
    """Alg. 1 and 2, then every element into the sums of the mellow-max (section 2.3)."""
    _check_size(scene)
    return HostRun(lambda: _drawn(scene, wrinkle_scales(scene), pore_scales(scene)))


def neutral(scene: Scene) -> HostRun:
    """The same unstretched."""
    _check_size(scene)
    wrinkles, pores = (unit_scales(len(a.triangle)) for a in (scene.wrinkles, scene.pores))
    return HostRun(lambda: _drawn(scene, wrinkles, pores))


def binned(scene: Scene) -> HostRun:
    """Alg. 3, strip by strip."""
    codes, triangles = scene.codes.reshape(*scene.codes.shape[:2], -1), scene.triangles.ravel()
    strip = _STRIP * scene.size

    def run() -> Floats:
        position, steps = sample_weights(scene), scene.steps
        out = np.empty(scene.size**2, np.float32)
        for start in range(0, len(out), strip):
            texels = np.arange(start, start + strip)
            lowest = np.full(strip, np.inf, np.float32)
            for layer, maps in enumerate(codes):
                at = position[triangles[start : start + strip], layer]
                low = np.minimum(at.astype(np.int32), maps.shape[0] - 2)
                share = at - low
                below = maps[low, texels] * ((1 - share) * steps[layer, low])
                above = maps[low + 1, texels] * (share * steps[layer, low + 1])
                np.minimum(lowest, below + above, out=lowest)
            out[start : start + strip] = lowest
        return out.reshape(scene.size, scene.size)

    return HostRun(run)


CASES = {"stretch": stretch, "redraw": redraw, "neutral": neutral, "binned": binned}


def _frame(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 2, 2) two edges as columns, in the frame whose first axis is the first edge."""
    length = np.maximum(np.linalg.norm(first, axis=1), 1e-300)
    across = np.linalg.norm(np.cross(first, second), axis=1) / length
    along = np.sum(first * second, axis=1) / length
    rows = [np.stack([length, along], -1), np.stack([np.zeros_like(length), across], -1)]
    return np.stack(rows, axis=1)


def _drawn(scene: Scene, wrinkle_scale: Floats, pore_scale: Floats) -> Floats:
    sums = np.zeros((2, scene.size**2), np.float32)
    _add_wrinkles(scene, wrinkle_scale, sums)
    _add_pores(scene, pore_scale, sums)
    shape = scene.settings.shape
    valleys, bulges = 1 + sums / np.float32(shape.slots)
    heights: Floats = np.log(bulges / valleys) * np.float32(scene.depth / shape.sharpness)
    return heights.reshape(scene.size, scene.size)[::-1]  # rows were counted upwards


def _add_wrinkles(scene: Scene, scale: Floats, sums: Floats) -> None:
    start, extent = scene.wrinkles.segments[:, :2], scene.wrinkles.segments[:, 2:]
    width = scene.wrinkles.sizes[:, :1] * scale[:, :1]
    strength = scene.wrinkles.sizes[:, 1] * scale[:, 1]
    along = extent / np.sum(extent * extent, axis=1, keepdims=True)
    boxes = _boxes(
        start + np.minimum(extent, 0) - width, start + np.maximum(extent, 0) + width, scene
    )
    for i, x, y in _texels(boxes):
        dx, dy = x - start[i, 0], y - start[i, 1]
        share = np.clip(dx * along[i, 0] + dy * along[i, 1], 0, 1)
        dx -= share * extent[i, 0]
        dy -= share * extent[i, 1]
        t2 = (dx * dx + dy * dy) / np.square(width[i, 0])
        _add(scene, sums, x, y, t2, strength[i], scene.settings.shape.wrinkle_bulge)


def _add_pores(scene: Scene, scale: Floats, sums: Floats) -> None:
    root = scene.pores.roots[:, :3] / scale[:, :1]
    strength = scene.pores.roots[:, 3] * scale[:, 1]
    high = np.hypot(root[:, 1], root[:, 2]) / root[:, 0]
    reach = np.stack([high, np.ones_like(high)], axis=1) / root[:, 2:]
    centres = scene.pores.centres
    for i, x, y in _texels(_boxes(centres - reach, centres + reach, scene)):
        dx, dy = x - centres[i, 0], y - centres[i, 1]
        gx, gy = root[i, 0] * dx + root[i, 1] * dy, root[i, 2] * dy
        _add(scene, sums, x, y, gx * gx + gy * gy, strength[i], scene.settings.shape.pore_bulge)


def _add(
    scene: Scene, sums: Floats, x: Floats, y: Floats, t2: Floats, strength: Floats, bulge: float
) -> None:
    inside = np.flatnonzero(t2 < 1)
    s = 1 - t2[inside]
    height = strength[inside] * s * s * (1 - np.float32(bulge) * t2[inside])
    grown = np.expm1(np.float32(scene.settings.shape.sharpness) * np.abs(height))
    at = y[inside].astype(np.int64) * scene.size + x[inside].astype(np.int64)
    down = height > 0
    np.add.at(sums[0], at[down], grown[down])
    np.add.at(sums[1], at[~down], grown[~down])


def _boxes(low: Floats, high: Floats, scene: Scene) -> Boxes:
    """First texel (K, 2) of each box, and how many it has (K, 2), inside the map."""
    first = np.clip(np.ceil(low - 0.5), 0, scene.size).astype(np.int64)
    last = np.clip(np.floor(high - 0.5), -1, scene.size - 1).astype(np.int64)
    return first, np.maximum(last - first + 1, 0)


def _texels(boxes: Boxes) -> Iterator[tuple[NDArray[np.int64], Floats, Floats]]:
    """Every texel of every box: (index of the box, x, y of the centre), in chunks."""
    first, size = boxes
    count = size[:, 0] * size[:, 1]
    ends = np.cumsum(count)
    begin = 0
    while begin < len(count):
        done = ends[begin - 1] if begin else 0
        stop = max(int(np.searchsorted(ends, done + _CHUNK)), begin + 1)
        part = np.arange(begin, stop)
        i = np.repeat(part, count[begin:stop])
        within = np.arange(len(i)) + done - (ends - count)[i]
        x, y = first[i, 0] + within % size[i, 0], first[i, 1] + within // size[i, 0]
        yield i, (x + 0.5).astype(np.float32), (y + 0.5).astype(np.float32)
        begin = stop


def _check_size(scene: Scene) -> None:
    """Raise Unsupported where a run would take more than half a minute."""
    segments, width = np.abs(scene.wrinkles.segments[:, 2:]), scene.wrinkles.sizes[:, :1]
    reach = 1 / scene.pores.roots[:, [0, 2]]
    texels = float(np.prod(segments + 2 * width, axis=1).sum() + np.prod(2 * reach, axis=1).sum())
    if texels > _MOST_TEXELS:
        raise Unsupported(
            f"left out: {texels / 1e6:.0f} million texels to visit, over "
            f"{_MOST_TEXELS / 1e6:.0f} million: choose fewer wrinkles"
        )
