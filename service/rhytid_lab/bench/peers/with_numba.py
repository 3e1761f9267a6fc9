"""The cases in numba: compiled, parallel over blocks or rows, the host's threads."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid.pipeline.work import BLOCK
from rhytid_lab.bench.peers import HostRun
from rhytid_lab.bench.peers.response import unit_scales
from rhytid_lab.bench.scene import Floats, Scene

_EPSILON = np.float32(1e-6)
_HALF = np.float32(0.5)
# Without traps for what IEEE 754 keeps apart, so that loops become vectors.
_compiled: Callable[..., Any] = numba.njit(fastmath=True)
_parallel: Callable[..., Any] = numba.njit(parallel=True, fastmath=True)


def redraw(scene: Scene) -> HostRun:
    """Alg. 1 and 2, then block by block (section 2.3)."""
    response = scene.settings.response
    scales = tuple(unit_scales(len(a.triangle)) for a in (scene.wrinkles, scene.pores))
    exponents = np.array(
        [response.alpha_w, -response.alpha_d, response.beta_w, -response.beta_d], np.float32
    )

    def run() -> Floats:
        _respond_wrinkles(
            scene.wrinkles.segments, scene.wrinkles.triangle, scene.axes, scene.logs,
            exponents[0], exponents[1], scales[0],
        )  # fmt: skip
        _respond_pores(scene.pores.triangle, scene.logs, exponents[2], exponents[3], scales[1])
        return _drawn(scene, *scales)

    return HostRun(run)


def neutral(scene: Scene) -> HostRun:
    """The same unstretched."""
    scales = tuple(unit_scales(len(a.triangle)) for a in (scene.wrinkles, scene.pores))
    return HostRun(lambda: _drawn(scene, *scales))


def binned(scene: Scene) -> HostRun:
    """Alg. 3: what is the same in a triangle once, then row by row."""
    bins = scene.settings.bins
    codes, triangles, steps = scene.codes, scene.triangles, scene.steps
    weights = np.empty((len(scene.axes), bins.count + 1), np.float32)
    out = np.empty((scene.size, scene.size), np.float32)

    def run() -> Floats:
        _weigh(
            scene.axes, scene.logs, scene.directions, np.float32(bins.r_max),
            np.float32(0.5 * (bins.samples - 1)), weights,
        )  # fmt: skip
        _blend(codes, triangles, weights, steps, out)
        return out

    return HostRun(run)


CASES = {"redraw": redraw, "neutral": neutral, "binned": binned}


def _drawn(scene: Scene, wrinkle_scales: Floats, pore_scales: Floats) -> Floats:
    wrinkles, pores, shape = scene.wrinkles, scene.pores, scene.settings.shape
    out = np.empty((scene.size, scene.size), np.float32)
    values = (shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots, scene.depth)
    _draw_blocks(
        wrinkles.segments, wrinkles.sizes, wrinkle_scales,
        wrinkles.lists.offsets, wrinkles.lists.members,
        pores.centres, pores.roots, pore_scales, pores.lists.offsets, pores.lists.members,
        np.array(values, np.float32), out,
    )  # fmt: skip
    return out


@_compiled
def _across(tx, ty, axes, logs):
    d1 = max(np.float32(1) - abs(tx * axes[0] + ty * axes[1]), np.float32(0))
    d2 = max(np.float32(1) - abs(tx * axes[2] + ty * axes[3]), np.float32(0))
    return (d1 * logs[0] + d2 * logs[1]) / (d1 + d2 + _EPSILON)


@_compiled
def _scale(r, exponent):
    limit = np.float32(SCALE_LIMIT)
    return min(max(np.float32(math.exp(exponent * r)), np.float32(1) / limit), limit)


@_parallel
def _respond_wrinkles(segments, triangle, axes, logs, width, depth, scales):
    for i in numba.prange(len(segments)):
        ex, ey = segments[i, 2], segments[i, 3]
        over = np.float32(1) / np.float32(math.sqrt(ex * ex + ey * ey))
        r = _across(ex * over, ey * over, axes[triangle[i]], logs[triangle[i]])
        scales[i, 0] = _scale(r, width)
        scales[i, 1] = _scale(r, depth)


@_parallel
def _respond_pores(triangle, logs, width, depth, scales):
    for i in numba.prange(len(triangle)):
        r = _HALF * (logs[triangle[i], 0] + logs[triangle[i], 1])
        scales[i, 0] = _scale(r, width)
        scales[i, 1] = _scale(r, depth)


@_compiled
def _between(low, high):
    first = max(math.ceil(max(low, np.float32(-1)) - _HALF), 0)
    last = min(math.floor(min(high, np.float32(BLOCK + 1)) - _HALF), BLOCK - 1)
    return first, last


@_compiled
def _add(valleys, bulges, y, x, t2, exponent, bulge):
    s = np.float32(1) - t2
    height = exponent * s * s * (np.float32(1) - bulge * t2)
    if height > 0:
        valleys[y, x] += np.float32(math.exp(height)) - np.float32(1)
    else:
        bulges[y, x] += np.float32(math.exp(-height)) - np.float32(1)


@_compiled
def _draw_wrinkle(valleys, bulges, ax, ay, ex, ey, width, exponent, bulge):
    length2 = ex * ex + ey * ey
    low, high = _between(min(ay, ay + ey) - width, max(ay, ay + ey) + width)
    for y in range(low, high + 1):
        dy = np.float32(y) + _HALF - ay
        # The part of the segment that comes near this row.
        first, last = np.float32(0), np.float32(1)
        if abs(ey) > np.float32(1e-3):
            u, v = (dy - width) / ey, (dy + width) / ey
            first = min(max(min(u, v), np.float32(0)), np.float32(1))
            last = min(max(max(u, v), np.float32(0)), np.float32(1))
        x0, x1 = ax + first * ex, ax + last * ex
        left, right = _between(min(x0, x1) - width, max(x0, x1) + width)
        for x in range(left, right + 1):
            dx = np.float32(x) + _HALF - ax
            share = min(max((dx * ex + dy * ey) / length2, np.float32(0)), np.float32(1))
            gx, gy = dx - share * ex, dy - share * ey
            t2 = (gx * gx + gy * gy) / (width * width)
            if t2 < np.float32(1):
                _add(valleys, bulges, y, x, t2, exponent, bulge)


@_compiled
def _draw_pore(valleys, bulges, cx, cy, xx, xy, yy, exponent, bulge):
    reach = np.float32(math.sqrt(xy * xy + yy * yy)) / (xx * yy)
    low, high = _between(cy - np.float32(1) / yy, cy + np.float32(1) / yy)
    left, right = _between(cx - reach, cx + reach)
    for y in range(low, high + 1):
        dy = np.float32(y) + _HALF - cy
        for x in range(left, right + 1):
            gx, gy = (np.float32(x) + _HALF - cx) * xx + dy * xy, dy * yy
            t2 = gx * gx + gy * gy
            if t2 < np.float32(1):
                _add(valleys, bulges, y, x, t2, exponent, bulge)


@_parallel
def _draw_blocks(
    segments, sizes, wrinkle_scales, wrinkle_offsets, wrinkle_members,
    centres, roots, pore_scales, pore_offsets, pore_members, shape, out,
):  # fmt: skip
    blocks = len(out) // BLOCK
    sharpness, slots, depth = shape[2], shape[3], shape[4]
    for block in numba.prange(blocks * blocks):
        valleys = np.zeros((BLOCK, BLOCK), np.float32)
        bulges = np.zeros((BLOCK, BLOCK), np.float32)
        row, column = block // blocks, block % blocks
        left, bottom = np.float32(column * BLOCK), np.float32((blocks - 1 - row) * BLOCK)
        for k in range(wrinkle_offsets[block], wrinkle_offsets[block + 1]):
            i = wrinkle_members[k]
            _draw_wrinkle(
                valleys, bulges, segments[i, 0] - left, segments[i, 1] - bottom,
                segments[i, 2], segments[i, 3], sizes[i, 0] * wrinkle_scales[i, 0],
                sizes[i, 1] * wrinkle_scales[i, 1] * sharpness, shape[0],
            )  # fmt: skip
        for k in range(pore_offsets[block], pore_offsets[block + 1]):
            i = pore_members[k]
            over = np.float32(1) / pore_scales[i, 0]
            _draw_pore(
                valleys, bulges, centres[i, 0] - left, centres[i, 1] - bottom,
                roots[i, 0] * over, roots[i, 1] * over, roots[i, 2] * over,
                roots[i, 3] * pore_scales[i, 1] * sharpness, shape[1],
            )  # fmt: skip
        for y in range(BLOCK):
            for x in range(BLOCK):
                up = np.float32(1) + bulges[y, x] / slots
                down = np.float32(1) + valleys[y, x] / slots
                height = np.float32(math.log(up / down)) * (depth / sharpness)
                out[(row + 1) * BLOCK - 1 - y, column * BLOCK + x] = height


@_parallel
def _weigh(axes, logs, directions, r_max, half, weights):
    for t in numba.prange(len(axes)):
        for n in range(weights.shape[1]):
            r = _HALF * (logs[t, 0] + logs[t, 1])
            if n < len(directions):
                r = _across(directions[n, 0], directions[n, 1], axes[t], logs[t])
            share = min(max(r / r_max, np.float32(-1)), np.float32(1))
            weights[t, n] = (share + np.float32(1)) * half


@_parallel
def _blend(codes, triangles, weights, steps, out):
    layers, samples = codes.shape[0], codes.shape[1]
    for y in numba.prange(len(out)):
        start = 0
        while start < len(out):  # texels side by side in one triangle have the same weights
            t, stop = triangles[y, start], start + 1
            while stop < len(out) and triangles[y, stop] == t:
                stop += 1
            for n in range(layers):
                m = min(int(weights[t, n]), samples - 2)
                share = weights[t, n] - np.float32(m)
                low = (np.float32(1) - share) * steps[n, m]
                high = share * steps[n, m + 1]
                below, above = codes[n, m, y], codes[n, m + 1, y]
                for x in range(start, stop):
                    height = low * np.float32(below[x]) + high * np.float32(above[x])
                    out[y, x] = height if n == 0 else min(out[y, x], height)
            start = stop
