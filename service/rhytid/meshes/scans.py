"""Scanned displacement on its mesh: where charts lie in a map, and what its midlevel is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.domain.scan import AUTO, Codes, Scan, ScanMap, ScanSettings, full_range
from rhytid.domain.tiles import udim_origin
from rhytid.domain.uv_layout import coverage
from rhytid.errors import InputError

Mask = NDArray[np.bool_]
# Cells a side of the grid on which charts are drawn, and cells around charts that writers of maps
# fill with what is in them: 64 texels of 4096.
SIDE, _PADDING = 512, 8
# Share of the cells outside that must be there, and that must have one value, to call it that.
_OUTSIDE, _ONE_VALUE = 0.002, 0.5
# The value outside is no midlevel where fewer of the values inside lie on either side of it.
_BEYOND = 0.01


def scan_of(maps: Mapping[int, ScanMap], settings: ScanSettings, mesh: Mesh, unit: str) -> Scan:
    """Maps with what their values stand for on a mesh.

    maps: by UDIM, alike.  unit: of the mesh. Raises SettingsError where the settings are not those
    of such maps, InputError where a midlevel is looked for and there is none.
    """
    first = next(iter(maps.values()))
    scales = settings.scales(len(first.channels), first.coded, unit, first.name)
    turned = {udim: one.flipped(settings.flip) for udim, one in maps.items()}
    levels = {udim: _midlevels(one, settings, mesh) for udim, one in turned.items()}
    return Scan(turned, scales, levels)


def _midlevels(map: ScanMap, settings: ScanSettings, mesh: Mesh) -> tuple[float, ...]:
    if settings.midlevel == AUTO:
        covered = charts(mesh, map.udim)
        return tuple(_found_midlevel(map, channel, covered) for channel in map.channels)
    given = settings.midlevel
    one = map.usual_midlevel() if given is None else float(given)
    if map.coded and not 0.0 <= one <= 1.0:
        raise InputError(f"scan.midlevel is {one:g}: of codes it is from 0 (black) to 1 (white)")
    return (one,) * len(map.channels)


def _found_midlevel(map: ScanMap, channel: Codes, covered: Mask) -> float:
    found = Background.of(channel, covered)
    guess = f"inside of them the middle value is {found.median:.4g}"
    if found.value is None:
        why = "what lies outside of the charts has no one value"
    elif found.is_fill:
        why = f"outside of the charts it is {found.value:.4g}, beyond the values inside of them"
    else:
        return found.value
    raise InputError(f"{map.name}: no midlevel is found: {why}; {guess}: give a number")


def charts(mesh: Mesh, udim: int) -> Mask:
    """(SIDE, SIDE) which cells of a UDIM have their middle in a triangle, row 0 at the top."""
    local = mesh.triangle_uv()[mesh.triangles_with_uv()] - np.array(udim_origin(udim), np.float64)
    near = (local.max(axis=1) > 0.0).all(axis=1) & (local.min(axis=1) < 1.0).all(axis=1)
    return coverage(local[near], SIDE)


@dataclass(frozen=True)
class Background:
    """What a channel is outside of the charts, as values.

    value: the most frequent one, None where less than half of the texels have one.  share: of the
    texels outside that have it.  median: of the values inside.  is_fill: whether hardly any value
    inside lies on one side of it, so that it is a fill, not the midlevel.
    """

    value: float | None
    share: float
    median: float
    is_fill: bool

    @classmethod
    def of(cls, channel: Codes, covered: Mask) -> Background:
        """That of a channel.  covered: as `charts` has it."""
        cells = at_cells(channel)
        outside = cells[~scipy.ndimage.binary_dilation(covered, iterations=_PADDING)]
        inside = cells[covered]
        inside = inside if inside.size else cells.reshape(-1)
        median, size = float(np.median(inside)), full_range(channel)
        if outside.size < _OUTSIDE * cells.size:
            return cls(None, 0.0, median / size, False)
        values, counts = np.unique(outside, return_counts=True)
        value, share = values[counts.argmax()], float(counts.max() / outside.size)
        fewer = min(float((inside <= value).mean()), float((inside >= value).mean()))
        known = float(value) / size if share >= _ONE_VALUE else None
        return cls(known, share, median / size, fewer < _BEYOND)


def at_cells(values: Codes) -> NDArray[Any]:
    """(SIDE, SIDE) the texels of a map (H, W) in the middles of cells."""
    rows, columns = (((np.arange(SIDE) + 0.5) * n / SIDE).astype(np.int64) for n in values.shape)
    found: NDArray[Any] = values[rows[:, None], columns]
    return found
