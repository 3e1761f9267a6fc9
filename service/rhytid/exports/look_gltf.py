"""A look as a GLB: the mesh of a frame, and materials by KHR_materials_anisotropy from its maps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh
from rhytid.exports.meshes import (
    PLAIN,
    SKIN,
    FlatMesh,
    GlbBuffer,
    flat_mesh,
    glb_attributes,
    glb_bytes,
    unit_vectors,
)
from rhytid.exports.textures.tangents import Posed, dot


@dataclass(frozen=True)
class ShineMaps:
    """PNG files of a UDIM, as `bake` writes the profiles roughness, anisotropy and normal-gl, all
    of one level."""

    roughness: bytes
    anisotropy: bytes
    normal: bytes


def write_shining_glb(mesh: Mesh, maps: Mapping[int, ShineMaps]) -> bytes:
    """The bytes of a GLB with a material for each UDIM: roughness, its anisotropy and normals from
    maps, and the normals and tangents that these are of.

    The roughness is that across the axis, of metallicRoughness; KHR_materials_anisotropy has the
    rest. UV keep their UDIM: textures repeat, as glTF has it unless told. Triangles of no UDIM that
    has maps have the plain material, the last one.
    """
    buffer, flat = GlbBuffer(), flat_mesh(mesh)
    normal, tangent = _frames(mesh, flat)
    attributes = glb_attributes(buffer, flat, normal)
    attributes["TANGENT"] = buffer.vectors(tangent, limits=False)
    column, row = np.floor(flat.uv[flat.faces].mean(axis=1)).astype(int).T
    numbers, udims = 1001 + column + 10 * row, sorted(maps)
    parts = [flat.faces[numbers == udim] for udim in udims]
    parts.append(flat.faces[~np.isin(numbers, udims)])
    primitives = [
        {"attributes": attributes, "indices": buffer.indices(part), "material": n}
        for n, part in enumerate(parts)
        if len(part)
    ]
    files = [
        file for u in udims for file in (maps[u].roughness, maps[u].anisotropy, maps[u].normal)
    ]
    images = [{"bufferView": buffer.file(file), "mimeType": "image/png"} for file in files]
    look: dict[str, Any] = {
        "materials": [*(_shining(f"skin.{u}", 3 * n) for n, u in enumerate(udims)), PLAIN],
        "images": images,
        "textures": [{"source": n} for n in range(len(images))],
        "extensionsUsed": ["KHR_materials_anisotropy"],
    }
    return glb_bytes(
        {"name": "skin", "primitives": primitives}, {"mesh": 0, "name": "skin"}, buffer, look
    )


def _frames(mesh: Mesh, flat: FlatMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(W, 3) normals and (W, 4) tangents of MikkTSpace, whose last number is the side of the
    bitangent, v up. Corners of one vertex that differ, of mirrored UV, have those of one."""
    posed, count = Posed.of(mesh, mesh.positions), len(flat.source)
    normal, tangent = (
        np.tile((0.0, 0.0, 1.0), (count, 1)),
        np.tile((1.0, 0.0, 0.0, 1.0), (count, 1)),
    )
    corners = flat.faces.reshape(-1)
    normal[corners] = unit_vectors(posed.normals.reshape(-1, 3))
    tangent[corners, :3] = posed.tangents.reshape(-1, 3)
    tangent[corners, 3] = np.repeat(np.where(posed.signs < 0, -1.0, 1.0), 3)
    along = tangent[:, :3]
    flat_on = along - dot(along, normal) * normal
    length = np.linalg.norm(flat_on, axis=1, keepdims=True)
    other = np.cross(
        normal, np.where(np.abs(normal[:, :1]) < 0.9, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    )
    tangent[:, :3] = np.where(length > 1e-12, unit_vectors(flat_on), unit_vectors(other))
    return normal, tangent


def _shining(name: str, first: int) -> dict[str, Any]:
    """A material of the three textures from `first` on."""
    anisotropy = {"anisotropyStrength": 1.0, "anisotropyTexture": {"index": first + 1}}
    colour = {"baseColorFactor": SKIN["baseColorFactor"], "metallicFactor": 0.0}
    return {
        "name": name,
        "pbrMetallicRoughness": {
            **colour,
            "roughnessFactor": 1.0,
            "metallicRoughnessTexture": {"index": first},
        },
        "normalTexture": {"index": first + 2},
        "extensions": {"KHR_materials_anisotropy": anisotropy},
    }
