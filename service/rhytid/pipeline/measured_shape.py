"""Which launch shape draws fastest on a device: measured once, then remembered in a file.

Other work of the machine may make any shape the fastest of one run, so shapes run by turns, and one
that is not the usual is taken where it saves time in every turn. What is not clear is not
remembered: the device draws in its usual shape until the next start, which measures again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rhytid.device.launches import LaunchShape
from rhytid.device.runtime import Device
from rhytid.device.select import recall, remember
from rhytid.domain.asset_settings import AssetSettings
from rhytid.errors import DeviceError
from rhytid.pipeline.cells import CellLists
from rhytid.pipeline.element_arrays import PoreArrays, WrinkleArrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.levels import Draw
from rhytid.pipeline.reach import list_by_block
from rhytid.pipeline.redraw import ScaleBuffers, redrawing

_FILE, _PACE_FILE = "shapes_by_turns.json", "draw_paces.json"
# Seconds of each turn by shape, the usual shape first.
Turns = dict[LaunchShape, list[float]]
# A patch of skin as dense as a face at 4096² with 1.25 million wrinkles.
_SIDE, _WRINKLES, _PORES = 512, 20_000, 9_000
_LENGTH, _HALF_WIDTH, _PORE_RADIUS = 6.5, 1.3, 1.5  # texels
_ROUNDS = 5
# Turns of the shapes, and what another must save in each to be taken in place of the usual one. The
# usual one is remembered where no other saves that in more than so many.
_TURNS, _WORTH, _CHANCE = 8, 0.05, 2
# A processor of so few cores is not measured. Fewer rows a work-group are more work, which pays
# where cores wait for the last group of a tile; of 64 groups these have 16 each, or more.
_FEW_CORES = 4


def remembered_shape(
    device: Device,
    folder: Path,
    measure: Callable[[Device], Turns] | None = None,
) -> LaunchShape:
    """The fastest shape of this device, driver and version of the kernels, from `folder` or
    measured now and, where it is clear, written there. A folder that cannot be written and a
    machine that is busy cost a measurement at every start; a device that cannot be measured keeps
    its usual shape, as does a processor of few cores.

    measure: in place of `shape_seconds`."""
    if device.info.kind == "cpu" and device.info.compute_units <= _FEW_CORES:
        return device.shape
    file, key = folder / _FILE, _key(device)
    known = recall(file)
    with suppress(KeyError, TypeError):
        shape = LaunchShape(**known[key])
        if shape in device.shapes:
            return shape
    with suppress(DeviceError):
        if fastest := _fastest((measure or shape_seconds)(device)):
            remember(file, key, asdict(fastest))
            return fastest
    return device.shape


def remembered_pace(device: Device, folder: Path) -> float:
    """The work a second of drawing skin on this device in its shape, remembered as shapes are."""
    file, key = folder / _PACE_FILE, f"{_key(device)} | {device.shape}"
    known = recall(file).get(key)
    if isinstance(known, float) and known > 0.0:
        return known
    try:
        pace = patch_pace(device)
    except DeviceError:
        return device.work_pace
    remember(file, key, pace)
    return pace


def patch_pace(device: Device) -> float:
    """The work a second of drawing a patch of skin, the most of a few runs."""
    with device.task():
        elements, scales, draw = _patch(device)
        seconds = [_seconds(device, device.shape, draw) for _ in range(1 + _ROUNDS)]
        elements.release()
        scales.release()
    return elements.work.total / min(seconds[1:])


def shape_seconds(device: Device) -> Turns:
    """Seconds of a patch of skin by every shape in each of several turns, the usual shape first."""
    usual, shapes = device.shape, device.shapes
    seconds: Turns = {shape: [] for shape in shapes}
    try:
        with device.task():
            elements, scales, draw = _patch(device)
            for turn in range(1 + _TURNS):
                for shape in shapes if turn % 2 else shapes[::-1]:
                    seconds[shape].append(_seconds(device, shape, draw))
            elements.release()
            scales.release()
    finally:
        device.shape = usual
    return {shape: runs[1:] for shape, runs in seconds.items()}  # the first compiles


def _seconds(device: Device, shape: LaunchShape, draw: Draw) -> float:
    device.shape = shape
    start = time.perf_counter()
    draw(0, 0, _SIDE).release()
    device.finish()
    return time.perf_counter() - start


def _fastest(seconds: Turns) -> LaunchShape | None:
    """The shape that is fastest beyond doubt; None where there is doubt."""
    usual, *others = seconds
    saving = {other: _turns_saving(seconds[other], seconds[usual]) for other in others}
    if max(saving.values(), default=0) <= _CHANCE:
        return usual
    sure = [other for other in others if saving[other] == len(seconds[usual])]
    return min(sure, key=lambda shape: median(seconds[shape]), default=None)


def _turns_saving(seconds: Sequence[float], usual: Sequence[float]) -> int:
    return sum(a < (1.0 - _WORTH) * b for a, b in zip(seconds, usual, strict=True))


def _key(device: Device) -> str:
    return f"{device.info.identity} | {device.digest('redraw')}"


def _patch(device: Device) -> tuple[UdimElements, ScaleBuffers, Draw]:
    """Undeformed skin, straight wrinkles in all directions."""
    rng = np.random.default_rng(1)
    settings = AssetSettings.parse({"resolution": _SIDE, "depth": 1.0})
    start, angle = rng.uniform(0, _SIDE, (_WRINKLES, 2)), rng.uniform(0, np.pi, _WRINKLES)
    extent = _LENGTH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    sizes = np.tile(np.array([_HALF_WIDTH, 0.5], np.float32), (_WRINKLES, 1))
    wrinkles = WrinkleArrays(
        np.concatenate([start, extent], axis=1).astype(np.float32),
        sizes,
        np.zeros(_WRINKLES, np.int32),
        _lists(np.minimum(start, start + extent), np.maximum(start, start + extent)),
    )
    centres = rng.uniform(0, _SIDE, (_PORES, 2)).astype(np.float32)
    root = np.array([1 / _PORE_RADIUS, 0, 1 / _PORE_RADIUS, 0.5], np.float32)
    pores = PoreArrays(
        centres, np.tile(root, (_PORES, 1)), np.zeros(_PORES, np.int32), _lists(centres, centres)
    )
    elements = UdimElements(device, wrinkles, pores, 1)
    ones = (device.full(2 * count, np.float32(1.0)) for count in (_WRINKLES, _PORES))
    scales = ScaleBuffers(*ones)
    return elements, scales, redrawing(device, elements, settings, scales)


def _lists(low: Any, high: Any) -> CellLists:
    reach = max(_HALF_WIDTH, _PORE_RADIUS)
    return list_by_block((low - reach) / _SIDE, (high + reach) / _SIDE, _SIDE)
