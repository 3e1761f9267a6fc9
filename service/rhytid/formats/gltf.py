"""glTF 2.0 and GLB with embedded buffers and one primitive of triangles.

Read here rather than by trimesh, which drops the UV of a GLB without a material and takes positions
that are NaN and indices out of range (5.2, `process=False`). A mesh needs three accessors, so the
reader is short. Indices into the document, offsets and lengths come from the file and are never
trusted: each is checked to be a whole number in range before it is used.

The vertex order is that of the POSITION accessor. Positions stay in the local space of the mesh:
transforms of nodes and skins are not applied, since frames are sent in that space and order too;
morph targets are read as expressions, and what animates their weights by `gltf_animation.py`. An
exporter has split the vertices along UV seams, and they stay split. glTF puts v = 0 at the top of
the image; here it is at the bottom.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.domain.wording import plural
from rhytid.errors import MeshError
from rhytid.formats.limits import MAX_FRAME_NUMBERS, check_size

_TRIANGLES = 4
_MODES = ("points", "lines", "a line loop", "a line strip", "triangles", "a strip", "a fan")
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_Object = dict[str, Any]
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}
# Extensions that a file may require without any effect on triangles and texture coordinates.
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")


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
    """The mesh of a .glb file and its morph targets; raises as `read_gltf_shapes` does."""
    return _read(glb_document(data))


def promised_by_gltf(data: bytes) -> int:
    """Bytes that the morph targets of a .gltf or .glb file take once they are read; raises
    MeshError."""
    document = glb_document(data) if data.startswith(b"glTF") else gltf_document(data)
    return document.promised_by_targets()


def gltf_document(data: bytes) -> Document:
    """The document of a .gltf file; raises MeshError where it is no glTF 2.0."""
    return Document(_parse(data), None)


def glb_document(data: bytes) -> Document:
    """The document of a .glb file; raises MeshError where it is no glTF 2.0."""
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


def _parse(text: bytes) -> dict[str, Any]:
    try:
        document = json.loads(text, parse_constant=_refuse)
    except RecursionError as exc:
        raise MeshError("the glTF JSON cannot be read: it is nested too deeply") from exc
    except ValueError as exc:
        raise MeshError(f"the glTF JSON cannot be read: {exc}") from exc
    if not isinstance(document, dict):
        raise MeshError("the glTF JSON is not an object")
    return document


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is not a number")


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


class Document:
    """The parsed JSON and the binary chunk of a GLB file, None for a .gltf file."""

    def __init__(self, root: _Object, binary: bytes | None) -> None:
        self._root = root
        self._binary = binary
        version = _dict(root.get("asset"), "asset").get("version")
        if not isinstance(version, str) or not version.startswith("2."):
            raise MeshError(f"glTF version {version!r}: only version 2 is read")
        for name in _list(root.get("extensionsRequired", []), "extensionsRequired"):
            if not str(name).startswith(_HARMLESS):
                raise MeshError(f"the file requires the extension {name!r}, not read here")

    def primitive(self) -> tuple[str, _Object]:
        """The only primitive of all meshes, and its path in the document."""
        found = []
        for m, mesh in enumerate(_list(self._root.get("meshes", []), "meshes")):
            where = f"mesh {m}"
            primitives = _dict(mesh, where).get("primitives")
            for p, primitive in enumerate(_list(primitives, f"{where} primitives")):
                found.append((f"{where} primitive {p}", primitive))
        if len(found) != 1:
            raise MeshError(f"the file has {len(found)} primitives: exactly one is read")
        where, primitive = found[0]
        return where, _dict(primitive, where)

    def objects(self, kind: str) -> list[_Object]:
        """All nodes, animations, … of the document."""
        return self.objects_in(self._root, kind, "document")

    def objects_in(self, item: _Object, kind: str, where: str) -> list[_Object]:
        """All objects of a list within an object; none where there is no such list."""
        items = _list(item.get(kind, []), f"{where} {kind}")
        return [_dict(found, f"{where} {kind}[{i}]") for i, found in enumerate(items)]

    def attribute(self, where: str, primitive: _Object, name: str, width: int) -> NDArray[Any]:
        """(V, width) float64 of an attribute; normalised integers only as texture coordinates."""
        attributes = _dict(primitive.get("attributes"), f"{where} attributes")
        if name not in attributes:
            way = ": unwrap the mesh, and export its UV" if name == "TEXCOORD_0" else ""
            raise MeshError(f"{where} has no attribute {name}{way}")
        accessor, array = self._accessor(attributes[name], f"{where} {name}", width)
        kind = array.dtype
        if kind.kind == "f":
            return array.astype(np.float64)
        if name == "POSITION" or kind.kind != "u" or kind.itemsize > 2:
            raise MeshError(f"{where} {name} holds {kind.name}: must be float32")
        if accessor.get("normalized") is not True:
            raise MeshError(f"{where} {name} holds {kind.name} that are not normalized")
        scaled: NDArray[Any] = array / float(np.iinfo(kind).max)
        return scaled

    def indices(self, where: str, primitive: _Object) -> NDArray[Any] | None:
        """(C,) unsigned vertex indices, or None where the primitive has none."""
        if "indices" not in primitive:
            return None
        array = self._accessor(primitive["indices"], f"{where} indices", 1)[1]
        if array.dtype.kind != "u":
            raise MeshError(f"{where} indices hold {array.dtype.name}: must be unsigned integers")
        return array[:, 0]

    def scalars(self, index: Any, where: str) -> NDArray[np.float64]:
        """(N,) numbers of an accessor: float32, or normalised integers."""
        accessor, array = self._accessor(index, where, 1)
        numbers = array[:, 0].astype(np.float64)
        if array.dtype.kind == "f":
            return numbers
        if array.dtype.itemsize > 2 or accessor.get("normalized") is not True:
            raise MeshError(f"{where} holds {array.dtype.name} that are not normalized")
        scaled: NDArray[np.float64] = np.maximum(numbers / np.iinfo(array.dtype).max, -1.0)
        return scaled

    def targets(
        self, where: str, primitive: _Object, vertices: int
    ) -> tuple[list[str], NDArray[np.float32]]:
        """Names and (E, V, 3) offsets of the morph targets that move vertices."""
        named: list[str] = []
        found: list[NDArray[Any]] = []
        every = _list(primitive.get("targets", []), f"{where} targets")
        names = self._target_names(len(every))
        check_size(f"{where} targets", 3 * vertices * len(every), MAX_FRAME_NUMBERS)
        for i, target in enumerate(every):
            place = f"{where} target {i}"
            index = _dict(target, place).get("POSITION")
            if index is None:
                continue
            offsets = self._sparse(index, f"{place} POSITION")
            if len(offsets) != vertices:
                held = plural(len(offsets), "vertex", "vertices")
                raise MeshError(f"{place} has {held}, the mesh has {vertices}")
            named.append(names[i])
            found.append(offsets)
        return named, np.stack(found) if found else np.empty((0, vertices, 3), np.float32)

    def promised_by_targets(self) -> int:
        """Bytes of all morph targets as doubles, which they are for a while, by the counts in the
        document."""
        where, primitive = self.primitive()
        attributes = _dict(primitive.get("attributes"), f"{where} attributes")
        positions = self._item("accessors", attributes.get("POSITION"), where)
        every = _list(primitive.get("targets", []), f"{where} targets")
        return 24 * len(every) * _whole(positions, "count", where)

    def _target_names(self, count: int) -> list[str]:
        """As exporters write them into extras of the mesh, or numbers."""
        mesh = self._root["meshes"]
        for found in mesh:
            extras = found.get("extras") if isinstance(found, dict) else None
            names = extras.get("targetNames") if isinstance(extras, dict) else None
            if isinstance(names, list) and len(names) == count:
                return [str(name) for name in names]
        return [f"{i:04d}" for i in range(count)]

    def _sparse(self, index: Any, where: str) -> NDArray[np.float32]:
        """(V, 3) float32 of an accessor that may be sparse, or have nothing but zeros."""
        accessor = self._item("accessors", index, where)
        dense = {k: v for k, v in accessor.items() if k != "sparse"}
        if accessor.get("componentType") != 5126 or accessor.get("type") != "VEC3":
            raise MeshError(f"{where} (accessor {index}): must be VEC3 of float32")
        count = _whole(accessor, "count", where)
        check_size(where, 3 * count)
        base = np.zeros((count, 3), np.float32)
        if "bufferView" in dense:
            base[:] = self._elements(dense, where, (count, 3), np.dtype("<f4"))
        if "sparse" not in accessor:
            return base
        sparse = _dict(accessor["sparse"], f"{where} sparse")
        changed = _whole(sparse, "count", f"{where} sparse")
        places, values = (_dict(sparse.get(k), f"{where} {k}") for k in ("indices", "values"))
        component = places.get("componentType")
        if component not in (5121, 5123, 5125):
            raise MeshError(f"{where} sparse indices: must be unsigned integers")
        check_size(where, 3 * changed)
        kind = np.dtype(_COMPONENTS[component])
        at = self._elements(places, f"{where} indices", (changed, 1), kind)[:, 0]
        if changed and int(at.max()) >= count:
            raise MeshError(f"{where} sparse indices: no element {int(at.max())} of {count}")
        base[at] = self._elements(values, f"{where} values", (changed, 3), np.dtype("<f4"))
        return base

    def _accessor(self, index: Any, where: str, width: int) -> tuple[_Object, NDArray[Any]]:
        accessor = self._item("accessors", index, where)
        where = f"{where} (accessor {index})"
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshError(f"{where} is sparse or has no bufferView: not read here")
        kind, component = accessor.get("type"), accessor.get("componentType")
        if kind != _TYPES[width]:
            raise MeshError(f"{where} has type {kind!r:.40}: must be {_TYPES[width]}")
        if type(component) is not int or component not in _COMPONENTS:
            raise MeshError(f"{where} has componentType {component!r:.40}, which does not exist")
        count = _whole(accessor, "count", where)
        check_size(where, count * width)
        dtype = np.dtype(_COMPONENTS[component])
        return accessor, self._elements(accessor, where, (count, width), dtype)

    def _elements(
        self, accessor: _Object, where: str, shape: tuple[int, int], dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        view = self._item("bufferViews", accessor.get("bufferView"), where)
        buffer = self._buffer(view.get("buffer"), where)
        start, length = _whole(view, "byteOffset", where, 0), _whole(view, "byteLength", where)
        if start + length > len(buffer):
            raise MeshError(f"{where}: its bufferView ends at {start + length} of {len(buffer)}")
        row = shape[1] * dtype.itemsize
        stride = _whole(view, "byteStride", where, row)
        if stride < row:
            raise MeshError(f"{where}: byteStride {stride} is below an element's {row} bytes")
        offset = _whole(accessor, "byteOffset", where, 0)
        end = offset + shape[0] * stride - (stride - row)
        if end > length:
            raise MeshError(f"{where}: {end} bytes promised, its bufferView has {length}")
        strides = (stride, dtype.itemsize)
        array: NDArray[Any] = np.ndarray(shape, dtype, buffer, start + offset, strides)
        return array

    def _buffer(self, index: Any, where: str) -> bytes:
        declared = self._item("buffers", index, where)
        where = f"buffer {index}"
        if "uri" in declared:
            content = _embedded(declared["uri"], where)
        elif index == 0 and self._binary is not None:
            content = self._binary
        else:
            raise MeshError(f"{where} has neither a uri nor the binary chunk of a GLB file")
        length = _whole(declared, "byteLength", where)
        if length > len(content):
            raise MeshError(f"{where} promises {length} bytes, there are {len(content)}")
        return content[:length]

    def _item(self, kind: str, index: Any, where: str) -> _Object:
        items = _list(self._root.get(kind, []), kind)
        if type(index) is not int or not 0 <= index < len(items):
            raise MeshError(f"{where}: no {kind}[{index!r:.40}] of {len(items)}")
        return _dict(items[index], f"{kind}[{index}]")


def _embedded(uri: Any, where: str) -> bytes:
    head, comma, body = uri.partition(",") if isinstance(uri, str) else ("", "", "")
    if not (comma and head.startswith("data:") and head.endswith(";base64")):
        raise MeshError(f"{where} points to {uri!r:.60}: only embedded base64 data is read")
    try:
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError) as exc:
        raise MeshError(f"{where}: its base64 data is damaged: {exc}") from exc


def _whole(item: _Object, key: str, where: str, default: int | None = None) -> int:
    value = item.get(key, default)
    if type(value) is not int or not 0 <= value < 1 << 40:
        raise MeshError(f"{where}: {key} is {value!r:.40}: must be a whole number")
    return value


def _dict(value: Any, where: str) -> _Object:
    if not isinstance(value, dict):
        raise MeshError(f"glTF {where}: expected an object")
    return value


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise MeshError(f"glTF {where}: expected a list")
    return value
