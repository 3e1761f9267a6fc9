"""Meshes as GLB and as PLY: one UV a vertex, as both formats have it."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import ORIGIN, Mesh, add_centre
from rhytid.errors import QueryError

# The attribute with the index that each vertex had in the mesh.
VERTEX = "_VERTEX"
SKIN = {"baseColorFactor": [0.6, 0.45, 0.38, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.5}
PLAIN = {"name": "skin", "pbrMetallicRoughness": SKIN}
_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963


@dataclass(frozen=True, eq=False)
class FlatMesh:
    """A mesh with one vertex for each pair of a position and a UV.

    positions (W, 3), faces (F, 3), uv (W, 2).  source (W,): the vertex of the original mesh that
    each vertex comes from.
    """

    positions: NDArray[np.floating]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64]
    source: NDArray[np.int64]


def flat_mesh(mesh: Mesh) -> FlatMesh:
    """The mesh with its vertices split along UV seams, its centre added again.

    The first V vertices are those of the mesh in their order, so that frames of it fit; vertices
    that seams need beside them come after.
    """
    pair = np.stack([mesh.faces.reshape(-1), mesh.face_uv.reshape(-1)], axis=1).astype(np.int64)
    both, corner = np.unique(pair, axis=0, return_inverse=True)
    first = np.append(True, both[1:, 0] != both[:-1, 0])
    count = len(mesh.positions)
    number = np.where(first, both[:, 0], count - 1 + np.cumsum(~first))
    source = np.concatenate([np.arange(count), both[~first, 0]])
    uv = np.zeros((len(source), 2))
    uv[number] = mesh.uv[both[:, 1]]
    positions = add_centre(mesh.positions, mesh.centre)[source]
    return FlatMesh(positions, number[corner.reshape(-1)].reshape(-1, 3), uv, source)


def welded(mesh: Mesh) -> NDArray[np.int64]:
    """(V,) numbers of places: vertices at the same place of the neutral, bit for bit, share one."""
    _, place = np.unique(mesh.positions + np.float32(0), axis=0, return_inverse=True)
    return place.reshape(-1).astype(np.int64)


def write_glb(mesh: FlatMesh) -> bytes:
    """The bytes of a GLB, in float32: positions, normals and UV.

    Without normals readers show facets. Vertices at one place share theirs, so that seams do not
    show.
    """
    buffer = GlbBuffer()
    attributes = glb_attributes(buffer, mesh, _smooth(mesh))
    indices = buffer.indices(mesh.faces)
    primitive = {"attributes": attributes, "indices": indices, "material": 0}
    return glb_bytes(
        {"name": "skin", "primitives": [primitive]}, {"mesh": 0, "name": "skin"}, buffer
    )


def _smooth(mesh: FlatMesh) -> NDArray[np.float64]:
    """(W, 3) unit normals, of places as float32 has them; (0, 0, 1) where the mean is zero."""
    places = np.ascontiguousarray(mesh.positions, "<f4") + np.float32(0)
    bits = places.view(np.uint32).astype(np.uint64)
    # Two sorts of whole numbers take a sixth of one of rows.
    _, line = np.unique(bits[:, 0] << 32 | bits[:, 1], return_inverse=True)
    _, place = np.unique(line.astype(np.uint64) << 32 | bits[:, 2], return_inverse=True)
    a, b, c = mesh.positions[mesh.faces.T].astype(np.float64)
    facing, count = np.cross(b - a, c - a), int(place.max()) + 1
    sums = np.zeros((count, 3))
    for corner in mesh.faces.T:
        at = place[corner]
        sums += np.stack([np.bincount(at, one, count) for one in facing.T], axis=1)
    return unit_vectors(sums)[place]


def write_ply(mesh: FlatMesh) -> bytes:
    """The bytes of a binary PLY: positions as doubles where they are doubles, else floats; uv as
    doubles called s and t."""
    wide = mesh.positions.dtype == np.float64
    real, kind = ("double", "<f8") if wide else ("float", "<f4")
    vertex = np.empty(len(mesh.positions), [("p", kind, 3), ("uv", "<f8", 2)])
    vertex["p"], vertex["uv"] = mesh.positions, mesh.uv
    face = np.empty(len(mesh.faces), [("n", "u1"), ("v", "<i4", 3)])
    face["n"], face["v"] = 3, mesh.faces
    header = [
        "ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}",
        *(f"property {real} {name}" for name in "xyz"),
        *(f"property double {name}" for name in "st"),
        f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", "",
    ]  # fmt: skip
    return "\n".join(header).encode() + vertex.tobytes() + face.tobytes()


@dataclass(frozen=True)
class MeshFormat:
    """The media type of a mesh file, and the function that writes it."""

    media_type: str
    write: Callable[[FlatMesh], bytes]


MESH_FORMATS = {
    "glb": MeshFormat("model/gltf-binary", write_glb),
    "ply": MeshFormat("application/x-ply", write_ply),
}


def mesh_format(name: str) -> MeshFormat:
    """The format of that name; raises QueryError naming the formats that are known."""
    if name not in MESH_FORMATS:
        raise QueryError(f"format {name!r}: one of {', '.join(MESH_FORMATS)}")
    return MESH_FORMATS[name]


def write_morph_glb(
    mesh: Mesh, shapes: Expressions | None, name: str, metres: float | None = None
) -> bytes:
    """The bytes of a GLB of a mesh with named shapes as morph targets.

    It has normals, UV and `_VERTEX`, the index of each vertex in the mesh. Vertices are split at UV
    seams, those of the mesh first and in their order; triangles are in the order of the mesh;
    positions are less its centre.  metres: in a mesh unit; scales the node.
    """
    flat = flat_mesh(replace(mesh, centre=ORIGIN))
    buffer = GlbBuffer()
    attributes = glb_attributes(buffer, flat, normals(mesh)[flat.source])
    attributes[VERTEX] = buffer.vectors(flat.source[:, None], limits=False)
    indices = buffer.indices(flat.faces)
    primitive: dict[str, Any] = {"attributes": attributes, "indices": indices, "material": 0}
    found: dict[str, Any] = {"name": name, "primitives": [primitive]}
    if shapes is not None and len(shapes):
        moved = (shape - mesh.positions for shape in shapes.positions)
        primitive["targets"] = [{"POSITION": buffer.vectors(d[flat.source])} for d in moved]
        found["weights"] = [0.0] * len(shapes)
        found["extras"] = {"targetNames": list(shapes.names)}
    node: dict[str, Any] = {"mesh": 0, "name": name}
    if metres is not None:
        node["scale"] = [metres] * 3
    return glb_bytes(found, node, buffer)


def normals(mesh: Mesh) -> NDArray[np.float64]:
    """(V, 3) unit normals: means of the triangles around each vertex, weighted by area; (0, 0, 1)
    where the mean is zero."""
    corners = mesh.positions[mesh.faces].astype(np.float64)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found = np.zeros((len(mesh.positions), 3))
    for column in mesh.faces.T:
        np.add.at(found, column, areas)
    return unit_vectors(found)


def unit_vectors(found: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vectors (K, 3) with the length 1; (0, 0, 1) for those without one."""
    length = np.linalg.norm(found, axis=1, keepdims=True)
    unit: NDArray[np.float64] = found / np.where(length > 0.0, length, 1.0)
    unit[length[:, 0] == 0.0] = (0.0, 0.0, 1.0)
    return unit


@dataclass
class GlbBuffer:
    """The binary part, and what the document says of it."""

    parts: list[bytes] = field(default_factory=list)
    views: list[dict[str, int]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    size: int = 0

    def vectors(self, values: NDArray[Any], *, limits: bool = True) -> int:
        """The accessor of (K, n) numbers as float32."""
        rows = np.ascontiguousarray(values, "<f4")
        kind = ("SCALAR", "VEC2", "VEC3", "VEC4")[rows.shape[1] - 1]
        accessor: dict[str, Any] = {"componentType": _FLOAT, "count": len(rows), "type": kind}
        if limits:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self._add(rows.tobytes(), accessor, _VERTICES)

    def indices(self, faces: NDArray[Any]) -> int:
        """The accessor of (F, 3) indices."""
        accessor = {"componentType": _UINT, "count": faces.size, "type": "SCALAR"}
        return self._add(np.ascontiguousarray(faces, "<u4").tobytes(), accessor, _INDICES)

    def file(self, data: bytes) -> int:
        """The view of a file, filled up so that what comes after it begins at four bytes."""
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(data)})
        whole = data + bytes(-len(data) % 4)
        self.parts.append(whole)
        self.size += len(whole)
        return len(self.views) - 1

    def _add(self, data: bytes, accessor: dict[str, Any], target: int) -> int:
        view = self.file(data)
        self.views[view]["target"] = target
        self.accessors.append({"bufferView": view, **accessor})
        return len(self.accessors) - 1


def glb_attributes(
    buffer: GlbBuffer, mesh: FlatMesh, smooth: NDArray[np.float64]
) -> dict[str, int]:
    """Accessors of positions, normals (W, 3) and UV, whose v grows downwards in glTF."""
    uv = np.stack([mesh.uv[:, 0], 1.0 - mesh.uv[:, 1]], axis=1)
    return {
        "POSITION": buffer.vectors(mesh.positions),
        "NORMAL": buffer.vectors(smooth, limits=False),
        "TEXCOORD_0": buffer.vectors(uv, limits=False),
    }


def glb_bytes(
    mesh: dict[str, Any],
    node: dict[str, Any],
    buffer: GlbBuffer,
    look: Mapping[str, Any] | None = None,
) -> bytes:
    """look: materials and what belongs to them, in place of the plain one."""
    document = {
        "asset": {"version": "2.0", "generator": "rhytid"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [mesh],
        # Readers leave texture coordinates out where there is none.
        **({"materials": [PLAIN]} if look is None else look),
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.size}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = [(b"JSON", text), (b"BIN\0", b"".join(buffer.parts))]
    body = b"".join(struct.pack("<I", len(data)) + kind + data for kind, data in chunks)
    return b"glTF" + struct.pack("<2I", 2, 12 + len(body)) + body
