"""The compute shaders of stretch of a package: GLSL and HLSL in OpenGL, HLSL through glslang and
spirv-cross; WGSL on Vulkan."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import wgpu
from numpy.typing import NDArray

from rhytid.exports.skin_package.runtime import stretch

GROUP = 64
Array = NDArray[np.float32]


def computed(package: Path, language: str, positions: Array, faces: NDArray[Any]) -> Array:
    """(rows, 2 per row, 4) the texture of a frame."""
    manifest = json.loads((package / "manifest.json").read_text())["stretch"]
    rest = stretch.read_rest(package / "triangles.bin").astype("<f4")
    buffers = [positions.astype("<f4"), faces.astype("<u4"), rest]
    file = package / manifest["compute"][language]
    size = manifest["width"], manifest["height"]
    groups = manifest["triangles"] // GROUP + 1
    if language == "wgsl":
        return _by_wgpu(file.read_text(), buffers, size, groups)
    return _by_opengl(_glsl_of(file, language), buffers, size, groups)


def _glsl_of(file: Path, language: str) -> str:
    if language != "hlsl":
        return file.read_text()
    made = file.with_suffix(".spv")
    compile_ = ("-D", "-V", "-S", "comp", "-e", "main")
    subprocess.run(
        ["glslangValidator", *compile_, file, "-o", made], check=True, stdout=subprocess.DEVNULL
    )
    cross = ["spirv-cross", made, "--version", "430", "--no-es"]
    return subprocess.run(cross, check=True, capture_output=True, text=True).stdout


def _by_opengl(text: str, buffers: list[NDArray[Any]], size: tuple[int, int], groups: int) -> Array:
    gl = moderngl.create_context(standalone=True, require=430, backend="egl")
    try:
        program = gl.compute_shader(text)
        for place, data in enumerate(buffers):
            gl.buffer(data.tobytes()).bind_to_storage_buffer(place)
        out = gl.texture(size, 4, dtype="f4")
        out.bind_to_image(0, read=False, write=True)
        program.run(groups)
        gl.memory_barrier()
        return np.frombuffer(out.read(), np.float32).reshape(size[1], size[0], 4).copy()
    finally:
        gl.release()


def _by_wgpu(text: str, buffers: list[NDArray[Any]], size: tuple[int, int], groups: int) -> Array:
    device = wgpu.gpu.request_adapter_sync().request_device_sync()
    usage = wgpu.TextureUsage
    out = device.create_texture(
        size=(*size, 1), format="rgba32float", usage=usage.STORAGE_BINDING | usage.COPY_SRC
    )
    module = device.create_shader_module(code=text)
    pipeline = device.create_compute_pipeline(
        layout="auto", compute={"module": module, "entry_point": "main"}
    )
    made = [
        device.create_buffer_with_data(data=data.tobytes(), usage=wgpu.BufferUsage.STORAGE)
        for data in buffers
    ]
    entries = [
        *({"binding": n, "resource": {"buffer": one}} for n, one in enumerate(made)),
        {"binding": 3, "resource": out.create_view()},
    ]
    group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
    encoder = device.create_command_encoder()
    computing = encoder.begin_compute_pass()
    computing.set_pipeline(pipeline)
    computing.set_bind_group(0, group)
    computing.dispatch_workgroups(groups)
    computing.end()
    device.queue.submit([encoder.finish()])
    layout = {"bytes_per_row": 16 * size[0], "rows_per_image": size[1]}
    data = device.queue.read_texture({"texture": out}, layout, (*size, 1))
    found: Array = np.frombuffer(data, np.float32).reshape(size[1], size[0], 4).copy()
    device.destroy()
    return found
