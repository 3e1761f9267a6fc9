"""How many wrinkles there will be, and whether they fit: asked before any work starts."""

from __future__ import annotations

import numpy as np

from rhytid.domain.asset_settings import MOST_WRINKLES, GraphSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import REGIONS
from rhytid.errors import InputError, LimitError, MeshError
from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.fields.folding import FoldField
from rhytid.synthesis.fields.painting import fields_of
from rhytid.synthesis.fields.wanted import Wanted
from rhytid.synthesis.pores.area_capacity import total_room
from rhytid.synthesis.pores.lattice import Lattice
from rhytid.synthesis.surface import Surface

FEWEST = 100
# Device memory of a synthesis: buffers of fixed size, and bytes per wrinkle and per triangle.
# 100,000 wrinkles on a sheet were measured to take 51 MB, 1.5 million 138 MB and 3 million 276 MB;
# 2,600 painted on two triangles 57 MB, 1,000 on 980,000 triangles 156 MB.
FIXED_BYTES, BYTES_A_WRINKLE, BYTES_A_TRIANGLE = 60_000_000, 100, 112
# Pores this many steps of float32 apart in UV stay apart, and lines can be drawn between them; that
# part of the surface may have less.
_STEPS, _LOST = 8.0, 0.01
# And so many steps of the lattice apart in space: their distances are then right to a sixteenth.
_PLACES = 16.0


def check_amount(
    mesh: Mesh,
    settings: GraphSettings,
    controls: Controls | None,
    memory: int,
    folds: Folds | None = None,
) -> int:
    """`wrinkles_in_all` of a mesh, without looking at it where nothing is painted and the number is
    given.

    memory: bytes that a synthesis may use on the device.
    """
    even = controls is None and (folds is None or not folds.regions)
    if even and settings.wrinkles is not None:
        share = settings.density * REGIONS[settings.region].density
        return _checked(Wanted.of(settings, 0.0), share, len(mesh.faces), memory)
    surface = Surface.of(mesh)
    folding = None if folds is None else FoldField(mesh, surface, folds, settings.age)
    fields = fields_of(surface, settings, controls, folding)
    return wrinkles_in_all(surface, settings, fields, memory)


def wrinkles_in_all(
    surface: Surface, settings: GraphSettings, fields: Fields, memory: int | None = None
) -> int:
    """How many wrinkles density makes of those of density 1.

    Raises InputError where density leaves no room for pores or there are too few, LimitError for
    more wrinkles than a graph may have, or than `memory` on the device holds; with what would fit.
    """
    share = settings.density * _room(surface, fields)
    return _checked(_wanted(surface, settings), share, len(surface.area), memory)


def check_uv(surface: Surface, settings: GraphSettings, radius: float, factor: float) -> None:
    """Raise MeshError where float32 cannot tell the pores from each other in UV.

    radius: between pores.  factor: the least of their spacing.
    """
    chosen = np.flatnonzero(surface.carries)
    widest = surface.density[chosen] / surface.narrowest[chosen]
    at = np.abs(surface.uv[chosen]).max(axis=(1, 2)).astype(np.float32)
    needed = _STEPS * np.spacing(at).astype(np.float64) * widest / factor
    order = np.argsort(-needed, kind="stable")
    lost = np.cumsum(surface.area[chosen][order]) <= _LOST * surface.area.sum()
    least = needed[order][min(np.count_nonzero(lost), len(order) - 1)]
    if radius < least:
        wanted = _wanted(surface, settings)
        fit = wanted.at_most(wanted.wrinkles * (radius / least) ** 2)
        raise MeshError(
            f"{wanted}: the UV of the mesh is so small that float32 can hold about {fit}"
        )


def check_extent(surface: Surface, settings: GraphSettings, radius: float) -> None:
    """Raise MeshError where parts of the mesh lie so far apart that places in space are too coarse
    for pores that are `radius` apart."""
    unit = Lattice.absolute(radius, *surface.extent).unit
    if radius < _PLACES * unit:
        wanted = _wanted(surface, settings)
        fit = wanted.at_most(wanted.wrinkles * (radius / (_PLACES * unit)) ** 2)
        raise MeshError(
            f"{wanted}: the parts of the mesh lie so far apart that float32 keeps places apart "
            f"for about {fit}"
        )


def check_drawn(surface: Surface, settings: GraphSettings, drawn: int) -> None:
    """Raise MeshError where fewer pores and lines fit than the area suggests."""
    if drawn < FEWEST // 2:  # for so few, the area gives the number only to some tens of per cent
        wanted = _wanted(surface, settings)
        raise MeshError(
            f"{wanted}: only {drawn} can be drawn between pores so far apart, for the UV of the "
            "mesh is in small parts; ask for a smaller spacing"
        )


def _room(surface: Surface, fields: Fields) -> float:
    """Of even skin 1."""
    return total_room(surface, fields) / float(surface.area[surface.carries].sum())


def _wanted(surface: Surface, settings: GraphSettings) -> Wanted:
    return Wanted.of(settings, float(surface.area.sum()) * surface.scale**2)


def _checked(asked: Wanted, share: float, triangles: int, memory: int | None) -> int:
    """Wrinkles in all, where they fit.  share: of these over those of density 1."""
    wanted = round(asked.wrinkles * share)
    message = str(asked)
    if share <= 0:
        raise InputError("density: the map leaves no room for pores; paint some of it lighter")
    if share != 1.0:
        message += f", with density {share:.3g} on the mean that is {wanted} in all"
    if wanted < FEWEST:
        raise InputError(f"{message}: at least {FEWEST}, {asked.at_least(FEWEST / share)}")
    fit = MOST_WRINKLES if memory is None else min(_fitting(memory, triangles), MOST_WRINKLES)
    if wanted > fit:
        limit = f"the {memory} bytes of device memory" if fit < MOST_WRINKLES else "a graph"
        raise LimitError(f"{message}: {limit} can hold {asked.at_most(fit / share)}{asked.hint}")
    return wanted


def _fitting(memory: int, triangles: int) -> int:
    """Wrinkles that so many bytes hold, on a mesh of so many triangles."""
    return max(memory - FIXED_BYTES - BYTES_A_TRIANGLE * triangles, 0) // BYTES_A_WRINKLE
