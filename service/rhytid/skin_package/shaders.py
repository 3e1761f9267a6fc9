"""The shader of a package: one template, with the numbers of a manifest put in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.resources import files

from rhytid.skin_package.manifest import Blend, Layer, Manifest

# How a text begins, by the name of its language.
DIALECTS = {
    "glsl-es-300": "#version 300 es\nprecision highp float;\nprecision highp int;\n"
    "precision highp sampler2D;\nprecision highp sampler2DArray;\n"
    "precision highp usampler2DArray;\n",
    "glsl-410": "#version 410\n",
}
MERGES = ("min", "soft", "signed")


def runtime(name: str) -> str:
    """The text of a file of `runtime`."""
    return (files("rhytid.skin_package") / "runtime" / name).read_text(encoding="utf-8")


def shader_texts(manifest: Manifest) -> dict[str, str]:
    """The texts of all languages, by file name.

    Libraries are functions alone, for the shaders of an engine; the passes are whole."""
    numbers = constants(manifest)
    libraries = {name: f"{numbers}\n{runtime(f'{name}.glsl')}" for name in ("weights", "skin")}
    found: dict[str, str] = {}
    for dialect, head in DIALECTS.items():
        shaders = manifest.shaders[dialect]
        found |= {file: libraries[name] for name, file in shaders.libraries.items()}
        found[shaders.vertex] = f"{head}\n{runtime('full.vert')}"
        for name, file in shaders.passes.items():
            library = libraries["weights" if name == "weights" else "skin"]
            found[file] = f"{head}\n{library}\n{runtime(f'{name}.frag')}"
    return found


def constants(manifest: Manifest) -> str:
    """What the template is specialised by."""
    blend, layers = manifest.blend, {layer.name: layer for layer in manifest.layers}
    wrinkles, pores = layers["wrinkles"], layers["pores"]
    lines = [
        *(_flag(f"MERGE_{name.upper()}", blend.merge == name) for name in MERGES),
        _flag("SOFT_LIMITS", blend.soft_limits),
        _flag("TILT", blend.tilt is not None),
        _flag("GRAIN", blend.grain is not None),
        _flag("CUSHION", manifest.cushion is not None),
        _directions(blend),
        *_samples(wrinkles, pores),
        _float("SCALE_LIMIT", blend.scale_limit),
        _float("LOG_STRETCH_LIMIT", blend.log_stretch_limit),
        _float("LAST_SAMPLE", blend.last_sample),
        _float("DEPTH", blend.depth),
        _float("UNIT", merge_unit(blend)),
        _int("MAPS", manifest.textures.maps),
        _int("FIRST_PORES", pores.first),
        _int("SETS_A_ROW", manifest.wrinkles.codes.width),
        _int("PAGE", manifest.textures.size),
        _int("PAGES_A_ROW", manifest.textures.pages_a_row),
        _int("TRIANGLES_A_ROW", manifest.weights.width),
        _int("ROWS", manifest.weights.rows),
        *_optional(manifest, layers),
    ]
    return "\n".join(["// The numbers of manifest.json.", *lines, ""])


def _samples(wrinkles: Layer, pores: Layer) -> list[str]:
    """How many there are, what their codes stand for, and how deep they become."""
    return [
        _int("BINS", wrinkles.bins),
        _int("SAMPLES", len(wrinkles.samples)),
        _int("PORE_SAMPLES", len(pores.samples)),
        _floats("STEPS", wrinkles.steps),
        _floats("PORE_STEPS", pores.steps),
        _float("EXPONENT", wrinkles.depth_exponent),
        _float("PORE_EXPONENT", pores.depth_exponent),
        _float("PORE_DEPTH_LIMIT", pores.depth_limit),
    ]


def merge_unit(blend: Blend) -> float:
    """The unit in which heights are merged, mesh units (docs/binned.md)."""
    twice = math.log(2.0) * blend.depth / blend.sharpness
    return {"min": 1.0, "soft": 4.0 * twice, "signed": twice}[blend.merge]


def _optional(manifest: Manifest, layers: dict[str, Layer]) -> list[str]:
    """Of the layers that not every package has."""
    lines, blend, cushion = [], manifest.blend, manifest.cushion
    if blend.tilt is not None:
        tilts = layers["wrinkle_tilts"]
        lines += [
            _float("TILT_NODE", blend.tilt.node),
            _float("TILT_STEP", tilts.steps[0]),
            _int("FIRST_TILT", tilts.first),
        ]
    if blend.grain is not None:
        grain = layers["grain"]
        lines += [
            _float("GRAIN_EXPONENT", blend.grain.exponent),
            _float("GRAIN_STEP", grain.steps[0]),
            _int("FIRST_GRAIN", grain.first),
        ]
    if cushion is not None:
        unit = math.log(2.0) * blend.depth / cushion.sharpness
        # Its codes are as many times larger at every sample.
        gain = cushion.layer.steps[0] / layers["wrinkles"].steps[0] * merge_unit(blend) / unit
        lines += [
            _float("CUSHION_GAIN", gain),
            _float("CUSHION_UNIT", unit),
            _int("CUSHION_FACTOR", cushion.factor),
            _int("CUSHION_APRON", cushion.apron),
        ]
    return lines


def _directions(blend: Blend) -> str:
    """Of every bin its middle, and where the line through its depth scales is taken. As numbers: a
    GPU may round sines coarsely."""
    node = 0.0 if blend.tilt is None else blend.tilt.node
    turn = node * math.pi / (2 * len(blend.angles))
    angles = [angle + side * turn for angle in blend.angles for side in (0, -1, 1)]
    listed = ", ".join(f"vec2({_literal(math.sin(a))}, {_literal(math.cos(a))})" for a in angles)
    count = len(angles)
    return f"const vec2 RHYTID_DIRECTIONS[{count}] = vec2[{count}]({listed});"


def _flag(name: str, value: bool) -> str:
    return f"#define RHYTID_{name} {int(value)}"


def _int(name: str, value: int) -> str:
    return f"const int RHYTID_{name} = {value};"


def _float(name: str, value: float) -> str:
    return f"const float RHYTID_{name} = {_literal(value)};"


def _floats(name: str, values: Sequence[float]) -> str:
    count = len(values)
    listed = ", ".join(map(_literal, values))
    return f"const float RHYTID_{name}[{count}] = float[{count}]({listed});"


def _literal(value: float) -> str:
    return f"{value:.9e}"
