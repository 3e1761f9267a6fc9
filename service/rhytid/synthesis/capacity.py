"""How many wrinkles a synthesis will make, and whether they fit: checked before any work starts."""

from __future__ import annotations

import numpy as np

from rhytid.domain.asset_settings import MOST_WRINKLES, GraphSettings
from rhytid.domain.expressions import Folds
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls
from rhytid.domain.skin import regions
from rhytid.errors import InputError, LimitError, MeshError
from rhytid.synthesis.build_size import RequestedCount
from rhytid.synthesis.fields import Fields
from rhytid.synthesis.fold_field import FoldField
from rhytid.synthesis.lattice import Lattice
from rhytid.synthesis.painted_fields import fields_of
from rhytid.synthesis.pore_density import effective_area
from rhytid.synthesis.surface import Surface

FEWEST = 100
# Device memory of a synthesis: buffers of fixed size, and bytes per wrinkle and per triangle.
# 100,000 wrinkles on a sheet were measured to take 51 MB, 1.5 million 138 MB and 3 million 276 MB;
# 2,600 painted on two triangles 57 MB, 63 MB in a dense patch of skin, 1,000 on 980,000 triangles
# 156 MB.
FIXED_BYTES, BYTES_A_WRINKLE, BYTES_A_TRIANGLE = 64_000_000, 100, 112
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
    """The result of `wrinkles_in_all` for a mesh. The mesh is not measured where nothing is painted
    and the settings give the number of wrinkles.

    memory: bytes that a synthesis may use on the device.  Raises what `wrinkles_in_all` does.
    """
    even = controls is None and (folds is None or not folds.regions)
    if even and settings.wrinkles is not None:
        share = settings.density * regions(settings.anatomy)[settings.region].density
        return _checked(RequestedCount.of(settings, 0.0), share, len(mesh.faces), memory)
    surface = Surface.of(mesh)
    folding = None if folds is None else FoldField(mesh, surface, folds, settings.age)
    fields = fields_of(surface, settings, controls, folding)
    return wrinkles_in_all(surface, settings, fields, memory)


def wrinkles_in_all(
    surface: Surface, settings: GraphSettings, fields: Fields, memory: int | None = None
) -> int:
    """How many wrinkles there are in all, with the density of settings and fields.

    Raises InputError where the density leaves no room for pores or there are fewer than FEWEST;
    LimitError where there are more than a graph may have, or than `memory`, bytes on the device,
    holds. Messages say what would fit.
    """
    share = settings.density * _relative_area(surface, fields)
    return _checked(_requested(surface, settings), share, len(surface.area), memory)


def check_radius(
    surface: Surface, settings: GraphSettings, radius: float, least_spacing: float
) -> None:
    """Raise MeshError where float32 cannot tell pores from each other, in UV or in space.

    radius: between pores on even skin, in units of the surface.  least_spacing: the least factor of
    it.
    """
    _check_uv(surface, settings, radius, least_spacing)
    _check_extent(surface, settings, radius * least_spacing)


def _check_uv(surface: Surface, settings: GraphSettings, radius: float, factor: float) -> None:
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
        requested = _requested(surface, settings)
        fit = requested.at_most(requested.wrinkles * (radius / least) ** 2)
        raise MeshError(
            f"{requested}: the UV of the mesh is so small that float32 can hold about {fit}"
        )


def _check_extent(surface: Surface, settings: GraphSettings, radius: float) -> None:
    """Raise MeshError where the parts of the mesh lie so far apart that places in space are too
    coarse for pores `radius` apart."""
    unit = Lattice.absolute(radius, *surface.extent).unit
    if radius < _PLACES * unit:
        requested = _requested(surface, settings)
        fit = requested.at_most(requested.wrinkles * (radius / (_PLACES * unit)) ** 2)
        raise MeshError(
            f"{requested}: the parts of the mesh lie so far apart that float32 keeps places apart "
            f"for about {fit}"
        )


def check_drawn(surface: Surface, settings: GraphSettings, drawn: int) -> None:
    """Raise MeshError where so few of the lines can be `drawn` that the UV must be in small
    parts."""
    if drawn < FEWEST // 2:  # for so few, the area gives the number only to some tens of per cent
        requested = _requested(surface, settings)
        raise MeshError(
            f"{requested}: only {drawn} can be drawn between pores so far apart, for the UV of the "
            "mesh is in small parts; ask for a smaller spacing"
        )


def _relative_area(surface: Surface, fields: Fields) -> float:
    """The effective area over the area that carries pores: 1 for even skin."""
    return effective_area(surface, fields) / float(surface.area[surface.carries].sum())


def _requested(surface: Surface, settings: GraphSettings) -> RequestedCount:
    return RequestedCount.of(settings, float(surface.area.sum()) * surface.scale**2)


def _checked(asked: RequestedCount, share: float, triangles: int, memory: int | None) -> int:
    """Wrinkles in all, where they fit.  share: of these over those of density 1."""
    requested = round(asked.wrinkles * share)
    message = str(asked)
    if share <= 0:
        raise InputError("density: the map leaves no room for pores; paint some of it lighter")
    if share != 1.0:
        message += f", with density {share:.3g} on the mean that is {requested} in all"
    if requested < FEWEST:
        raise InputError(f"{message}: at least {FEWEST}, {asked.at_least(FEWEST / share)}")
    fit = MOST_WRINKLES if memory is None else min(_fitting(memory, triangles), MOST_WRINKLES)
    if requested > fit:
        limit = f"the {memory} bytes of device memory" if fit < MOST_WRINKLES else "a graph"
        raise LimitError(f"{message}: {limit} can hold {asked.at_most(fit / share)}{asked.hint}")
    return requested


def _fitting(memory: int, triangles: int) -> int:
    """Wrinkles that so many bytes hold, on a mesh of so many triangles."""
    return max(memory - FIXED_BYTES - BYTES_A_TRIANGLE * triangles, 0) // BYTES_A_WRINKLE
