"""Squares of a mesh whose relief is measured: where they lie, and their heights at rest, strained
and in a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.preview import touched_squares
from rhytid.cli.preview_spots import Spots
from rhytid.domain.frame import NEUTRAL
from rhytid.domain.mesh import Mesh
from rhytid.domain.scan import Scan
from rhytid.domain.tiles import TileAddress, triangles_inside, udim_origin
from rhytid.engine.engine import Engine
from rhytid.engine.messages import AssetInfo, MapQuery
from rhytid.errors import InputError
from rhytid.meshes.nearest import closest
from rhytid.meshes.relief import FloatArray, levelled, without_waves
from rhytid.pictures.surface_patch import Frame, SurfacePatch, surface_patch

Positions = NDArray[np.float32]
# Places along a side of a square.
PIXELS = 400
# Share of a square that may lie beside the mesh, or behind something: none, but for rounding.
_MISSING = 1e-4


class PatchError(InputError):
    """A patch that reaches beyond the mesh or its UDIM.

    missing: share of it that does.  fitting: the largest side that would fit, millimetres; None
    where that is not known.
    """

    def __init__(self, name: str, missing: float, fitting: float | None = None) -> None:
        way = "a smaller --size" if fitting is None else f"--size {fitting:g}"
        self.name, self.missing = name, missing
        self.detail = (
            f"{100 * missing:.2g} % of it lies beside the mesh or in another UDIM: take {way} or "
            "another place"
        )
        super().__init__(f"patch {name}: {self.detail}")


@dataclass(frozen=True)
class Strain:
    """A stretch of the whole mesh in the plane of a patch: factors of lengths along and across."""

    along: float
    across: float = 1.0

    def of(self, mesh: Mesh, frame: Frame) -> Positions:
        """(V, 3) positions of the mesh, stretched around the origin of a frame."""
        local = frame.local(mesh.positions)
        moved = local * (self.along, self.across, 1.0)
        found: Positions = (frame.origin + moved @ frame.axes).astype(np.float32)
        return found


@dataclass(frozen=True, eq=False)
class Place:
    """The middle of a patch.

    name: for tables.  udim: of its map.  triangle, weights (3,): where it lies.  frame: the tangent
    plane, whose first axis is along.
    """

    name: str
    udim: int
    triangle: int
    weights: FloatArray
    frame: Frame

    @classmethod
    def of(cls, name: str, mesh: Mesh, udim: int, frame: Frame, degrees: float) -> Place:
        """The place of a frame on a mesh.  degrees: from the right of the frame to along, counter-
        clockwise, seen from outside."""
        used = np.flatnonzero(mesh.usable_triangles())
        corners = mesh.positions[mesh.faces[used]].astype(np.float64)
        found = closest(corners, frame.origin[None])
        return cls(
            name, udim, int(used[found.triangle[0]]), found.weights[0], _turned(frame, degrees)
        )

    @classmethod
    def all(cls, spots: Spots, mesh: Mesh, degrees: float) -> list[Place]:
        """The places of spots, called by their UV."""
        return [
            cls.of(
                f"{spots.udim} {spot.uv[0]:.3f} {spot.uv[1]:.3f}",
                mesh, spots.udim, spot.frame, degrees,
            )
            for spot in spots.spots
        ]  # fmt: skip

    def moved(self, mesh: Mesh, positions: Positions) -> Frame:
        """The frame on the mesh at positions (V, 3), turned with the triangle of the place."""
        face = mesh.faces[self.triangle]
        before, after = (p[face].astype(np.float64) for p in (mesh.positions, positions))
        return Frame(self.weights @ after, self.frame.carried(before, after).axes)

    def on(self, mesh: Mesh, side: float) -> Place:
        """This place, whose square of `side` mesh units lies on the mesh; raises PatchError."""
        self.seen(mesh, mesh.positions, self.frame, side)
        return self

    def seen(self, mesh: Mesh, positions: Positions, frame: Frame, side: float) -> SurfacePatch:
        """The square of `side` mesh units on the mesh at positions (V, 3). Raises PatchError where
        it reaches beyond the mesh or its UDIM."""
        inside = triangles_inside(mesh, self.udim)
        corners = positions[mesh.faces[inside]].astype(np.float64)
        uv = mesh.triangle_uv()[inside] - udim_origin(self.udim)
        found = surface_patch(corners, uv, frame, side, PIXELS)
        missing = 1.0 - found.seen.covered.mean()
        if missing > _MISSING:
            raise PatchError(self.name, float(missing))
        return found


def _turned(frame: Frame, degrees: float) -> Frame:
    right, up, out = frame.axes
    angle = np.radians(degrees)
    along = np.cos(angle) * right + np.sin(angle) * up
    return Frame(frame.origin, np.stack([along, np.cross(out, along), out]))


# (R, R) displacement of a UDIM at positions, or for None at rest, mesh units; at least where the
# square reads it.
Source = Callable[[SurfacePatch, int, "Positions | None"], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights of patches.

    source: of displacement.  side: of a patch, mm.  unit_mm: of a mesh unit.  degree: of the form
    that is taken out.  cutoff: mm above which waves are, too; None for none.
    """

    mesh: Mesh
    source: Source
    side: float
    unit_mm: float
    degree: int
    cutoff: float | None = None

    def at(self, place: Place, positions: Positions | None, frame: Frame | None) -> FloatArray:
        """(PIXELS, PIXELS) micrometres without form, on the surface at positions (V, 3); None for
        that of the neutral, and for a frame that goes with the positions."""
        where = self.mesh.positions if positions is None else positions
        axes = frame or place.moved(self.mesh, where)
        seen = place.seen(self.mesh, where, axes, self.side / self.unit_mm)
        drawn = self.source(seen, place.udim, positions)
        found = levelled(seen.heights(drawn) * (1000.0 * self.unit_mm), self.degree)
        if self.cutoff is None:
            return found
        return without_waves(found, self.cutoff, self.side / len(found))


def of_asset(engine: Engine, asset: AssetInfo) -> Source:
    """The displacement of a built asset, drawn where a square reads it."""

    def drawn(seen: SurfacePatch, udim: int, positions: Positions | None) -> NDArray[np.float32]:
        frame = NEUTRAL if positions is None else "measured"
        if positions is not None:
            engine.frames.put(asset.id, frame, positions)
        resolution, side = (int(asset.settings[name]) for name in ("resolution", "tile_size"))
        # Memory is taken by the tiles that are written, not by the whole map.
        out = np.zeros((resolution, resolution), np.float32)
        for row, column in touched_squares([seen], resolution, side):
            tile = TileAddress(udim, 0, row // side, column // side)
            found = engine.tiles.draw(asset.id, frame, MapQuery("redraw"), tile).tile
            out[row : row + side, column : column + side] = found
        return out

    return drawn


def of_scan(scan: Scan) -> Source:
    """Displacement that was scanned, which knows no strain."""

    def given(seen: SurfacePatch, udim: int, positions: Positions | None) -> NDArray[np.float32]:
        if udim not in scan.maps:
            raise InputError(f"there is no map of UDIM {udim}, where the patch lies")
        return scan.relief(udim, max(scan.maps[udim].shape))

    return given
