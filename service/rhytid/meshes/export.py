"""Meshes as GLB, by trimesh, and as PLY: one UV a vertex, as both formats have it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh, add_centre
from rhytid.errors import QueryError


@dataclass(frozen=True, eq=False)
class FlatMesh:
    """positions (W, 3), faces (F, 3), uv (W, 2): a vertex for each pair of a vertex and a uv.
    source (W,): the vertex of the mesh that each was."""

    positions: NDArray[np.floating]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64]
    source: NDArray[np.int64]


def flat_mesh(mesh: Mesh) -> FlatMesh:
    """A mesh where it was sent, its vertices split along UV seams.

    The first V vertices are those of the mesh in their order, so that frames of it fit; what a seam
    needs beside them comes after.
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


def write_glb(mesh: FlatMesh) -> bytes:
    """A GLB, of float32."""
    import trimesh

    visual: Any = trimesh.visual.TextureVisuals(uv=mesh.uv)  # type: ignore[no-untyped-call]
    out: Any = trimesh.Trimesh(
        mesh.positions, mesh.faces, visual=visual, process=False, validate=False
    )
    data: bytes = out.export(file_type="glb", include_normals=False)
    return data


def write_ply(mesh: FlatMesh) -> bytes:
    """A binary PLY: positions of doubles where they are doubles, uv of doubles as s and t."""
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
    """A media type, and what writes a file."""

    media_type: str
    write: Callable[[FlatMesh], bytes]


MESH_FORMATS = {
    "glb": MeshFormat("model/gltf-binary", write_glb),
    "ply": MeshFormat("application/x-ply", write_ply),
}


def mesh_format(name: str) -> MeshFormat:
    """The format of that name; raises QueryError naming those there are."""
    if name not in MESH_FORMATS:
        raise QueryError(f"format {name!r}: one of {', '.join(MESH_FORMATS)}")
    return MESH_FORMATS[name]
