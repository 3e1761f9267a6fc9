"""The shaders of a package in OpenGL without a window, from its files alone."""

from __future__ import annotations

import ctypes
import json
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from exports.skin_package.ktx2 import read_ktx2

CUSHIONS = ("rhytid_cushions", "rhytid_cushion_owners", "rhytid_cushion_lines")
KINDS = {10: "ni1", 74: "u2", 98: "u4"}
_ARRAY, _RED, _BYTE, _R8_SNORM, _UNPACK_ALIGNMENT = 0x8C1A, 0x1903, 0x1400, 0x8F94, 0x0CF5


class Renderer:
    """Draws one UDIM of a package."""

    def __init__(self, package: Path, udim: int, dialect: str) -> None:
        self.manifest: dict[str, Any] = json.loads((package / "manifest.json").read_text())
        self._package, self._udim = package, str(udim)
        # 4.3 is the first that takes GLSL ES 3.00, too.
        self.gl = moderngl.create_context(standalone=True, require=430, backend="egl")
        shaders = self.manifest["shaders"][dialect]
        vertex = (package / shaders["vertex"]).read_text()
        self._passes = {
            name: self.gl.program(vertex, fragment_shader=(package / file).read_text())
            for name, file in shaders["passes"].items()
        }
        self._textures = {"rhytid_maps": self._array(self.manifest["textures"])}
        self._add_sets("rhytid_wrinkles", "rhytid_wrinkle_codes", self.manifest["wrinkles"])
        self._textures["rhytid_triangles"] = self._array(self.manifest["triangles"])
        cushion = self.manifest["cushion"]
        if cushion is not None:
            for name, of in zip(CUSHIONS, ("textures", "owners", "lines"), strict=True):
                self._textures[name] = self._array(cushion[of])
        if "residual" in self.manifest:
            self._textures["rhytid_residual"] = self._array(self.manifest["residual"]["textures"])

    def heights(self, stretch: NDArray[np.float32], last: str = "height") -> NDArray[np.float32]:
        """(R, R) mesh units, row 0 at the top.  stretch: the texture of a frame.  last: the pass
        that draws them, or a program that `take` was given."""
        rows, columns, _ = stretch.shape
        made = self.gl.texture((columns, rows), 4, stretch.tobytes(), dtype="f4")
        made.filter = moderngl.NEAREST, moderngl.NEAREST
        self._textures["rhytid_stretch"] = made
        weights = self.manifest["weights"]
        size = weights["width"], weights["height"]
        self._textures["rhytid_weights"] = self._draw("weights", size, 4)
        if "lines" in self._passes:
            lines = self.manifest["cushion"]["lines"]
            drawn = self._draw("lines", (lines["width"], lines["height"]), 4)
            self._textures["rhytid_cushion_stretch"] = drawn
        if "cushion" in self._passes:
            side = self.manifest["cushion"]["textures"]["size"]
            self._textures["rhytid_cushion"] = self._draw("cushion", (side, side))
        side = self.manifest["resolution"]
        out = self._draw(last, (side, side))
        return np.frombuffer(out.read(), np.float32).reshape(side, side)

    def take(self, name: str, vertex: str, fragment: str) -> None:
        """A program of another generator in place of the last pass; it has texture coordinates."""
        self._passes[name] = self.gl.program(vertex, fragment_shader=fragment)
        # Both triangles of the target; v is up.
        corners = [(x, y) for x, y in ((0, 0), (1, 0), (0, 1), (1, 0), (1, 1), (0, 1))]
        rows = [(2 * x - 1, 2 * y - 1, 0, x, 1 - y) for x, y in corners]
        self._square = self.gl.buffer(np.array(rows, np.float32).tobytes())
        for matrix in ("u_worldMatrix", "u_viewProjectionMatrix"):
            self._passes[name][matrix].write(np.eye(4, dtype=np.float32).tobytes())

    def release(self) -> None:
        self.gl.release()

    def _add_sets(self, numbers: str, codes: str, described: dict[str, Any]) -> None:
        self._textures[numbers] = self._array(described["textures"])
        self._textures[codes] = self._array(described["codes"])

    def _array(self, described: dict[str, Any]) -> moderngl.TextureArray:
        found = read_ktx2(self._package / described["files"][self._udim])
        layers, rows, columns = found.levels[0].shape
        kind = KINDS[found.format]
        made = self.gl.texture_array(
            (columns, rows, layers), 1, found.levels[0].tobytes(), alignment=1, dtype=kind
        )
        made.filter = moderngl.NEAREST, moderngl.NEAREST
        if kind == "ni1":
            _as_snorm(made, np.ascontiguousarray(found.levels[0]))
        return made

    def _draw(self, name: str, size: tuple[int, int], channels: int = 1) -> moderngl.Texture:
        program = self._passes[name]
        out = self.gl.texture(size, channels, dtype="f4")
        out.filter = moderngl.NEAREST, moderngl.NEAREST
        target = self.gl.framebuffer([out])
        target.use()
        for place, (uniform, texture) in enumerate(self._textures.items()):
            if uniform in program:
                texture.use(place)
                program[uniform].value = place
        if "i_position" in program:
            content = [(self._square, "3f 2f", "i_position", "i_texcoord_0")]
            self.gl.vertex_array(program, content).render(moderngl.TRIANGLES)
        else:
            self.gl.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)
        self.gl.finish()
        return out


def _as_snorm(texture: moderngl.TextureArray, codes: NDArray[np.int8]) -> None:
    """Give a texture the format R8_SNORM, for which moderngl has no name."""
    layers, rows, columns = codes.shape
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    calls = (
        (b"glPixelStorei", (_UNPACK_ALIGNMENT, 1)),
        (b"glBindTexture", (_ARRAY, texture.glo)),
        (b"glTexImage3D", (_ARRAY, 0, _R8_SNORM, columns, rows, layers, 0, _RED, _BYTE)),
    )
    for name, arguments in calls:
        kinds, values = [ctypes.c_int] * len(arguments), [*arguments]
        if name == b"glTexImage3D":
            kinds.append(ctypes.c_void_p)
            values.append(codes.ctypes.data)
        ctypes.CFUNCTYPE(None, *kinds)(egl.eglGetProcAddress(name))(*values)
