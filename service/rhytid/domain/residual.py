"""Scanned skin: the relief that is traced, and the residual, which its wrinkle graph does not draw.

    displacement(frame) = drawn(graph, frame) + residual

At rest this is the scan, since the residual is the scan less the neutral of the graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.painted_maps import check_udim
from rhytid.domain.scan import resampled
from rhytid.domain.validation import fixed_array
from rhytid.domain.wording import plural
from rhytid.errors import InputError, LimitError

Codes = NDArray[np.int16]
Heights = NDArray[np.float32]
# Of all maps of an asset together: 16 UDIMs of 4096², or one of 16384².
MOST_TEXELS = 2**28
_CODES = _LOWEST, _HIGHEST = -32768, 32767
_STEP, _NOISE, _END, _DETAIL = ".step", "noise", ".end", "detail"
_DENIED, _BORDER = ".denied", "border"


@dataclass(frozen=True, eq=False)
class Residual:
    """Displacement that is added to what the graph draws, in every frame alike.

    codes: (R, R) int16 of each UDIM, row 0 at the top.  steps: of each UDIM the length of a code
    and that of code 0, mesh units: a texel is `middle + step * code`. A UDIM without codes has no
    residual. Raises InputError naming the UDIM whose map cannot be used, LimitError above
    MOST_TEXELS in all.
    """

    codes: Mapping[int, Codes]
    steps: Mapping[int, tuple[float, float]]

    def __post_init__(self) -> None:
        fixed = {u: _fixed(map, u, np.int16) for u, map in sorted(self.codes.items())}
        _check_total(fixed)
        for udim in fixed:
            if not np.isfinite(self.steps[udim]).all():
                raise InputError(f"the residual of UDIM {udim} has steps that are not finite")
        object.__setattr__(self, "codes", fixed)

    @classmethod
    def of(cls, maps: Mapping[int, Heights]) -> Residual:
        """Maps (R, R), mesh units, in codes: each texel is off by half a step of 16 bits of the
        range of its map at most. Raises InputError naming a UDIM that is not finite."""
        found = {udim: _coded(map, udim) for udim, map in maps.items()}
        return cls(
            {u: codes for u, (codes, _) in found.items()}, {u: s for u, (_, s) in found.items()}
        )

    def heights(self, udim: int) -> Heights:
        """(R, R) of a UDIM, mesh units."""
        step, middle = self.steps[udim]
        return (middle + step * self.codes[udim].astype(np.float64)).astype(np.float32)

    @property
    def largest(self) -> float:
        """The largest displacement that codes can hold, up or down, mesh units."""
        ends = (middle + step * code for step, middle in self.steps.values() for code in _CODES)
        return max(map(abs, ends), default=0.0)

    def common(self, udims: Sequence[int]) -> tuple[float, float]:
        """The length of a code and that of code 0, mesh units, with which codes hold the maps of
        all `udims`: that of one without a map is 0."""
        if len({self.steps.get(udim) for udim in udims}) == 1:
            return self.steps[udims[0]]
        found = [(0.0, 0.0) if u not in self.codes else self.steps[u] for u in udims]
        return _steps([middle + step * code for step, middle in found for code in _CODES])

    def coded(self, udim: int, common: tuple[float, float], side: int) -> Codes:
        """(side, side) of a UDIM in codes of `common`: within half a step, and as they are where
        they are of that already."""
        step, middle = common
        if self.steps.get(udim) == common:
            return self.codes[udim]
        map = self.heights(udim) if udim in self.codes else np.zeros((side, side), np.float32)
        return _in_codes(map, step, middle)

    def resized(self, resolution: int) -> Residual:
        """At another resolution, texels per side, as `resampled` makes it."""
        sides = resolution, resolution
        return Residual.of({udim: resampled(self.heights(udim), *sides) for udim in self.codes})

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The maps by the UDIM as text, and with `.step` after it their steps."""
        found: dict[str, NDArray[Any]] = {str(udim): map for udim, map in self.codes.items()}
        steps = {f"{u}{_STEP}": np.array(self.steps[u], np.float64) for u in self.codes}
        return found | steps

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Residual:
        """The inverse of `arrays`."""
        codes = {int(name): map for name, map in arrays.items() if not name.endswith(_STEP)}
        steps = {udim: arrays[f"{udim}{_STEP}"].tolist() for udim in codes}
        return cls(codes, {udim: (float(s), float(m)) for udim, (s, m) in steps.items()})

    def check(self, udims: Sequence[int], resolution: int) -> None:
        """Raise InputError for a map of a UDIM that the mesh does not have, or of another size than
        `resolution` texels per side."""
        _check_maps(self.codes, udims, resolution, "a residual")


@dataclass(frozen=True, eq=False)
class ScanRelief:
    """The relief of a scan, to be traced.

    maps: (R, R) float32 of each UDIM, mesh units, row 0 at the top.  noise: the least from texel to
    texel, mesh units, as of rounding to codes.  ends: texels per side, below R, that hold all that
    the scan has, of UDIMs where that is so.  detail: how much of the spectrum is to go on below
    these, from 0 to 1.  denied: of UDIMs of which a part is left out a map, of any size, that is
    not 0 where there are to be no lines of the scan.  border: 0, and the scan stays there as it is;
    else how far from there, and from UDIMs without a map, it is whole, mesh units, and grown skin
    fills in. Raises as `Residual`.
    """

    maps: Mapping[int, Heights]
    noise: float = 0.0
    ends: Mapping[int, int] = field(default_factory=dict)
    detail: float = 0.0
    denied: Mapping[int, NDArray[np.uint8]] = field(default_factory=dict)
    border: float = 0.0

    @property
    def filled(self) -> bool:
        """Whether grown skin fills in where there is no scan."""
        return self.border > 0.0

    def __post_init__(self) -> None:
        fixed = {u: _fixed(map, u, np.float32) for u, map in sorted(self.maps.items())}
        _check_total(fixed)
        object.__setattr__(self, "maps", fixed)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The maps by the UDIM as text, the noise, and where there is detail that and the ends."""
        found: dict[str, NDArray[Any]] = {str(udim): map for udim, map in self.maps.items()}
        found[_NOISE] = np.array([self.noise], np.float64)
        if self.detail > 0.0:
            found[_DETAIL] = np.array([self.detail], np.float64)
            found |= {f"{u}{_END}": np.array([end], np.int64) for u, end in self.ends.items()}
        if self.filled:
            found[_BORDER] = np.array([self.border], np.float64)
        return found | {f"{u}{_DENIED}": map for u, map in self.denied.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> ScanRelief:
        """The inverse of `arrays`."""
        maps = {int(name): map for name, map in arrays.items() if name.isdecimal()}
        ends, denied = (
            {int(n.removesuffix(end)): arrays[n] for n in arrays if n.endswith(end)}
            for end in (_END, _DENIED)
        )
        noise, detail, border = (
            float(arrays[name][0]) if name in arrays else 0.0 for name in (_NOISE, _DETAIL, _BORDER)
        )
        return cls(maps, noise, {u: int(end[0]) for u, end in ends.items()}, detail, denied, border)

    def check(self, udims: Sequence[int], resolution: int) -> None:
        """As `Residual.check`."""
        _check_maps(self.maps, udims, resolution, "a scan")


def _coded(map: Heights, udim: int) -> tuple[Codes, tuple[float, float]]:
    """The codes of a map, and its steps."""
    low, high = float(map.min()), float(map.max())
    if not np.isfinite([low, high]).all():
        raise InputError(f"the residual of UDIM {udim} is not finite throughout")
    step, middle = _steps((low, high))
    return _in_codes(map, step, middle), (step, middle)


def _steps(heights: Sequence[float]) -> tuple[float, float]:
    """The steps whose codes reach from the least to the most of heights, mesh units."""
    low, high = min(heights), max(heights)
    step = (high - low) / (_HIGHEST - _LOWEST)
    return step, low - _LOWEST * step


def _in_codes(map: Heights, step: float, middle: float) -> Codes:
    if step == 0.0:
        return np.zeros(map.shape, np.int16)
    codes = np.rint((map.astype(np.float64) - middle) / step)
    return np.clip(codes, _LOWEST, _HIGHEST).astype(np.int16)


def _fixed(map: NDArray[Any], udim: int, dtype: Any) -> NDArray[Any]:
    fixed = fixed_array(map, f"the map of UDIM {udim}", (None, None), dtype, InputError)
    if fixed.size == 0 or fixed.shape[0] != fixed.shape[1]:
        rows, columns = fixed.shape
        raise InputError(f"the map of UDIM {udim} has {columns} x {rows} texels: must be square")
    return fixed


def _check_total(maps: Mapping[int, NDArray[Any]]) -> None:
    total = sum(map.size for map in maps.values())
    if total > MOST_TEXELS:
        raise LimitError(f"scanned maps have {total} texels in all: at most {MOST_TEXELS}")


def _check_maps(
    maps: Mapping[int, NDArray[Any]], udims: Sequence[int], resolution: int, what: str
) -> None:
    if not maps:
        raise InputError(f"{what} without a map: one for each UDIM")
    for udim, map in maps.items():
        check_udim(udim, udims, what)
        if len(map) != resolution:
            texels = plural(len(map), "texel")
            raise InputError(
                f"{what} of UDIM {udim} has {texels} a side, the asset has {resolution}: trace it "
                "at the resolution that is drawn"
            )
