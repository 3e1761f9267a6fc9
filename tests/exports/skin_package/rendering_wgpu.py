"""The WGSL and the HLSL of a package on Vulkan, from its files alone. HLSL goes through glslang to
SPIR-V, whose binding numbers spirv-cross tells."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray

from exports.skin_package.ktx2 import read_ktx2

FORMATS = {10: "r8snorm", 74: "r16uint", 98: "r32uint"}
Named = dict[str, Any]


class Shaders:
    """Modules of a language, and where each has its textures."""

    def __init__(self, device: Any, package: Path, manifest: Named, language: str) -> None:
        self._device, self._package = device, package
        self._of, self._language = manifest["shaders"][language], language
        self.vertex = self._module(self._of["vertex"], "vert")[0]
        self.passes = {n: self._module(f, "frag") for n, f in self._of["passes"].items()}

    def _module(self, file: str, stage: str) -> tuple[Any, dict[str, int]]:
        path = self._package / file
        if self._language == "wgsl":
            module = self._device.create_shader_module(code=path.read_text())
            text = path.read_text()
            names = self._of["bindings"].items()
            return module, {name: n for name, n in names if f"var {name}:" in text}
        made = path.with_suffix(".spv")
        compile_ = ("-D", "-V", "--auto-map-bindings", "-S", stage, "-e", "main")
        subprocess.run(
            ["glslangValidator", *compile_, str(path), "-o", str(made)],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        told = subprocess.run(["spirv-cross", made, "--reflect"], check=True, capture_output=True)
        images = json.loads(told.stdout).get("separate_images", [])
        module = self._device.create_shader_module(code=made.read_bytes())
        return module, {one["name"]: one["binding"] for one in images}


class WebGpuRenderer:
    """Draws one UDIM of a package."""

    def __init__(self, package: Path, udim: int, language: str) -> None:
        self.manifest: Named = json.loads((package / "manifest.json").read_text())
        self._package, self._udim = package, str(udim)
        adapter = wgpu.gpu.request_adapter_sync()
        self._device = adapter.request_device_sync()
        self._shaders = Shaders(self._device, package, self.manifest, language)
        self._textures: Named = {}
        self._add("rhytid_maps", self.manifest["textures"])
        self._add("rhytid_triangles", self.manifest["triangles"])
        self._add_sets("rhytid_wrinkles", "rhytid_wrinkle_codes", self.manifest["wrinkles"])
        cushion = self.manifest["cushion"]
        if cushion is not None:
            self._add("rhytid_cushions", cushion["textures"])
            self._add("rhytid_cushion_owners", cushion["owners"])
            self._add("rhytid_cushion_lines", cushion["lines"])
        if "residual" in self.manifest:
            self._add("rhytid_residual", self.manifest["residual"]["textures"])

    def heights(self, stretch: NDArray[np.float32]) -> NDArray[np.float32]:
        """(R, R) mesh units, row 0 at the top.  stretch: the texture of a frame."""
        made = self._texture("rgba32float", stretch[None])
        self._textures["rhytid_stretch"] = made.create_view()
        weights = self.manifest["weights"]
        size = weights["width"], weights["height"]
        self._textures["rhytid_weights"] = self._draw("weights", size, "rgba32float").create_view()
        if "lines" in self._shaders.passes:
            lines = self.manifest["cushion"]["lines"]
            drawn = self._draw("lines", (lines["width"], lines["height"]), "rgba32float")
            self._textures["rhytid_cushion_stretch"] = drawn.create_view()
        if "cushion" in self._shaders.passes:
            side = self.manifest["cushion"]["textures"]["size"]
            drawn = self._draw("cushion", (side, side), "r32float")
            self._textures["rhytid_cushion"] = drawn.create_view()
        side = self.manifest["resolution"]
        return self._read(self._draw("height", (side, side), "r32float"), side)

    def release(self) -> None:
        self._device.destroy()

    def _add_sets(self, numbers: str, codes: str, described: Named) -> None:
        self._add(numbers, described["textures"])
        self._add(codes, described["codes"])

    def _add(self, name: str, described: Named) -> None:
        found = read_ktx2(self._package / described["files"][self._udim])
        made = self._texture(FORMATS[found.format], found.levels[0][..., None])
        self._textures[name] = made.create_view(dimension="2d-array")

    def _texture(self, format: str, texels: NDArray[Any]) -> Any:
        """texels: (layers, rows, columns, channels)."""
        layers, rows, columns, _ = texels.shape
        size = (columns, rows, layers)
        usage = wgpu.TextureUsage.TEXTURE_BINDING | wgpu.TextureUsage.COPY_DST
        made = self._device.create_texture(size=size, format=format, usage=usage)
        data = np.ascontiguousarray(texels)
        layout = {"bytes_per_row": data[0, 0].nbytes, "rows_per_image": rows}
        self._device.queue.write_texture({"texture": made}, data, layout, size)
        return made

    def _draw(self, name: str, size: tuple[int, int], format: str) -> Any:
        module, bindings = self._shaders.passes[name]
        usage = wgpu.TextureUsage
        out = self._device.create_texture(
            size=(*size, 1), format=format,
            usage=usage.RENDER_ATTACHMENT | usage.TEXTURE_BINDING | usage.COPY_SRC,
        )  # fmt: skip
        pipeline = self._device.create_render_pipeline(
            layout="auto",
            vertex={"module": self._shaders.vertex, "entry_point": "main"},
            fragment={"module": module, "entry_point": "main", "targets": [{"format": format}]},
        )
        layout = pipeline.get_bind_group_layout(0)
        read = self._read_by(name, bindings)
        entries = [{"binding": n, "resource": self._textures[one]} for one, n in read.items()]
        group = self._device.create_bind_group(layout=layout, entries=entries)
        encoder = self._device.create_command_encoder()
        target = {"view": out.create_view(), "load_op": "clear", "store_op": "store"}
        drawing = encoder.begin_render_pass(color_attachments=[target])
        drawing.set_pipeline(pipeline)
        drawing.set_bind_group(0, group)
        drawing.draw(3)
        drawing.end()
        self._device.queue.submit([encoder.finish()])
        return out

    def _read_by(self, name: str, bindings: dict[str, int]) -> dict[str, int]:
        """Bindings that a pass uses: what it does not is left out of the layout."""
        cushion = {"rhytid_cushions", "rhytid_cushion_owners", "rhytid_cushion_stretch"}
        lines = {"rhytid_cushion_lines", "rhytid_stretch"}
        used = {"cushion": cushion, "lines": lines, "weights": {"rhytid_stretch"}}.get(name)
        others = {*bindings} - cushion - lines
        return {one: n for one, n in bindings.items() if one in (used or others)}

    def _read(self, texture: Any, side: int) -> NDArray[np.float32]:
        layout = {"bytes_per_row": 4 * side, "rows_per_image": side}
        data = self._device.queue.read_texture({"texture": texture}, layout, (side, side, 1))
        return np.frombuffer(data, np.float32).reshape(side, side)
