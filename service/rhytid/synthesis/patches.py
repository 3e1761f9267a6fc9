"""Patches of skin: smooth random factors of its properties, over millimetres of the surface.

Skin is nowhere even: quiet patches lie beside lively ones, larger pores come in groups, and
directions sway. A value depends on nothing but its place, so that seams do not show and what is
painted elsewhere is of no account.
"""

from __future__ import annotations

import threading
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import GraphSettings
from rhytid.domain.lengths import Lengths
from rhytid.domain.patch_noise import (
    CELLS,
    CELLS_OF_WAVE,
    LEAST,
    LONGEST,
    STRENGTH_SALT,
    placement,
    table,
)
from rhytid.synthesis.pore_density import EDGES_PER_PORE, PACKING, SPACING
from rhytid.synthesis.surface import FloatArray, Surface

Factors = NDArray[np.float32]
# Deviations of logarithms where patchiness is 1, and the most, of the turn in radians; and salts of
# the fields. Pores are livelier where lines are (`beside_lines`), and vary among themselves.
_FIELDS = {
    "strength": (0.32, 1.35, STRENGTH_SALT),
    "beside_lines": (0.07, 0.3, STRENGTH_SALT),
    "pores": (0.08, 0.16, 13),
    "pore_radius": (0.10, 0.2, 13),
    "density": (0.18, 0.3, 12),
    "turn": (0.22, 0.33, 15),
    "events": (0.6, 0.9, STRENGTH_SALT),
}
# Of what keeps the mean of a log-normal factor at 1, what that of lines needs: weights end at 1,
# which takes the rest where lines are strong and patches differ much.
_KEEPS = {"strength": 0.8}
# Points at a time: what is computed on the way stays in the cache.
_ROWS = 16384
_ROW = CELLS + 2
# From node to node of the table, along x and along y.
_STEPS = _ROW * _ROW, _ROW


class Patches:
    """The fields of a surface.

    surface: that the places are on.  seed: of the graph.  wave: the longest, in units of the
    surface.  size: the same in units of the mesh.  detail: UV length within which a field hardly
    changes.
    """

    def __init__(self, surface: Surface, seed: int, wave: float) -> None:
        self._seed, self.size = seed, wave * surface.scale
        self._planes = _planes(surface, wave / CELLS_OF_WAVE)
        self._laid, self._lock = dict[int, Factors](), threading.Lock()
        length = float(np.sqrt(np.median(surface.density[surface.carries])))
        self.detail = wave / CELLS_OF_WAVE / length

    @classmethod
    def of(cls, surface: Surface, settings: GraphSettings, unit: str | None) -> Patches | None:
        """The patches that settings ask for; None for even skin.

        unit: of the mesh. Where it has no known length, lengths follow from the spacing of pores.
        """
        if settings.patches == 0.0:
            return None
        lengths = Lengths.of(_spacing(surface, settings) * surface.scale)
        wave = LONGEST.resolved(None, unit or "", lengths)
        return cls(surface, settings.start, wave / surface.scale)

    def factor(
        self, name: str, amount: Factors, triangle: NDArray[Any], uv: NDArray[Any]
    ) -> Factors:
        """(N,) factors of a property, about 1 in the mean: `strength` of lines, that of pores
        `beside_lines` and of `pores` themselves, `pore_radius`, `density`, or the height of
        `events`.

        amount: (N,) patchiness, 0 for even skin; (1,) of all.  triangle (N,), uv (N, 2): of the
        points.
        """
        deviations = _deviations(name, amount)
        found = self._noise(name, triangle, uv)
        found -= np.float32(0.5 * _KEEPS.get(name, 1.0)) * deviations
        found *= deviations
        np.exp(found, out=found)
        return _with_least(name, found)

    def turn(self, amount: Factors, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) radians by which directions sway; the arguments of `factor`."""
        found = self._noise("turn", triangle, uv)
        found *= _deviations("turn", amount)
        return found

    def bounds(self, name: str, amount: float) -> tuple[float, float]:
        """The least and the most that a factor can be where patchiness is at most `amount`."""
        deviation = float(_deviations(name, np.array([amount], np.float32))[0])
        most = float(np.abs(table()).max())
        less = 0.5 * _KEEPS.get(name, 1.0) * deviation
        ends = np.exp(deviation * (np.array([-most, most]) - less))
        low, high = _with_least(name, ends.astype(np.float32))
        return float(low), float(high)

    def _noise(self, name: str, triangle: NDArray[Any], uv: NDArray[Any]) -> Factors:
        """(N,) values of mean 0 and deviation 1."""
        planes = self._in_table(_FIELDS[name][2])
        found = np.empty(len(triangle), np.float32)
        for start in range(0, len(triangle), _ROWS):
            rows = slice(start, start + _ROWS)
            plane, (u, v) = planes.take(triangle[rows], axis=0).T, np.ascontiguousarray(uv[rows].T)
            found[rows] = _interpolated(
                *(plane[i] * u + plane[3 + i] * v + plane[6 + i] for i in range(3))
            )
        return found

    def _in_table(self, salt: int) -> Factors:
        """(F, 9) `_planes` as the field of a salt lies in the table, in single precision: 1e-4 of a
        cell at most on a face. They are kept, 36 bytes a triangle for each of four salts: places
        are asked for some thousands at a time, by several threads."""
        with self._lock:
            if salt not in self._laid:
                self._laid[salt] = self._placed(salt)
            return self._laid[salt]

    def _placed(self, salt: int) -> Factors:
        rows = placement(self._seed, salt)
        # One by one: a matrix product may round a row by where in the array it is.
        laid = np.stack(
            [
                [a * x + b * y + c * z for a, b, c, _ in rows]
                for x, y, z in self._planes.reshape(3, 3, -1)
            ]
        )
        laid[2] += np.array(rows)[:, 3:]
        return np.ascontiguousarray(laid.reshape(9, -1).T, np.float32)


def _deviations(name: str, amount: Factors) -> Factors:
    """(N,) deviations of a field where patchiness is `amount` (N,)."""
    usual, most, _ = _FIELDS[name]
    found: Factors = np.minimum(np.float32(usual) * amount, np.float32(most))
    return found


def _with_least(name: str, factor: Factors) -> Factors:
    """A log-normal factor, in place: of lines all but LEAST of it."""
    if name == "strength":
        factor *= np.float32(1.0 - LEAST)
        factor += np.float32(LEAST)
    return factor


def _interpolated(x: Factors, y: Factors, z: Factors) -> Factors:
    """(N,) values at places in cells, which it overwrites: of the quadratic spline of the table."""
    node, shares = np.zeros(len(x), np.float32), []
    for at in (x, y, z):
        nearest = np.floor(at + np.float32(0.5))
        at -= nearest
        shares.append(_shares(at))
        # Single precision counts all nodes of the table, faster than whole numbers do.
        turns = np.floor(nearest * np.float32(1.0 / CELLS))
        turns *= np.float32(CELLS)
        nearest -= turns
        node *= np.float32(_ROW)
        node += nearest
    first = node.astype(np.int64)
    total = np.zeros(len(first), np.float32)
    for i, along_x in enumerate(shares[0]):
        plane = np.zeros(len(first), np.float32)
        for j, along_y in enumerate(shares[1]):
            value = _along_z(first, i * _STEPS[0] + j * _STEPS[1], shares[2])
            value *= along_y
            plane += value
        plane *= along_x
        total += plane
    return total


def _along_z(
    first: NDArray[np.int64], beyond: int, shares: tuple[Factors, Factors, Factors]
) -> Factors:
    """(N,) sums over three nodes of the table, from so many beyond `first` (N,) on."""
    near = _threes()[beyond:].take(first, mode="clip").view(np.float32).reshape(-1, 4)
    total = near[:, 0] * shares[0]
    total += near[:, 1] * shares[1]
    total += near[:, 2] * shares[2]
    return total


@cache
def _threes() -> NDArray[np.complex128]:
    """(N,) from each node of the table on three values along z, and one without meaning: taken as
    one number of 16 bytes, so that a place takes 9 in place of 27."""
    values = np.pad(table().ravel(), (0, 3))
    found = np.stack([values[n : n + table().size] for n in range(4)], axis=1)
    return found.view(np.complex128).ravel()


def _shares(at: Factors) -> tuple[Factors, Factors, Factors]:
    """(N,) each, of the node before, of the nearest and of that after it, of places `at` beyond the
    nearest, in cells."""
    half = np.float32(0.5)
    before, after = half - at, half + at
    for share in (before, after):
        share *= share
        share *= half
    nearest = np.float32(1.0) - before
    nearest -= after
    return before, nearest, after


def _planes(surface: Surface, cell: float) -> FloatArray:
    """(9, F) of each triangle ∂X/∂u, ∂X/∂v and the place where u = v = 0, in cells."""
    steps = surface.jacobian.transpose(0, 2, 1).reshape(-1, 6)
    start = surface.corners[:, 0] - np.einsum("fxc,fc->fx", surface.jacobian, surface.uv[:, 0])
    return np.ascontiguousarray(np.concatenate([steps, start], axis=1).T / cell)


def _spacing(surface: Surface, settings: GraphSettings) -> float:
    """Mean distance of pores where density is 1, in units of the surface."""
    if settings.wrinkles is None:
        assert settings.spacing is not None
        return settings.spacing / surface.scale
    pores = settings.wrinkles / EDGES_PER_PORE
    return SPACING * float(np.sqrt(PACKING * surface.area.sum() / pores))
