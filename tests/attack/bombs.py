"""Uploads that are small, or allowed, and large once they are decoded."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from api.patch import obj
from exr_images import exr

MIB = 1 << 20
Files = list[tuple[str, tuple[str, bytes]]]


def mesh(name: str, data: bytes) -> Files:
    """The parts of an upload of one mesh."""
    return [("mesh", (name, data))]


def lines(line: bytes, mib: int = 64) -> bytes:
    """So many MiB of one line."""
    return line * (mib * MIB // len(line))


def zeros_npy(shape: tuple[int, ...]) -> bytes:
    """The header of an array alone; its zeros follow from `zeros`."""
    file = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    return file.getvalue()


TRIANGLE = {
    "faces": np.array([[0, 1, 2]], "<i4"),
    "uv": np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]]),
    "face_uv": np.array([[0, 1, 2]], "<i4"),
    "positions": np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]),
}


def packed(shapes: dict[str, tuple[int, ...]]) -> bytes:
    """A .npz of one triangle, and of arrays of float64 that are zeros but for what it needs, packed
    a thousand times smaller."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in TRIANGLE.items():
            if name not in shapes:
                with archive.open(f"{name}.npy", "w") as member:
                    np.lib.format.write_array(member, values)
        for name, shape in shapes.items():
            first = TRIANGLE[name].tobytes() if name in TRIANGLE else b""
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                member.write(zeros_npy(shape) + first)
                left = 8 * int(np.prod(shape)) - len(first)
                while left:
                    member.write(bytes(min(left, MIB)))
                    left -= min(left, MIB)
    return file.getvalue()


def npz_zeros() -> Files:
    """Positions of 16.6 million vertices in about 400 KiB."""
    return mesh("zeros.npz", packed({"positions": (16_600_000, 3)}))


def npz_frames() -> Files:
    """Frames of 198 million numbers."""
    return mesh("frames.npz", packed({"positions": (1000, 3), "frames": (66_000, 1000, 3)}))


def gltf_lists() -> Files:
    """32 MiB of JSON, nothing but empty lists."""
    return mesh(
        "lists.gltf", b'{"asset":{"version":"2.0"},"extras":[' + b"[]," * (32 * MIB // 3) + b"0]}"
    )


def gltf_targets(vertices: int = 30_000, targets: int = 2_200) -> Files:
    """Morph targets that have no bytes of their own."""
    where, at = np.zeros((vertices, 3), "<f4"), np.zeros((vertices, 2), "<f4")
    where[:3], at[:3] = TRIANGLE["positions"], TRIANGLE["uv"]
    positions, uv = where.tobytes(), at.tobytes()
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": len(positions)},
        {"buffer": 0, "byteOffset": len(positions), "byteLength": len(uv)},
    ]
    about: dict[str, Any] = {"componentType": 5126, "count": vertices}
    accessors = [
        {**about, "type": "VEC3", "bufferView": 0},
        {**about, "type": "VEC2", "bufferView": 1},
        {**about, "type": "VEC3"},
    ]
    primitive = {
        "attributes": {"POSITION": 0, "TEXCOORD_0": 1},
        "targets": [{"POSITION": 2}] * targets,
    }
    document = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(positions) + len(uv)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = positions + uv
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(body), 0x004E4942) + body
    return mesh("targets.glb", b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)


def ply_text(mib: int = 64) -> Files:
    """Text of vertices without faces."""
    row = b"0 0 0 0 0\n"
    count = mib * MIB // len(row)
    names = "".join(f"property float {name}\n" for name in "xyzuv")
    head = f"ply\nformat ascii 1.0\nelement vertex {count}\n{names}"
    head += "element face 0\nproperty list uchar int vertex_indices\nend_header\n"
    return mesh("rows.ply", head.encode() + row * count)


def grey_png(side: int) -> bytes:
    """A black image of 16 bits."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    packer = zlib.compressobj(9)
    row = bytes(1 + 2 * side)
    body = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    head = struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def in_udims(count: int) -> bytes:
    """An OBJ with a triangle in each of so many UDIMs."""
    text = ["v 0 0 0", "v 1 0 0", "v 0 1 0"]
    for i in range(count):
        u, v = i % 10, i // 10
        text += [f"vt {u + x} {v + y}" for x, y in ((0.1, 0.1), (0.9, 0.1), (0.1, 0.9))]
    text += [f"f 1/{3 * i + 1} 2/{3 * i + 2} 3/{3 * i + 3}" for i in range(count)]
    return "\n".join([*text, ""]).encode()


def images(count: int, data: bytes, extension: str) -> Files:
    """A stiffness map for each UDIM of a mesh."""
    maps = [("stiffness", (f"s.{1001 + i}.{extension}", data)) for i in range(count)]
    return [*mesh("udims.obj", in_udims(count)), *maps]


def exr_many() -> Files:
    """300 images of 8 x 8 texels."""
    return images(300, exr(np.zeros((8, 8), np.float16)), "exr")


def png_large() -> Files:
    """Images of 8192 x 8192 texels in 130 KiB each."""
    return images(4, grey_png(8192), "png")


def graph_tensors() -> Files:
    """A header of safetensors with many names."""
    head = json.dumps(
        {f"t{i}": {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]} for i in range(600_000)}
    ).encode()
    graph = len(head).to_bytes(8, "little") + head
    return [*mesh("patch.obj", obj()), ("graph", ("graph.safetensors", graph))]


BOMBS: dict[str, Callable[[], Files]] = {
    "obj: 64 MiB of vertices": lambda: mesh("a.obj", lines(b"v 0 0 0\n")),
    "obj: 64 MiB of empty lines": lambda: mesh("a.obj", lines(b"\n")),
    "obj: 64 MiB of faces": lambda: mesh("a.obj", b"v 0 0 0\nvt 0 0\n" + lines(b"f 1/1 1/1 1/1\n")),
    "obj: 64 MiB of one face": lambda: mesh("a.obj", b"f " + lines(b"1/1 ")),
    "npz: 16.6 million vertices of zeros": npz_zeros,
    "npz: 66,000 frames of zeros": npz_frames,
    "gltf: 32 MiB of empty lists": gltf_lists,
    "glb: 2,200 morph targets without bytes": gltf_targets,
    "ply: 64 MiB of text": ply_text,
    "exr: 300 images of 8 x 8": exr_many,
    "png: 4 images of 8192 x 8192": png_large,
    "safetensors: 600,000 names": graph_tensors,
}
