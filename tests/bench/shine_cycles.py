"""The highlight of a patch of `shine_patch.py` in Cycles, from three distances, with maps of 1024²
beside displacement of 16 384²:

    python tests/bench/shine_cycles.py PATCH_DIR OUT_DIR --patch NAME [--kinds K ...] [--seed S]

By a Python that has bpy 4.2 and numpy. Writes OUT_DIR/NAME-DISTANCE-KIND.exr and prints a line for
each. One sun that has no size, no bounces, a black skin of roughness 0.35 (GGX of the Principled
BSDF; BECKMANN is that of the Glossy BSDF, whose anisotropy is ρ₂/ρ₁ - 1); light and camera stand 30
degrees to either side of the normal in the middle.

`extension` and `single` are the nodes of the extension for Blender, with two lobes and with one;
`lobes` and `moments` the same by hand.

mean: of radiance in the square of 2.8 cm.  rms: widths of the highlight along and across its longer
axis, by its second moments in the square, cm.  peak and half: of the picture smoothed by a Gaussian
of 1 mm, its largest value and the root of the area that is brighter than half of that, cm.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

BASE, SEEN, TILT = 0.35, 2.8, math.radians(30.0)
# Centimetres from the camera: pixels across (a lens of 85 mm before 3000 pixels on 36 mm), samples.
DISTANCES = {30: (661, 16), 100: (198, 180), 300: (66, 1600)}
COARSE = 8
KINDS = ("displaced", "normals", "moments", "lobes", "without", "bump", "extension", "single")
CLIENTS = Path(__file__).resolve().parents[2] / "clients"
UV, OWN = "uv", "own"


def grid(name: str, points: np.ndarray, uv: dict[str, np.ndarray]) -> bpy.types.Object:
    """Quads over points (n, m, 3), smooth; uv: (n, m, 2) by name of a layer."""
    n, m = points.shape[:2]
    mesh = bpy.data.meshes.new(name)
    at = np.arange(n * m, dtype=np.int32).reshape(n, m)
    # Rows go down v: anticlockwise from outside.
    quads = np.stack([at[1:, :-1], at[1:, 1:], at[:-1, 1:], at[:-1, :-1]], -1).reshape(-1, 4)
    mesh.vertices.add(n * m)
    mesh.vertices.foreach_set("co", np.ascontiguousarray(points, np.float32).ravel())
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.ravel())
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(quads), bool))
    for layer, values in uv.items():
        corners = np.ascontiguousarray(values.reshape(-1, 2)[quads], np.float32)
        mesh.uv_layers.new(name=layer).uv.foreach_set("vector", corners.ravel())
    mesh.update(calc_edges=True)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


class Skin:
    """A material, and what its nodes are made by."""

    def __init__(self, name: str, distribution: str) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.nodes, self.links = self.material.node_tree.nodes, self.material.node_tree.links
        self.shader, self.plain = self.nodes["Principled BSDF"], distribution == "BECKMANN"
        if self.plain:
            self.shader = self.nodes.new("ShaderNodeBsdfAnisotropic")
            self.links.new(self.shader.outputs[0], self.nodes["Material Output"].inputs[0])
        else:
            self.shader.inputs["Base Color"].default_value = (0, 0, 0, 1)
        self.shader.distribution = distribution
        self.shader.inputs["Roughness"].default_value = BASE

    def image(self, image: bpy.types.Image, uv: str, interpolation: str = "Linear"):
        image.colorspace_settings.name = "Non-Color"
        node, place = self.nodes.new("ShaderNodeTexImage"), self.nodes.new("ShaderNodeUVMap")
        node.image, node.interpolation, node.extension = image, interpolation, "EXTEND"
        place.uv_map = uv
        self.links.new(place.outputs[0], node.inputs[0])
        return node.outputs["Color"]

    def normal(self, image: bpy.types.Image, uv: str) -> None:
        node = self.nodes.new("ShaderNodeNormalMap")
        node.uv_map = uv
        self.links.new(self.image(image, uv), node.inputs["Color"])
        self.links.new(node.outputs[0], self.shader.inputs["Normal"])

    def bump(self, image: bpy.types.Image) -> None:
        node = self.nodes.new("ShaderNodeBump")
        node.inputs["Strength"].default_value = node.inputs["Distance"].default_value = 1.0
        self.links.new(self.image(image, UV), node.inputs["Height"])
        self.links.new(node.outputs[0], self.shader.inputs["Normal"])

    def math(self, operation: str, *values):
        node = self.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                self.links.new(value, socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    def channels(self, colour):
        node = self.nodes.new("ShaderNodeSeparateColor")
        self.links.new(colour, node.inputs[0])
        return node.outputs

    def gloss(self, roughness: bpy.types.Image, axes: bpy.types.Image, two: bool) -> None:
        """As "docs/shine.md" says for Cycles, with one lobe or two."""
        along, across, _ = self.channels(self.image(roughness, UV))
        if two:
            along, across = (self.wider(value) for value in (along, across))
        ratio = self.math("DIVIDE", across, along)
        strength = self.math("SUBTRACT", 1.0, self.math("MULTIPLY", ratio, ratio))
        strength = self.math("MINIMUM", self.math("DIVIDE", strength, 0.9), 1.0)
        if self.plain:
            strength = self.math("SUBTRACT", ratio, 1.0)
        x, y, _ = self.channels(self.image(axes, UV, "Closest"))
        x, y = (self.math("MULTIPLY_ADD", part, 2.0, -1.0) for part in (x, y))
        turn = self.math("DIVIDE", self.math("ARCTAN2", y, x), 2.0 * math.pi)
        tangent = self.nodes.new("ShaderNodeTangent")
        tangent.direction_type, tangent.uv_map = "UV_MAP", UV
        given = {
            "Roughness": self.math("SQRT", self.math("MULTIPLY", along, across)),
            "Anisotropy" if self.plain else "Anisotropic": strength,
            "Rotation" if self.plain else "Anisotropic Rotation": turn,
            "Tangent": tangent.outputs[0],
        }
        for name, socket in given.items():
            self.links.new(socket, self.shader.inputs[name])
        if two:
            strength = self.math("SUBTRACT", ratio, 1.0)
            self.beside(given["Roughness"], strength, turn, tangent.outputs[0])

    def wider(self, roughness):
        """That of 3 variances in place of 2."""
        wide = self.math("MULTIPLY_ADD", self.math("POWER", roughness, 4.0), 1.5, -(BASE**4) / 2)
        return self.math("POWER", wide, 0.25)

    def beside(self, roughness, strength, turn, tangent) -> None:
        """The lobe of Beckmann's distribution, and what the other one has left."""
        share = self.math("DIVIDE", BASE**4, self.math("POWER", roughness, 4.0))
        level = self.math("MULTIPLY", share, 0.5)
        self.links.new(level, self.shader.inputs["Specular IOR Level"])
        lobe, fresnel = (self.nodes.new(f"ShaderNode{n}") for n in ("BsdfAnisotropic", "Fresnel"))
        lobe.distribution = "BECKMANN"
        fresnel.inputs["IOR"].default_value = self.shader.inputs["IOR"].default_value
        colour = self.math("MULTIPLY", self.math("SUBTRACT", 1.0, share), fresnel.outputs[0])
        given = {"Roughness": roughness, "Anisotropy": strength, "Rotation": turn}
        given |= {"Tangent": tangent, "Color": colour}
        normal = self.shader.inputs["Normal"].links[0].from_socket
        self.links.new(normal, fresnel.inputs["Normal"])
        for name, socket in (given | {"Normal": normal}).items():
            self.links.new(socket, lobe.inputs[name])
        both = self.nodes.new("ShaderNodeAddShader")
        for socket, shader in zip(both.inputs, (self.shader, lobe), strict=True):
            self.links.new(shader.outputs[0], socket)
        self.links.new(both.outputs[0], self.nodes["Material Output"].inputs["Surface"])


def skin(kind: str, maps: Path, slopes: np.ndarray, distribution: str) -> bpy.types.Material:
    found = Skin(kind, distribution)

    def file(name: str) -> bpy.types.Image:
        return bpy.data.images.load(str(maps / name), check_existing=True)

    if kind == "normals":
        found.normal(floats(slopes), OWN)
    elif kind == "bump":
        found.bump(file("1k/f.1001.smile.exr"))
    elif kind in ("moments", "lobes", "without", "extension", "single"):
        found.normal(file("fine/f.normal-gl.1001.smile.png"), UV)
    if kind in ("moments", "lobes"):
        shine = (file(f"fine/f.{name}.1001.smile.png") for name in ("roughness", "anisotropy"))
        found.gloss(*shine, kind == "lobes")
    return found.material


def extended(obj: bpy.types.Object, maps: Path, lobes: bool) -> None:
    """Have the material of an object shine as the extension for Blender does it, by the same maps
    as it has them."""
    sys.path[:0] = [str(CLIENTS / "blender"), str(CLIENTS / "python")]
    import rhytid_blender
    from rhytid_blender import nodes, shine

    if not hasattr(bpy.types.Object, "rhytid"):
        rhytid_blender.register()
    given = obj.rhytid
    given.uv_map, given.roughness, given.lobes, given.strength = UV, BASE, lobes, 0.0
    nodes.set_up(obj)
    red, green = pixels(maps / "fine/f.roughness.1001.smile.png")[..., :2].transpose(2, 0, 1)
    x, y = 2.0 * pixels(maps / "fine/f.anisotropy.1001.smile.png")[..., :2].transpose(2, 0, 1) - 1.0
    strength = np.minimum((1.0 - (green / red) ** 2) / 0.9, 1.0) / (x * x + y * y)
    values = [np.sqrt(red * green), 0.5 + strength * (x * x - y * y) / 2, 0.5 + strength * x * y]
    shine.connect(obj, image_of("shine", np.stack([*values, np.ones_like(red)], -1)))


def pixels(path: Path) -> np.ndarray:
    """(n, n, 4) of a map, the lowest row first."""
    image = bpy.data.images.load(str(path), check_existing=True)
    image.colorspace_settings.name = "Non-Color"
    values = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[1], image.size[0], 4).astype(np.float64)


def image_of(name: str, values: np.ndarray) -> bpy.types.Image:
    """Of (n, n, 4), the lowest row first."""
    image = bpy.data.images.new(name, len(values), len(values), float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.ascontiguousarray(values, np.float32).ravel())
    image.pack()
    return image


def floats(slopes: np.ndarray) -> bpy.types.Image:
    """A normal map of slopes (n, n, 2); Blender's rows go up."""
    normal = np.concatenate([-slopes, np.ones_like(slopes[..., :1])], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    values = np.concatenate([normal * 0.5 + 0.5, np.ones_like(normal[..., :1])], -1)
    return image_of("slopes", values[::-1])


def stage(seed: int, shadows: bool) -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.use_denoising = "CYCLES", False
    scene.cycles.max_bounces, scene.cycles.use_adaptive_sampling = 0, False
    scene.cycles.seed, scene.render.use_persistent_data = seed, True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.cycles.cast_shadow = 10.0, 0.0, shadows
    eye = bpy.data.cameras.new("eye")
    eye.clip_end, eye.sensor_width = 1000.0, 36.0
    for data in (sun, eye):
        scene.collection.objects.link(bpy.data.objects.new(data.name, data))
    scene.camera = bpy.data.objects["eye"]
    return scene


def aim(points: np.ndarray, normals: np.ndarray, away: float) -> None:
    """Put the sun and the camera to either side of the normal in the middle."""
    middle = len(points) // 2
    target, up = (Vector(of[middle, middle].tolist()) for of in (points, normals))
    turn = up.cross(Vector((0.0, 1.0, 0.0))).cross(up).normalized()
    for name, angle in (("eye", TILT), ("sun", -TILT)):
        back = Matrix.Rotation(angle, 3, turn) @ up
        obj = bpy.data.objects[name]
        obj.location = target + away * back
        obj.rotation_euler = (-back).to_track_quat("-Z", "Y").to_euler()
    bpy.data.cameras["eye"].lens = 36.0 * away / SEEN


def smoothed(picture: np.ndarray, sigma: float) -> np.ndarray:
    reach = np.arange(-math.ceil(4 * sigma), math.ceil(4 * sigma) + 1)
    kernel = np.exp(-(reach**2) / (2 * sigma**2))
    for axis in (0, 1):
        weight = np.apply_along_axis(np.convolve, axis, np.ones_like(picture), kernel, "same")
        picture = np.apply_along_axis(np.convolve, axis, picture, kernel, "same") / weight
    return picture


def figures(picture: np.ndarray) -> dict[str, float]:
    size = len(picture)
    pixel = SEEN / size
    at = np.stack(np.mgrid[:size, :size]).reshape(2, -1) * pixel
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(at, aweights=picture.ravel(), ddof=0)))
    soft = smoothed(picture, 0.1 / pixel)
    half = pixel * math.sqrt((soft > soft.max() / 2).sum())
    named = {"mean": picture.mean(), "rms_along": spread[1], "rms_across": spread[0]}
    return {**named, "peak": soft.max(), "half": half}


def render(scene: bpy.types.Scene, path: Path, pixels: int, samples: int) -> np.ndarray:
    scene.render.resolution_x = scene.render.resolution_y = pixels
    scene.cycles.samples, scene.render.filepath = samples, str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    values = np.empty(pixels * pixels * 4, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(pixels, pixels, 4)[..., 1].astype(np.float64)


def main() -> None:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__)
    parser.add_argument("maps", type=Path), parser.add_argument("out", type=Path)
    parser.add_argument("--patch", required=True)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--distances", nargs="+", type=int, default=list(DISTANCES))
    parser.add_argument("--distribution", choices=("GGX", "BECKMANN"), default="GGX")
    parser.add_argument("--no-shadows", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    scene = stage(given.seed, not given.no_shadows)
    with np.load(given.maps / f"{given.patch}.npz") as found:
        points, normals = found["points"], found["normals"]
        slopes, heights = found["slopes"], found["heights"]
        side, whole = len(points), int(found["resolution"])
        row, column = found["corner"]
    for kind in given.kinds:
        if kind == "displaced":
            obj = grid(kind, points + heights[..., None] * normals, {})
        else:
            k = slice(0, None, COARSE)
            down, along = (i[k, k] + 0.5 for i in np.mgrid[:side, :side])
            own = np.stack([along / side, 1.0 - down / side], -1)
            uv = np.stack([(column + along) / whole, 1.0 - (row + down) / whole], -1)
            obj = grid(kind, points[k, k], {UV: uv, OWN: own})
        obj.data.materials.append(skin(kind, given.maps, slopes, given.distribution))
        if kind in ("extension", "single"):
            extended(obj, given.maps, kind == "extension")
        for away in given.distances:
            pixels, samples = DISTANCES[away]
            aim(points, normals, away)
            path = given.out / f"{given.patch}-{away}-{kind}.exr"
            told = figures(render(scene, path.resolve(), pixels, samples))
            line = " ".join(f"{name} {value:.5f}" for name, value in told.items())
            sys.stderr.write(f"FIGURES {given.patch} {away} {kind} {line}\n")
        bpy.data.objects.remove(obj)


if __name__ == "__main__":
    main()
