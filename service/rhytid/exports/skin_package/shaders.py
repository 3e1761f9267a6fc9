"""The shader of a package in every language, and as a node of MaterialX.

There is one source, into which the numbers of a manifest are put.

The blend reads numbers of texture arrays, for which MaterialX has no nodes. So the node is defined
here: for GLSL and ESSL it is the function of the shader, whose textures the program that draws
binds by name, as it does for the passes; everywhere else it reads a height map, from `bake` or from
the last pass. After the MaterialX specification, "Custom Nodes".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from rhytid.exports.skin_package.languages import LANGUAGES, Language, preprocessed, runtime_text
from rhytid.exports.skin_package.manifest import Blend, Layer, Manifest, MaterialX
from rhytid.exports.skin_package.runtime import runtime
from rhytid.pipeline.events import EVENT_LAYER

MERGES = ("min", "soft", "signed")
# The languages of the compute shaders of stretch, by their names in the manifest.
COMPUTE = {
    "glsl-430": replace(LANGUAGES["glsl-410"], head="#version 430\n"),
    "hlsl": LANGUAGES["hlsl"],
    "wgsl": LANGUAGES["wgsl"],
}
NODE, DEFINITION = "rhytid_height", "ND_rhytid_height_float"
DOCUMENT = "skin.mtlx"
# The languages of MaterialX's targets: its name for each, and the name in the manifest.
TARGETS = {"genglsl": "glsl-410", "essl": "glsl-es-300"}
_VERSION = "1.39"
_FUNCTION = "rhytid_height_at"
# Texture coordinates have v up; those of other UDIMs are of the textures that are bound.
_ENTRY = """
// For a node of MaterialX. file: read by targets that have no function of their own.
void rhytid_height_at(sampler2D file, vec2 texcoord, out float result)
{
    vec2 part = vec2(fract(texcoord.x), 1.0 - fract(texcoord.y));
    ivec2 texel = min(ivec2(part * float(RHYTID_RESOLUTION)), RHYTID_RESOLUTION - 1);
    result = rhytid_height(texel);
}
"""
_PRECISION = """precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp usampler2DArray;
"""
Number = int | float | Sequence[float]


def shader_texts(manifest: Manifest) -> dict[str, str]:
    """The shader texts of all languages, by file name.

    Libraries hold functions alone, for the shaders of an engine; passes are whole shaders.
    """
    found: dict[str, str] = {}
    for name, language in LANGUAGES.items():
        shaders = manifest.shaders[name]
        libraries = {one: library(manifest, language, one) for one in shaders.libraries}
        found |= {file: libraries[one] for one, file in shaders.libraries.items()}
        found[shaders.vertex] = f"{language.head}{runtime_text(language, 'full.vert')}"
        for one, file in shaders.passes.items():
            functions = libraries["weights" if one in ("weights", "lines") else "skin"]
            found[file] = f"{language.head}{functions}{entry(language, one)}"
        slopes = _of_slopes(manifest, language)
        for one, file in shaders.moments.items():
            found[file] = f"{language.head}{slopes}{entry(language, one)}"
    for name, file in manifest.stretch.compute.items():
        found[file] = stretch_text(manifest, COMPUTE[name])
    return found


def stretch_file(name: str) -> str:
    """The file name of the compute shader of stretch in a language of COMPUTE."""
    return f"shaders/{name}/stretch.comp{COMPUTE[name].suffix}"


def stretch_text(manifest: Manifest, language: Language) -> str:
    """The compute shader of stretch."""
    stretch = manifest.stretch
    named = (("TRIANGLES", stretch.triangles), ("TRIANGLES_A_ROW", stretch.triangles_a_row))
    numbers = "\n".join(language.number("int", f"RHYTID_{n}", str(v)) for n, v in named)
    functions = language.translated(runtime("stretch.glsl"))
    return f"{language.head}{numbers}\n\n{functions}\n{runtime_text(language, 'stretch.txt')}"


def library(manifest: Manifest, language: Language, name: str) -> str:
    """The library `weights`, `skin` or `shine`: its functions, with the constants and textures that
    they read."""
    if name == "shine":
        unit = _constant(language, "SLOPE_UNIT", slope_unit(manifest))
        return f"{unit}\n\n{language.translated(runtime('shine.glsl'))}\n"
    text = f"{runtime('scale.glsl')}\n{runtime(f'{name}.glsl')}"
    source = preprocessed(text, flags(manifest))
    load = runtime_text(language, "load.txt")
    return f"{constants(manifest, language)}\n{load}\n{language.translated(source)}\n"


def _of_slopes(manifest: Manifest, language: Language) -> str:
    """The functions of the passes that make moments of slopes."""
    numbers: list[tuple[str, Number]] = [
        ("RESOLUTION", manifest.resolution),
        ("PAGE", manifest.triangles.size),
        ("PAGES_A_ROW", manifest.triangles.pages_a_row),
        ("TRIANGLES", manifest.stretch.triangles),
        ("SLOPE_UNIT", slope_unit(manifest)),
    ]
    said = "\n".join(_constant(language, name, value) for name, value in numbers)
    load = runtime_text(language, "load.txt")
    return f"{said}\n\n{load}\n{language.translated(runtime('slopes.glsl'))}\n"


def slope_unit(manifest: Manifest) -> float:
    """What 1 of the texture of slopes is, mesh units over the side of a map: so half floats have
    them well, of every resolution."""
    return 128.0 * manifest.scale


def entry(language: Language, name: str) -> str:
    """The entry point of a pass."""
    made = language.translated(runtime(f"{name}.pass.glsl"))
    return f"{made}\n{runtime_text(language, 'pass.frag')}"


def flags(manifest: Manifest) -> dict[str, bool]:
    """The names that `#if` tests in the source, and whether each holds."""
    blend = manifest.blend
    return {
        **{f"MERGE_{name.upper()}": blend.merge == name for name in MERGES},
        "SOFT_LIMITS": blend.soft_limits,
        "TILT": blend.tilt is not None,
        "GRAIN": blend.grain is not None,
        "EVENTS": _has_events(manifest),
        "CUSHION": manifest.cushion is not None,
        "RESIDUAL": manifest.residual is not None,
    }


def _has_events(manifest: Manifest) -> bool:
    return any(layer.name == EVENT_LAYER for layer in manifest.layers)


def constants(manifest: Manifest, language: Language) -> str:
    """The constants that specialise the source, in a language."""
    lines = [_constant(language, name, value) for name, value in _numbers(manifest)]
    lines.append(language.directions("RHYTID_DIRECTIONS", _directions(manifest.blend)))
    return "\n".join(["// The numbers of manifest.json.", *lines, ""])


def _constant(language: Language, name: str, value: Number) -> str:
    named = f"RHYTID_{name}"
    if isinstance(value, int):
        return language.number("int", named, str(value))
    if isinstance(value, float):
        return language.number("float", named, _literal(value))
    return language.numbers(named, [_literal(one) for one in value])


def _numbers(manifest: Manifest) -> list[tuple[str, Number]]:
    blend, layers = manifest.blend, {layer.name: layer for layer in manifest.layers}
    wrinkles, pores = layers["wrinkles"], layers["pores"]
    return [
        *_samples(wrinkles, pores),
        ("SCALE_LIMIT", blend.scale_limit),
        ("LOG_STRETCH_LIMIT", blend.log_stretch_limit),
        ("LAST_SAMPLE", blend.last_sample),
        ("DEPTH", blend.depth),
        ("UNIT", merge_unit(blend)),
        ("MAPS", manifest.textures.maps),
        ("FIRST_PORES", pores.first),
        ("SETS_A_ROW", manifest.wrinkles.codes.width),
        ("PAGE", manifest.textures.size),
        ("PAGES_A_ROW", manifest.textures.pages_a_row),
        ("TRIANGLES_A_ROW", manifest.weights.width),
        ("ROWS", manifest.weights.rows),
        *_optional(manifest, layers),
    ]


def _samples(wrinkles: Layer, pores: Layer) -> list[tuple[str, Number]]:
    """How many there are, what their codes stand for, and how deep they become."""
    return [
        ("BINS", wrinkles.bins),
        ("SAMPLES", len(wrinkles.samples)),
        ("PORE_SAMPLES", len(pores.samples)),
        ("STEPS", wrinkles.steps),
        ("PORE_STEPS", pores.steps),
        ("EXPONENT", wrinkles.depth_exponent),
        ("PORE_EXPONENT", pores.depth_exponent),
        ("PORE_DEPTH_LIMIT", pores.depth_limit),
    ]


def merge_unit(blend: Blend) -> float:
    """The unit in which heights are merged, mesh units (docs/binned.md)."""
    twice = math.log(2.0) * blend.depth / blend.sharpness
    return {"min": 1.0, "soft": 4.0 * twice, "signed": twice}[blend.merge]


def _optional(manifest: Manifest, layers: dict[str, Layer]) -> list[tuple[str, Number]]:
    """The constants of layers that not every package has."""
    blend, cushion = manifest.blend, manifest.cushion
    lines: list[tuple[str, Number]] = []
    if blend.tilt is not None:
        tilts = layers["wrinkle_tilts"]
        lines += [
            ("TILT_NODE", blend.tilt.node),
            ("TILT_STEP", tilts.steps[0]),
            ("FIRST_TILT", tilts.first),
        ]
    if blend.grain is not None:
        grain = layers["grain"]
        lines += [
            ("GRAIN_EXPONENT", blend.grain.exponent),
            ("GRAIN_STEP", grain.steps[0]),
            ("FIRST_GRAIN", grain.first),
        ]
    if _has_events(manifest):
        events = layers[EVENT_LAYER]
        lines += [
            ("EVENT_EXPONENT", events.depth_exponent),
            ("EVENT_STEP", events.steps[0]),
            ("EVENT_FINE_STEP", events.steps[1]),
            ("FIRST_EVENTS", events.first),
        ]
    if cushion is not None:
        lines += [
            ("CUSHION_SAMPLES", len(cushion.layer.samples)),
            ("CUSHION_STEPS", cushion.layer.steps),
            ("CUSHION_LAST_SAMPLE", cushion.layer.samples[-1]),
            ("CUSHION_EXPONENT", cushion.layer.depth_exponent),
            ("LINES_A_ROW", cushion.lines.width),
            ("ENDS", cushion.lines.ends),
            ("CUSHION_FACTOR", cushion.factor),
            ("CUSHION_APRON", cushion.apron),
        ]
    if manifest.residual is not None:
        scanned = manifest.residual
        lines += [("RESIDUAL_STEP", scanned.step), ("RESIDUAL_FIRST", scanned.first)]
    return lines


def _directions(blend: Blend) -> list[tuple[str, str]]:
    """The direction of the middle of every bin, and those where the line through its depth scales
    is taken.

    They are written as numbers, since a GPU may round sines coarsely.
    """
    node = 0.0 if blend.tilt is None else blend.tilt.node
    turn = node * math.pi / (2 * len(blend.angles))
    angles = [angle + side * turn for angle in blend.angles for side in (0, -1, 1)]
    return [(_literal(math.sin(a)), _literal(math.cos(a))) for a in angles]


def _literal(value: float) -> str:
    return f"{value:.9e}"


def materialx_files() -> MaterialX:
    """The file names of the MaterialX document and of its implementations."""
    named = {target: f"shaders/materialx/height.{target}.glsl" for target in TARGETS}
    return MaterialX(document=DOCUMENT, implementations=named)


def materialx_texts(manifest: Manifest) -> dict[str, bytes]:
    """The MaterialX document and the functions that it names, by file name."""
    found = {DOCUMENT: _document(manifest)}
    for target, file in manifest.materialx.implementations.items():
        language = LANGUAGES[TARGETS[target]]
        head = _PRECISION if target == "essl" else ""
        side = language.number("int", "RHYTID_RESOLUTION", str(manifest.resolution))
        text = f"{head}{library(manifest, language, 'skin')}{side}\n{_ENTRY}"
        found[file] = text.encode()
    return found


def _document(manifest: Manifest) -> bytes:
    root = Element("materialx", version=_VERSION)
    _definition(root)
    for target, file in manifest.materialx.implementations.items():
        SubElement(
            root, "implementation", name=f"IM_{NODE}_float_{target}", nodedef=DEFINITION,
            file=file, function=_FUNCTION, target=target,
        )  # fmt: skip
    graph = SubElement(root, "nodegraph", name=f"NG_{NODE}_float", nodedef=DEFINITION)
    image = SubElement(graph, "image", name="map", type="float")
    SubElement(image, "input", name="file", type="filename", interfacename="file")
    SubElement(image, "input", name="texcoord", type="vector2", interfacename="texcoord")
    for mode in ("uaddressmode", "vaddressmode"):
        SubElement(image, "input", name=mode, type="string", value="clamp")
    SubElement(graph, "output", name="out", type="float", nodename="map")
    _material(root)
    indent(root)
    return b'<?xml version="1.0"?>\n' + tostring(root) + b"\n"


def _definition(root: Element) -> None:
    said = "displacement of skin along the normal, mesh units"
    made = SubElement(root, "nodedef", name=DEFINITION, node=NODE, nodegroup="texture2d", doc=said)
    file = SubElement(made, "input", name="file", type="filename", uniform="true")
    file.set("value", "height.<UDIM>.exr")
    SubElement(made, "input", name="texcoord", type="vector2", defaultgeomprop="UV0")
    SubElement(made, "output", name="out", type="float", default="0.0")


def _material(root: Element) -> None:
    SubElement(root, NODE, name="skin_height", type="float")
    displacement = SubElement(root, "displacement", name="skin_relief", type="displacementshader")
    SubElement(displacement, "input", name="displacement", type="float", nodename="skin_height")
    SubElement(displacement, "input", name="scale", type="float", value="1.0")
    skin = SubElement(root, "surfacematerial", name="skin", type="material")
    SubElement(
        skin, "input", name="displacementshader", type="displacementshader", nodename="skin_relief"
    )
