"""The paper's own way: graphics shaders.

`redraw`: a rectangle for each element, added up by blending into a float target, then a pass that
takes the logarithm. `binned`: a fragment shader over the precomputed maps.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from rhytid.pipeline.reach import SCALE_LIMIT
from rhytid_lab.bench.peers import Unsupported, shaders
from rhytid_lab.bench.scene import Floats, Scene

_MOST_CONTEXTS = 16


class _Context:
    """A context without a window, and what was made in it."""

    def __init__(self, scene: Scene) -> None:
        self.gl = _standalone(scene.on_cpu)
        largest = self.gl.info["GL_MAX_TEXTURE_SIZE"]
        if scene.size > largest:
            raise Unsupported(f"left out: textures have {largest} texels per side at most")
        self.size = scene.size
        self.axes, self.logs = (self.buffer(a) for a in (scene.axes, scene.logs))

    def buffer(self, array: Any) -> moderngl.Buffer:
        """The bytes of an array; no buffer may be empty."""
        return self.gl.buffer(np.ascontiguousarray(array).tobytes() or b"\0" * 64)

    def target(self, components: int) -> moderngl.Framebuffer:
        """R² texels of float32 to draw into."""
        texture = self.gl.texture((self.size, self.size), components, dtype="f4")
        return self.gl.framebuffer([texture])

    def full(self, fragment: str) -> moderngl.VertexArray:
        """A pass over every texel."""
        program = self.gl.program(
            vertex_shader=shaders.glsl(shaders.FULL_VERTEX), fragment_shader=fragment
        )
        return self.gl.vertex_array(program, [])

    def read(self, target: moderngl.Framebuffer) -> Floats:
        """(R, R) on the host, row 0 at the top."""
        texels = np.frombuffer(target.read(components=1, dtype="f4"), np.float32)
        return texels.reshape(self.size, self.size)[::-1]


class Redraw:
    """Section 2.3; with exponents of 0 the neutral map."""

    def __init__(self, scene: Scene, *, stretched: bool) -> None:
        self._context = context = _Context(scene)
        response, shape = scene.settings.response, scene.settings.shape
        wrinkles, pores = scene.wrinkles, scene.pores
        self._sums, self._out = context.target(2), context.target(1)
        uniforms = {"size": float(scene.size), "limit": SCALE_LIMIT, "sharpness": shape.sharpness}
        self._elements = [
            (
                self._instances(
                    shaders.WRINKLE_VERTEX, shaders.WRINKLE_FRAGMENT,
                    {"segment": wrinkles.segments, "sized": wrinkles.sizes,
                     "triangle": wrinkles.triangle},
                    uniforms | {"bulge": shape.wrinkle_bulge,
                                "exponents": (response.alpha_w * stretched,
                                              response.alpha_d * stretched)},
                ),
                len(wrinkles.triangle),
            ),
            (
                self._instances(
                    shaders.PORE_VERTEX, shaders.PORE_FRAGMENT,
                    {"centre": pores.centres, "root": pores.roots, "triangle": pores.triangle},
                    uniforms | {"bulge": shape.pore_bulge,
                                "exponents": (response.beta_w * stretched,
                                              response.beta_d * stretched)},
                ),
                len(pores.triangle),
            ),
        ]  # fmt: skip
        self._resolve = context.full(shaders.glsl(shaders.RESOLVE_FRAGMENT))
        values = (shape.sharpness, float(shape.slots), scene.depth)
        self._resolve.program["sharpness_slots_depth"].value = values

    def run(self) -> None:
        """Draw one frame."""
        gl = self._context.gl
        self._context.axes.bind_to_storage_buffer(0)
        self._context.logs.bind_to_storage_buffer(1)
        self._sums.use()
        self._sums.clear()
        gl.enable(moderngl.BLEND)
        gl.blend_func = moderngl.ONE, moderngl.ONE
        for vertices, count in self._elements:
            vertices.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=count)
        gl.disable(moderngl.BLEND)
        self._out.use()
        self._sums.color_attachments[0].use(0)
        self._resolve.render(moderngl.TRIANGLES, vertices=3)
        gl.finish()

    def result(self) -> Floats:
        """The map (R, R)."""
        return self._context.read(self._out)

    def release(self) -> None:
        """Give the context back."""
        self._context.gl.release()

    def _instances(
        self, vertex: str, fragment: str, arrays: dict[str, Any], uniforms: dict[str, Any]
    ) -> moderngl.VertexArray:
        context = self._context
        program = context.gl.program(
            vertex_shader=shaders.glsl(shaders.RESPONSE, shaders.STRETCH, vertex),
            fragment_shader=shaders.glsl(shaders.PROFILE, fragment),
        )
        for name, value in uniforms.items():
            program[name].value = value
        content = []
        for name, array in arrays.items():
            width = array.shape[1] if array.ndim == 2 else 1
            kind = "i" if array.dtype == np.int32 else "f"
            content.append((context.buffer(array), f"{width}{kind}/i", name))
        return context.gl.vertex_array(program, content)


class Binned:
    """Section 2.4."""

    def __init__(self, scene: Scene) -> None:
        bins = scene.settings.bins
        self._context = context = _Context(scene)
        gl, layers, size = context.gl, bins.count + 1, scene.size
        codes = np.zeros((layers, size, size, 4), np.int8)
        codes[..., :3] = np.moveaxis(scene.codes[:, :, ::-1], 1, -1)
        self._codes = gl.texture_array((size, size, layers), 4, codes, dtype="i1")
        upwards = np.ascontiguousarray(scene.triangles[::-1])
        self._triangles = gl.texture((size, size), 1, upwards, dtype="i4")
        self._weights = gl.buffer(reserve=4 * layers * len(scene.axes))
        self._groups = -(-len(scene.axes) // 64)
        self._out = context.target(1)
        self._weigh = gl.compute_shader(
            shaders.glsl(shaders.RESPONSE, shaders.WEIGHTS_COMPUTE, LAYERS=layers)
        )
        self._weigh["directions"].write(scene.directions.tobytes())
        self._weigh["r_max"].value = bins.r_max
        self._weigh["count"].value = len(scene.axes)
        self._blend = context.full(shaders.glsl(shaders.BLEND_FRAGMENT, LAYERS=layers))
        self._blend.program["steps"].write(scene.steps.tobytes())
        self._blend.program["triangles"].value, self._blend.program["codes"].value = 0, 1

    def run(self) -> None:
        """Blend one frame."""
        gl = self._context.gl
        for place, buffer in enumerate((self._context.axes, self._context.logs, self._weights)):
            buffer.bind_to_storage_buffer(place)
        self._weigh.run(self._groups)
        gl.memory_barrier()
        self._out.use()
        self._triangles.use(0)
        self._codes.use(1)
        self._blend.render(moderngl.TRIANGLES, vertices=3)
        gl.finish()

    def result(self) -> Floats:
        """The map (R, R)."""
        return self._context.read(self._out)

    def release(self) -> None:
        """Give the context back."""
        for held in (self._codes, self._triangles, self._weights):
            held.release()
        self._context.gl.release()


CASES = {
    "redraw": lambda scene: Redraw(scene, stretched=True),
    "neutral": lambda scene: Redraw(scene, stretched=False),
    "binned": Binned,
}


def _standalone(on_cpu: bool) -> moderngl.Context:
    """A context on a processor or on a GPU, as OpenCL's device is; raises Unsupported."""
    seen = []
    for index in range(_MOST_CONTEXTS):
        try:
            gl = moderngl.create_context(
                standalone=True, require=430, backend="egl", device_index=index
            )
        except Exception as error:  # noqa: BLE001 moderngl has no narrower one
            reason = str(error)
            break
        seen.append(gl.info["GL_RENDERER"])
        if ("llvmpipe" in seen[-1] or "softpipe" in seen[-1]) == on_cpu:
            return gl
        gl.release()
    kind = "a processor" if on_cpu else "a GPU"
    raise Unsupported(f"no OpenGL 4.3 on {kind}: {', '.join(seen) or reason}")
