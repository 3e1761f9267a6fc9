"""Scanned or sculpted displacement: maps as they are read, and what their values stand for.

A value of a map becomes a height along the normal by `(value - midlevel) * scale`, in the unit of
`scale`. Codes of 8 and 16 bits are values from 0 to 1, floats are taken as they are. A map of three
channels that are bands of a relief, from coarse to fine, is their sum, with a scale for each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.lengths import MILLIMETRES, millimetres
from rhytid.errors import SettingsError

Codes = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float16] | NDArray[np.float32]
Relief = NDArray[np.float32]
FloatArray = NDArray[np.float64]
# Channels of a map of bands.
BANDS = 3
# The midlevel that is looked for outside of the charts.
AUTO = "auto"
# Of codes and of floats, where nothing else is said.
MID_GREY, ZERO = 0.5, 0.0
# How a map may be turned over: top to bottom, left to right, or both, which is half a turn.
FLIPS = ("v", "u", "uv")
# The largest width of a border, in the unit of the scale.
_WIDEST = 1e6
# Values that become heights at once.
_AT_ONCE = 1 << 22
# Rows that are resampled at once.
_ROWS = 256


@dataclass(frozen=True)
class ScanSettings:
    """What the values of scanned displacement stand for.

    scale: length of the full range of the codes, or of 1 in floats; three for bands. Below 0 the
    relief is turned inside out. None is 1 for floats; codes need one.
    midlevel: the value of a surface without relief; `"auto"` for the one that is most frequent
    outside of the charts; None is 0.5 for codes and 0 for floats.
    unit: of `scale`; None for that of the mesh.
    flip: one of FLIPS, for a map whose v, or u, runs against that of the mesh.
    partial: whether UDIMs of the mesh may have no map.
    detail: how much grain goes on where the scan ends, from 0, none, to 1, without a step in its
    spectrum, counted from where that falls away, if only within the texels of the map; None is 1
    below these, so that what they hold stays.
    fill: width of the border, in the unit of `scale`, over which grown skin fills in where the map
    is flat, masked out or missing; None or 0 for none. With it there is no detail.

    Raises SettingsError naming the setting that cannot be used.
    """

    scale: tuple[float, ...] | None = None
    midlevel: float | str | None = None
    unit: str | None = None
    flip: str | None = None
    partial: bool = False
    detail: float | None = None
    fill: float | None = None

    def __post_init__(self) -> None:
        if self.scale is not None:
            _check_scale(self.scale)
        if isinstance(self.midlevel, str) and self.midlevel != AUTO:
            raise SettingsError(f"scan.midlevel is {self.midlevel!r}: a number, or {AUTO!r}")
        if isinstance(self.midlevel, float | int) and not math.isfinite(self.midlevel):
            raise SettingsError(f"scan.midlevel is {self.midlevel}: must be finite")
        if self.unit is not None and millimetres(self.unit) is None:
            known = ", ".join(MILLIMETRES)
            raise SettingsError(f"scan.unit is {self.unit!r}: one of {known}, or so many, as 5.5cm")

        if self.flip not in (None, *FLIPS):
            raise SettingsError(f"scan.flip is {self.flip!r}: one of {', '.join(FLIPS)}")
        if self.detail is not None and not 0.0 <= self.detail <= 1.0:
            raise SettingsError(f"scan.detail is {self.detail}: from 0 to 1")
        if self.fill is not None and not 0.0 <= self.fill <= _WIDEST:
            raise SettingsError(f"scan.fill is {self.fill}: a width up to {_WIDEST:g}, 0 for none")
        if self.fill and self.detail:
            raise SettingsError("scan.fill and scan.detail: grain has one size, use one of them")

    @classmethod
    def parse(cls, data: Any) -> ScanSettings:
        """The settings of a JSON object with some of these fields; `scale` is a number or three.
        Raises SettingsError naming the one that cannot be used."""
        if not isinstance(data, Mapping):
            raise SettingsError(f"scan is {data!r}: must be an object")
        known = {field.name for field in fields(cls)}
        for name in data:
            if name not in known:
                raise SettingsError(f"scan.{name} is unknown: one of {', '.join(sorted(known))}")
        given = {name: value for name, value in data.items() if value is not None}
        scale = given.get("scale")
        if scale is not None:
            given["scale"] = tuple(scale) if isinstance(scale, list) else (scale,)
            if not all(map(_is_number, given["scale"])):
                raise SettingsError(f"scan.scale is {scale!r}: a number, or three in a list")
        if not (isinstance(given.get("midlevel", ""), str) or _is_number(given["midlevel"])):
            raise SettingsError(f"scan.midlevel is {given['midlevel']!r}: a number, or {AUTO!r}")
        for name, wanted in (("detail", "a number from 0 to 1"), ("fill", "a width")):
            if not _is_number(given.get(name, 0.0)):
                raise SettingsError(f"scan.{name} is {given[name]!r}: {wanted}")
        for name, kind in (("unit", str), ("flip", str), ("partial", bool)):
            if not isinstance(given.get(name, kind()), kind):
                wanted = "true or false" if kind is bool else "a string"
                raise SettingsError(f"scan.{name} is {given[name]!r}: must be {wanted}")
        return cls(**given)

    def scales(self, channels: int, coded: bool, unit: str, name: str) -> tuple[float, ...]:
        """The scale of each channel in mesh units.

        channels: of the map.  coded: whether it has codes, not floats.  unit: of the mesh.  name:
        of the map, for messages. Raises SettingsError where the scale is not that of such a map.
        """
        given = self.scale
        if given is None and coded:
            rule = (
                "scan.scale, the length of the full range from black to white, must be given; "
                "where nobody knows it, try one and see how deep `rhytid check --scan` says it is"
            )
            raise SettingsError(f"{name} has codes, which have no length of their own: {rule}")
        found = (1.0,) if given is None else given
        if len(found) != channels:
            raise SettingsError(_other_count(name, channels, found))
        factor = self._mesh_units(unit)
        return tuple(factor * one for one in found)

    def border(self, unit: str) -> float:
        """The width of the border, mesh units; 0 where nothing fills in.  unit: of the mesh. Raises
        SettingsError where that has no known length and the scale another."""
        return (self.fill or 0.0) * self._mesh_units(unit)

    def _mesh_units(self, unit: str) -> float:
        """Mesh units in one unit of the scale."""
        if self.unit is None or self.unit == unit:
            return 1.0
        of_scale, of_mesh = millimetres(self.unit), millimetres(unit)
        if of_scale is None or of_mesh is None:
            raise SettingsError(
                f"scan.unit is {self.unit!r}, but the unit of the mesh, {unit!r}, has no known "
                "length: leave scan.unit out, or give the unit of the mesh"
            )
        return of_scale / of_mesh


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _check_scale(scale: tuple[float, ...]) -> None:
    if len(scale) not in (1, BANDS):
        raise SettingsError(f"scan.scale has {len(scale)} numbers: one, or one for each of 3 bands")
    if not all(math.isfinite(one) for one in scale):
        raise SettingsError(f"scan.scale is {_listed(scale)}: must be finite")
    if not any(scale):
        raise SettingsError("scan.scale is 0: that is no relief at all")


def _other_count(name: str, channels: int, scale: tuple[float, ...]) -> str:
    if channels == 1:
        return f"{name} has one channel, scan.scale has {len(scale)} numbers: give one"
    return (
        f"{name} has three channels that differ: give scan.scale a length for each, red, green and "
        "blue, where they are bands of a relief, from coarse to fine; else save the map as grey"
    )


def _listed(scale: tuple[float, ...]) -> str:
    return ", ".join(f"{one:g}" for one in scale)


@dataclass(frozen=True, eq=False)
class ScanMap:
    """One UDIM of scanned displacement, as its file has it.

    name: of the file.  channels: one or BANDS arrays (H, W) of codes or floats, finite, of one
    type; row 0 at the top, any H and W. They are not copied.
    """

    udim: int
    name: str
    channels: tuple[Codes, ...]

    @property
    def coded(self) -> bool:
        """Whether its values are codes, not floats."""
        return self.channels[0].dtype.kind == "u"

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        height, width = self.channels[0].shape
        return height, width

    @property
    def kind(self) -> str:
        """Its type, in words."""
        return {"u1": "8 bits", "u2": "16 bits", "f2": "half", "f4": "float"}[
            self.channels[0].dtype.str[1:]
        ]

    def flipped(self, flip: str | None) -> ScanMap:
        """The map turned over, without a copy.  flip: one of FLIPS, None to leave it."""
        over = tuple(slice(None, None, -1 if axis in (flip or "") else 1) for axis in "vu")
        return replace(self, channels=tuple(channel[over] for channel in self.channels))

    def usual_midlevel(self) -> float:
        """The value without relief where nothing is said."""
        return MID_GREY if self.coded else ZERO


@dataclass(frozen=True, eq=False)
class Scan:
    """Scanned displacement of a mesh, with what its values stand for.

    maps: by UDIM, all of one type and with as many channels.  scales: of each channel, mesh units.
    midlevels: of each UDIM, a value for each channel.
    """

    maps: Mapping[int, ScanMap]
    scales: tuple[float, ...]
    midlevels: Mapping[int, tuple[float, ...]]

    def relief(self, udim: int, resolution: int | None = None) -> Relief:
        """(H, W) heights of a UDIM along the normal, mesh units.

        resolution: texels per side, which `resampled` makes of those of the file; None for as many
        as the file has.
        """
        bands = self.bands(udim)
        found = next(bands)
        for band in bands:
            found += band
        return found if resolution is None else resampled(found, resolution, resolution)

    def bands(self, udim: int) -> Iterator[Relief]:
        """The heights (H, W) of each channel, mesh units; their sum is the relief."""
        each = zip(self.maps[udim].channels, self.scales, self.midlevels[udim], strict=True)
        return (heights(values, scale, midlevel) for values, scale, midlevel in each)

    def step(self, udim: int, channel: int = 0) -> float:
        """The length between neighbouring codes of a channel, mesh units; 0 for floats."""
        values = self.maps[udim].channels[channel]
        return abs(self.scales[channel]) / full_range(values) if values.dtype.kind == "u" else 0.0


def full_range(values: NDArray[Any]) -> int:
    """The largest code of an array of codes; 1 for floats, which are taken as they are."""
    return int(np.iinfo(values.dtype).max) if values.dtype.kind == "u" else 1


def heights(values: Codes, scale: float, midlevel: float) -> Relief:
    """(…) heights of values, in the unit of `scale`, rounded once; floats with the scale 1 and the
    midlevel 0 stay bit for bit."""
    out = np.empty(values.shape, np.float32)
    step = scale / full_range(values)
    zero = midlevel * full_range(values)
    rows = max(_AT_ONCE // max(values[:1].size, 1), 1)
    for start in range(0, len(values), rows):
        part = slice(start, start + rows)
        out[part] = (values[part].astype(np.float64) - zero) * step
    return out


def resampled(map: NDArray[np.floating], height: int, width: int) -> NDArray[np.float32]:
    """A map (H, W) as (height, width) float32, row 0 at the top; the map itself where it has that
    size: by area where texels become fewer, cubic where they become more.

    Both are separable, done along one side after the other in doubles, and leave a constant map as
    it is. By area each texel is the mean of what lies under it, whatever the ratio. Cubic is the
    spline of Catmull and Rom: it passes through the texels, and overshoots edges by up to 7 % of
    their height; beyond the outermost texels their values go on.
    """
    found: NDArray[np.floating] = map
    if found.shape[0] != height:
        found = _along_rows(found, height)
    if found.shape[1] != width:
        found = _along_rows(found.T, width).T
    return np.ascontiguousarray(found, np.float32)


def _along_rows(map: NDArray[np.floating], count: int) -> NDArray[np.float32]:
    """(count, W) of a map (H, W)."""
    out = np.empty((count, map.shape[1]), np.float32)
    resample = _means if count < len(map) else _cubic
    for start in range(0, map.shape[1], _ROWS):
        part = slice(start, start + _ROWS)
        out[:, part] = resample(map[:, part].astype(np.float64), count)
    return out


def _means(values: FloatArray, count: int) -> FloatArray:
    """(count, …) means of equal shares of values (N, …)."""
    ends = np.arange(count + 1) * (len(values) / count)
    whole = np.minimum(ends.astype(np.int64), len(values) - 1)
    rest = (ends - whole)[:, None]
    # Sums from the middle value, so that they stay small.
    middle = values.mean(axis=0)
    sums = np.zeros((len(values) + 1, *values.shape[1:]))
    np.cumsum(values - middle, axis=0, out=sums[1:])
    until = sums[whole] + rest * (values[whole] - middle)
    found: FloatArray = np.diff(until, axis=0) * (count / len(values)) + middle
    return found


def _cubic(values: FloatArray, count: int) -> FloatArray:
    """(count, …) values between values (N, …), by four of them each."""
    place = (np.arange(count) + 0.5) * (len(values) / count) - 0.5
    first = np.floor(place).astype(np.int64)
    t = (place - first)[:, None]
    weights = (
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )
    total = np.zeros((count, *values.shape[1:]))
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        total += weight * values[np.clip(first + offset, 0, len(values) - 1)]
    return total
