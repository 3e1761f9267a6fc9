"""Files for the readers under test, written by hand so that each part can be wrong."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.mesh import Mesh

Polygons = Sequence[Sequence[int]]

# A unit square of two triangles, its uv no mere copy of its positions.
SQUARE = np.array([[0, 0, 0.5], [1, 0, 0], [1, 1, 0], [0, 1, 0.25]], np.float32)
SQUARE_UV = np.array([[0.1, 0.2], [0.9, 0.2], [0.9, 0.8], [0.1, 0.8]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
SQUARE_ARRAYS = (SQUARE, SQUARE_FACES, SQUARE_UV, SQUARE_FACES)


def same_mesh(mesh: Mesh, *arrays: Any) -> None:
    """Equal to the bit: positions, faces, uv, face_uv."""
    own = (mesh.positions, mesh.faces, mesh.uv, mesh.face_uv)
    for got, wanted in zip(own, arrays, strict=True):
        np.testing.assert_array_equal(got, wanted)


def obj(positions: Any, faces: Any, uv: Any, face_uv: Any) -> bytes:
    """Vertices, then texture coordinates, then faces; numbers with all their digits."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(positions, float).tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in np.asarray(uv, float).tolist()]
    for corners, texture in zip(np.asarray(faces) + 1, np.asarray(face_uv) + 1, strict=True):
        lines.append("f " + " ".join(f"{p}/{t}" for p, t in zip(corners, texture, strict=True)))
    return ("\n".join(lines) + "\n").encode()


def ply(
    positions: Any,
    uv: Any,
    polygons: Polygons,
    format: str = "binary_little_endian",
    st: str = "uv",
) -> bytes:
    """x, y, z as float, a colour between, texture coordinates as double, lists of int."""
    header = ["ply", f"format {format} 1.0", "comment a test", f"element vertex {len(positions)}"]
    header += [f"property float {n}" for n in "xyz"] + ["property uchar red"]
    header += [f"property double {n}" for n in st]
    header += [f"element face {len(polygons)}", "property list uchar int vertex_indices"]
    head = ("\n".join([*header, "end_header"]) + "\n").encode()
    rows = [(*map(float, p), 7, *map(float, t)) for p, t in zip(positions, uv, strict=True)]
    if format == "ascii":
        lines = [" ".join(map(repr, row)) for row in rows]
        lines += [" ".join(map(str, [len(p), *p])) for p in polygons]
        return head + ("\n".join(lines) + "\n").encode()
    order = "<" if format == "binary_little_endian" else ">"
    body = b"".join(struct.pack(f"{order}3fB2d", *row) for row in rows)
    return head + body + b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in polygons)


_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


def gltf(arrays: Mapping[str, NDArray[Any]], **attributes: Any) -> dict[str, Any]:
    """A glTF document of one primitive, its buffer as a data uri.

    `arrays`: attribute name -> (N, k) array; `indices` is (N, 1). `attributes`: of the primitive.
    """
    blob, views, accessors = b"", [], []
    for i, array in enumerate(arrays.values()):
        data = array.tobytes()
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        component, kind = _COMPONENTS[array.dtype.str[1:]], _TYPES[array.shape[1]]
        about = {"bufferView": i, "count": len(array), "componentType": component, "type": kind}
        accessors.append(about)
        blob += data + b"\0" * (-len(data) % 4)
    places = {name: i for i, name in enumerate(arrays)}
    primitive: dict[str, Any] = dict(attributes)
    if "indices" in places:
        primitive["indices"] = places.pop("indices")
    uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    return {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{**primitive, "attributes": places}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"uri": uri, "byteLength": len(blob)}],
    }


def glb(document: Mapping[str, Any]) -> bytes:
    """The same document with its buffer as the binary chunk."""
    binary = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    text = json.dumps({**document, "buffers": [{"byteLength": len(binary)}]}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def npy(array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def npy_header(header: str) -> bytes:
    """The start of a .npy file of version 1 with any text as its header."""
    text = header.encode("latin-1") + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def archive(members: Sequence[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip file of these members, as they are."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as file:
        for name, data in members:
            file.writestr(name, data)
    return stream.getvalue()
