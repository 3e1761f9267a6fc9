"""glTF 2.0 and GLB with embedded buffers and one primitive of triangles.

Read here rather than by trimesh, which drops the UV of a GLB without a material and takes positions
that are NaN and indices out of range (5.2, `process=False`). A mesh needs three accessors, so the
reader is short: see `gltf_document.py` for how they are found.

The vertex order is that of the POSITION accessor. Positions stay in the local space of the mesh:
transforms of nodes and skins are not applied, since frames are sent in that space and order too;
morph targets are read as expressions, and what animates their weights by `gltf_animation.py`. An
exporter has split the vertices along UV seams, and they stay split. glTF puts v = 0 at the top of
the image; here it is at the bottom.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.gltf_document import Document

_TRIANGLES = 4
_MODES = ("points", "lines", "a line loop", "a line strip", "triangles", "a strip", "a fan")
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def read_gltf(data: bytes) -> Mesh:
    """The triangle mesh of a .gltf file; raises MeshError naming the object, or LimitError."""
    return read_gltf_shapes(data)[0]


def read_glb(data: bytes) -> Mesh:
    """The triangle mesh of a .glb file; raises MeshError naming the object, or LimitError."""
    return read_glb_shapes(data)[0]


def read_gltf_shapes(data: bytes) -> tuple[Mesh, Expressions | None]:
    """The mesh of a .gltf file and its morph targets; raises MeshError naming the object,
    FrameError over numbers of a target that are not finite, or LimitError."""
    return _read(gltf_document(data))


def read_glb_shapes(data: bytes) -> tuple[Mesh, Expressions | None]:
    """The same of a .glb file."""
    return _read(glb_document(data))


def promised_by_gltf(data: bytes) -> int:
    """Bytes that the morph targets of a .gltf or .glb file become; raises MeshError."""
    document = glb_document(data) if data.startswith(b"glTF") else gltf_document(data)
    return document.promised_by_targets()


def gltf_document(data: bytes) -> Document:
    """A .gltf file; raises MeshError where it is no glTF 2.0."""
    return Document(_parse(data), None)


def glb_document(data: bytes) -> Document:
    """A .glb file; raises MeshError where it is no glTF 2.0."""
    if len(data) < 12 or data[:4] != b"glTF":
        raise MeshError("not a GLB file: it must begin with 'glTF'")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise MeshError(f"GLB version {version}: only version 2 is read")
    if length != len(data):
        raise MeshError(f"the GLB header promises {length} bytes, there are {len(data)}")
    chunks = _chunks(data)
    if not chunks or chunks[0][0] != _JSON_CHUNK:
        raise MeshError("the first chunk of the GLB file is not JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BINARY_CHUNK else None
    return Document(_parse(chunks[0][1]), binary)


def _chunks(data: bytes) -> list[tuple[int, bytes]]:
    chunks: list[tuple[int, bytes]] = []
    start = 12
    while start < len(data):
        if start + 8 > len(data):
            raise MeshError(f"the GLB file ends inside the header of chunk {len(chunks)}")
        length, kind = struct.unpack_from("<II", data, start)
        end = start + 8 + length
        if end > len(data):
            where = f"chunk {len(chunks)} of the GLB file"
            raise MeshError(f"{where} promises {length} bytes, {len(data) - start - 8} are left")
        chunks.append((kind, data[start + 8 : end]))
        start = end
    return chunks


def _read(document: Document) -> tuple[Mesh, Expressions | None]:
    where, primitive = document.primitive()
    mode = primitive.get("mode", _TRIANGLES)
    if type(mode) is not int or mode != _TRIANGLES:
        known = _MODES[mode] if type(mode) is int and 0 <= mode < len(_MODES) else "unknown"
        raise MeshError(f"{where}: mode {mode!r} ({known}): only triangles (4) are read")
    positions = document.attribute(where, primitive, "POSITION", 3)
    uv = document.attribute(where, primitive, "TEXCOORD_0", 2)
    if len(positions) != len(uv):
        held = plural(len(uv), "texture coordinate")
        raise MeshError(f"{where}: {plural(len(positions), 'position')} but {held}")
    faces = _faces(where, document.indices(where, primitive), len(positions))
    mesh = Mesh(positions.astype(np.float32), faces, uv * (1, -1) + (0, 1), faces)
    return mesh, _targets(document, where, primitive, positions)


def _targets(
    document: Document, where: str, primitive: dict[str, Any], positions: NDArray[Any]
) -> Expressions | None:
    names, offsets = document.targets(where, primitive, len(positions))
    if not names:
        return None
    return Expressions.checked(positions + offsets, len(positions), names)


def _faces(where: str, indices: NDArray[Any] | None, vertices: int) -> NDArray[np.int32]:
    if indices is None:
        indices = np.arange(vertices)
    if len(indices) % 3:
        raise MeshError(
            f"{where}: {plural(len(indices), 'corner does', 'corners do')} not make whole triangles"
        )
    beyond = indices >= vertices
    if beyond.any():
        bad = int(np.argmax(beyond))
        place = f"triangle {bad // 3} corner {bad % 3 + 1}"
        raise MeshError(f"{where}: {place}: no vertex {indices[bad]} of {vertices}")
    return indices.reshape(-1, 3).astype(np.int32)


def _parse(text: bytes) -> dict[str, Any]:
    try:
        document = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as exc:
        raise MeshError(f"the glTF JSON cannot be read: {exc}") from exc
    if not isinstance(document, dict):
        raise MeshError("the glTF JSON is not an object")
    return document


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is not a number")
