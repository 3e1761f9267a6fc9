"""glTF and GLB: what is accepted, what is refused, and what the message says."""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats.writers import SQUARE, SQUARE_FACES, SQUARE_UV, glb, gltf, same_mesh
from rhytid.errors import LimitError, MeshError
from rhytid.formats.gltf import read_glb, read_gltf

IMAGE_UV = (SQUARE_UV * (1, -1) + (0, 1)).astype(np.float32)  # v down
WANTED_UV = IMAGE_UV.astype(np.float64) * (1, -1) + (0, 1)
WANTED = (SQUARE, SQUARE_FACES, WANTED_UV, SQUARE_FACES)
INDICES = SQUARE_FACES.reshape(-1, 1).astype(np.uint16)
ARRAYS = {"POSITION": SQUARE, "TEXCOORD_0": IMAGE_UV, "indices": INDICES}
PLAIN = gltf(ARRAYS)


def text(document: Any) -> bytes:
    return json.dumps(document).encode()


def changed(change: Callable[[dict[str, Any]], object]) -> bytes:
    document = copy.deepcopy(PLAIN)
    change(document)
    return text(document)


def with_item(kind: str, index: int, **values: Any) -> bytes:
    """The plain document with other values in one of its objects."""
    return changed(lambda document: document[kind][index].update(values))


def with_primitive(**values: Any) -> bytes:
    return changed(lambda document: document["meshes"][0]["primitives"][0].update(values))


def test_v_points_up_and_the_order_is_kept() -> None:
    same_mesh(read_gltf(text(PLAIN)), *WANTED)
    same_mesh(read_glb(glb(PLAIN)), *WANTED)
    np.testing.assert_allclose(WANTED_UV, SQUARE_UV, atol=1e-7)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_every_type_of_index(dtype: Any) -> None:
    same_mesh(read_gltf(text(gltf({**ARRAYS, "indices": INDICES.astype(dtype)}))), *WANTED)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_normalised_texture_coordinates(dtype: Any) -> None:
    codes = np.array([[0, 0], [255, 0], [255, 51], [0, 51]], dtype)
    document = gltf({**ARRAYS, "TEXCOORD_0": codes})
    with pytest.raises(MeshError, match=r"TEXCOORD_0 holds uint\d+ that are not normalized"):
        read_gltf(text(document))
    document["accessors"][1]["normalized"] = True
    wanted = codes / np.iinfo(dtype).max * (1, -1) + (0, 1)
    np.testing.assert_array_equal(read_gltf(text(document)).uv, wanted)


def test_without_indices_every_three_vertices_are_a_triangle() -> None:
    corners = SQUARE_FACES.ravel()
    arrays = {"POSITION": SQUARE[corners], "TEXCOORD_0": IMAGE_UV[corners]}
    wanted = np.arange(6).reshape(2, 3)
    same_mesh(read_gltf(text(gltf(arrays))), SQUARE[corners], wanted, WANTED_UV[corners], wanted)
    arrays = {name: array[:5] for name, array in arrays.items()}
    with pytest.raises(MeshError, match="5 corners do not make whole triangles"):
        read_gltf(text(gltf(arrays)))


def test_interleaved_attributes() -> None:
    rows = np.concatenate([SQUARE, IMAGE_UV], axis=1)
    document = gltf({"POSITION": rows[:, :3], "TEXCOORD_0": IMAGE_UV, "indices": INDICES})
    mixed = gltf({"TEXCOORD_0": rows.reshape(-1, 2), "indices": INDICES})
    document["buffers"], document["bufferViews"] = mixed["buffers"], mixed["bufferViews"]
    document["bufferViews"][0]["byteStride"] = 20
    document["accessors"][1].update(bufferView=0, byteOffset=12)
    document["accessors"][2]["bufferView"] = 1
    same_mesh(read_gltf(text(document)), *WANTED)


def test_what_surrounds_the_mesh_changes_nothing() -> None:
    document = {
        **PLAIN,
        "nodes": [{"mesh": 0, "scale": [2, 2, 2], "translation": [1, 2, 3]}],
        "images": [{"uri": "file:///etc/passwd"}],
        "extensionsRequired": ["KHR_materials_unlit", "KHR_texture_transform"],
    }
    document["buffers"] = [*PLAIN["buffers"], {"uri": "never-opened.bin", "byteLength": 4}]
    same_mesh(read_gltf(text(document)), *WANTED)
    same_mesh(read_gltf(with_primitive(targets=[{"NORMAL": 99}], material=7, mode=4)), *WANTED)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "JSON cannot be read"),
        (b"\xff\xfe\xff", "JSON cannot be read"),
        (b"[]", "JSON is not an object"),
        (b"[" * 100_000, "JSON cannot be read"),
        (b'{"asset": NaN}', "NaN is not a number"),
        (b'{"a": ' + b"9" * 5000 + b"}", "JSON cannot be read"),
        (text({}), "glTF asset: expected an object"),
        (changed(lambda d: d["asset"].update(version="1.0")), "glTF version '1.0'"),
        (
            changed(lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"])),
            "requires the extension 'KHR_draco_mesh_compression'",
        ),
        (changed(lambda d: d.update(extensionsRequired=[4])), "requires the extension 4"),
        (changed(lambda d: d.update(extensionsRequired="x")), "expected a list"),
        (changed(lambda d: d.update(meshes=[])), "0 primitives: exactly one"),
        (changed(lambda d: d["meshes"].append(d["meshes"][0])), "2 primitives: exactly one"),
        (changed(lambda d: d.update(meshes=[{}])), "mesh 0 primitives: expected a list"),
        (changed(lambda d: d.update(meshes=[{"primitives": [3]}])), "primitive 0: expected an obj"),
        (with_primitive(mode=5), r"mesh 0 primitive 0: mode 5 \(a strip\): only triangles"),
        (with_primitive(mode=True), "mode True"),
        (with_primitive(mode=4.0), "mode 4.0"),
        (with_primitive(mode=-1), r"mode -1 \(unknown\)"),
        (
            with_primitive(attributes={"POSITION": 0}),
            "primitive 0 has no attribute TEXCOORD_0: unwrap the mesh",
        ),
        (with_primitive(attributes={"TEXCOORD_0": 1}), "has no attribute POSITION"),
        (with_primitive(attributes=3), "attributes: expected an object"),
        (with_primitive(indices=9), r"indices: no accessors\[9\] of 3"),
        (with_primitive(indices=-1), r"no accessors\[-1\]"),
        (with_primitive(indices=True), r"no accessors\[True\]"),
        (with_primitive(indices="0"), r"no accessors\['0'\]"),
        (with_primitive(indices=0), r"indices \(accessor 0\) has type 'VEC3': must be SCALAR"),
        (with_item("accessors", 0, sparse={"count": 1}), r"POSITION \(accessor 0\) is sparse"),
        (changed(lambda d: d["accessors"][1].pop("bufferView")), "accessor 1.* no bufferView"),
        (with_item("accessors", 0, type="VEC2"), "has type 'VEC2': must be VEC3"),
        (with_item("accessors", 0, type=[]), r"has type \[\]"),
        (with_item("accessors", 0, componentType=5130), "componentType 5130"),
        (with_item("accessors", 0, componentType=[]), r"componentType \[\]"),
        (with_item("accessors", 0, componentType=5121), "POSITION holds uint8: must be float32"),
        (with_item("accessors", 1, componentType=5120), "TEXCOORD_0 holds int8: must be float32"),
        (with_item("accessors", 2, componentType=5122), "indices hold int16: must be unsigned"),
        (with_item("accessors", 0, count=5), "60 bytes promised, its bufferView has 48"),
        (with_item("accessors", 0, count=-1), "count is -1"),
        (with_item("accessors", 0, count=1.5), "count is 1.5"),
        (with_item("accessors", 0, byteOffset=4), "52 bytes promised, its bufferView has 48"),
        (with_item("accessors", 0, byteOffset=2**63), "byteOffset is 9"),
        (with_item("accessors", 0, count=3), "3 positions but 4 texture coordinates"),
        (with_item("bufferViews", 0, byteStride=0), "byteStride 0 is below an element's 12"),
        (with_item("bufferViews", 0, byteStride=8), "byteStride 8 is below"),
        (with_item("bufferViews", 0, byteStride=16), "60 bytes promised"),
        (with_item("bufferViews", 0, byteOffset=1000), "bufferView ends at 1048 of 92"),
        (with_item("bufferViews", 0, byteLength=None), "byteLength is None"),
        (with_item("bufferViews", 0, buffer=1), r"no buffers\[1\] of 1"),
        (with_item("buffers", 0, byteLength=1000), "buffer 0 promises 1000 bytes, there are 92"),
        (with_item("buffers", 0, uri="mesh.bin"), "buffer 0 points to 'mesh.bin': only embedded"),
        (with_item("buffers", 0, uri="file:///etc/passwd"), "points to 'file:///etc/passwd'"),
        (with_item("buffers", 0, uri="data:,abc"), "points to 'data:,abc'"),
        (with_item("buffers", 0, uri="data:;base64,AB!CD"), "base64 data is damaged"),
        (with_item("buffers", 0, uri="data:;base64,ÄÄ"), "base64 data is damaged"),
        (with_item("buffers", 0, uri=7), "points to 7"),
        (changed(lambda d: d["buffers"][0].pop("uri")), "buffer 0 has neither a uri nor"),
        (text(gltf({**ARRAYS, "indices": INDICES + 1})), "triangle 1 corner 3: no vertex 4 of 4"),
        (text(gltf({**ARRAYS, "POSITION": SQUARE * np.float32(np.nan)})), "position 0 .*not fin"),
        (text(gltf({**ARRAYS, "TEXCOORD_0": IMAGE_UV * 1000})), "uv 0 is .*beyond"),
        (text(gltf({**ARRAYS, "TEXCOORD_0": IMAGE_UV * 0})), "no triangle has area"),
    ],
)
def test_refused(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_gltf(data)


def test_too_many_elements_are_refused_before_they_are_looked_for() -> None:
    with pytest.raises(LimitError, match="holds 6000000000 numbers: at most 50000000"):
        read_gltf(with_item("accessors", 0, count=2_000_000_000))


def test_a_glb_is_as_long_as_it_says() -> None:
    whole = glb(PLAIN)
    json_length = int.from_bytes(whole[12:16], "little")
    short_chunk = whole[:8] + struct.pack("<I", len(whole) - 4) + whole[12:-4]
    for data, message in [
        (b"", "must begin with 'glTF'"),
        (b"glTF\x02\0\0\0", "must begin with 'glTF'"),
        (whole[:4] + b"\x01" + whole[5:], "GLB version 1"),
        (whole[:-1], "promises .* bytes, there are"),
        (whole + b"\0", "promises .* bytes, there are"),
        (short_chunk, "chunk 1 of the GLB file promises 92 bytes, 88 are left"),
        (struct.pack("<4sII", b"glTF", 2, 15) + b"abc", "ends inside the header of chunk 0"),
        (struct.pack("<4sII", b"glTF", 2, 12), "first chunk of the GLB file is not JSON"),
        (whole[:16] + b"BIN\0" + whole[20:], "first chunk of the GLB file is not JSON"),
        (
            whole[: 20 + json_length + 4] + b"what" + whole[28 + json_length :],
            "buffer 0 has neither a uri nor the binary chunk",
        ),
    ]:
        with pytest.raises(MeshError, match=message):
            read_glb(data)


@given(
    st.lists(st.tuples(*[st.integers(0, 3)] * 3), max_size=20),
    st.lists(st.tuples(*[st.floats(-50, 50, width=32)] * 2), min_size=4, max_size=4),
)
def test_what_is_written_is_read_back_to_the_bit(
    triangles: list[tuple[int, int, int]], texture: list[tuple[float, float]]
) -> None:
    faces = np.array([*triangles, (0, 1, 2)], np.uint32)
    uv = np.array(texture, np.float32)
    uv[:3] = IMAGE_UV[:3]
    document = gltf({"POSITION": SQUARE, "TEXCOORD_0": uv, "indices": faces.reshape(-1, 1)})
    wanted = (SQUARE, faces, uv.astype(np.float64) * (1, -1) + (0, 1), faces)
    same_mesh(read_gltf(text(document)), *wanted)
    same_mesh(read_glb(glb(document)), *wanted)
