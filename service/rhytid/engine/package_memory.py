"""How much memory of the host making a skin package takes."""

from __future__ import annotations

from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.skin_package.maps import CUSHIONS, WRINKLES, SkinMaps

# A glTF of the mesh: positions, normals, UV and indices of a vertex, split at seams, and what they
# are written from; of a shape the same without indices.
_VERTEX, _MOVED = 256, 96
# Of a set of codes of a texel: its number, twice while it is looked up, and what was found.
_NUMBER = 12
# Codes of all levels over those of the finest.
_LEVELS = 4 / 3


def making_bytes(maps: SkinMaps, mesh: Mesh, shapes: Expressions | None) -> int:
    """Bytes, about: the maps of one UDIM, their pages and levels, and the mesh with its shapes."""
    texels = maps.settings.resolution**2
    layers = sum(map(maps.count, maps.names))
    wrinkles = maps.count(WRINKLES)
    room = texels * (layers + wrinkles)
    if maps.bins.cushion is not None:
        room += maps.count(CUSHIONS) * maps.cushion_side**2
    sets = maps.bins.layers[WRINKLES] * _NUMBER
    # All layers in one array, cut into pages, with their levels; then the wrinkles alone, as sets.
    textures = texels * (layers + max(layers * _LEVELS, wrinkles * _LEVELS + sets * _LEVELS))
    moved = 0 if shapes is None else len(shapes.names or ())
    written = len(mesh.positions) * (_VERTEX + moved * _MOVED)
    return int(room + textures) + written
