"""The shader in other languages, from its one source.

The source (`runtime/*.glsl`) keeps to a common subset, so that words and the forms of a few lines
are all that has to be replaced: one declaration a line, a head of a function on one line, braces
around every statement of `if` and `for`, no `?:`, parameters that stay as they are, vectors built
of all their components, textures read by the functions of `load.txt` alone, `#if` on names of
flags.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rhytid.exports.skin_package.runtime import runtime

Vector = tuple[float, float]
_HLSL = {
    "vec2": "float2",
    "vec3": "float3",
    "vec4": "float4",
    "ivec2": "int2",
    "fract": "frac",
    "usampler2DArray": "Texture2DArray<uint4>",
    "sampler2DArray": "Texture2DArray<float4>",
    "sampler2D": "Texture2D<float4>",
}
_WGSL = {
    "vec2": "vec2<f32>",
    "vec3": "vec3<f32>",
    "vec4": "vec4<f32>",
    "ivec2": "vec2<i32>",
    "float": "f32",
    "int": "i32",
    "bool": "bool",
    "usampler2DArray": "texture_2d_array<u32>",
    "sampler2DArray": "texture_2d_array<f32>",
    "sampler2D": "texture_2d<f32>",
}
_TYPE = rf"({'|'.join(_WGSL)}|RhytidStretch|RhytidTriangle|RhytidShine)"
_FUNCTION = re.compile(rf"{_TYPE} (\w+)\((.*)\)")
_UNIFORM = re.compile(rf"uniform {_TYPE} (\w+);(.*)")
_GLOBAL = re.compile(rf"const {_TYPE} (\w+) = (.*)")
_MADE = re.compile(rf"(\s+)(?:const )?{_TYPE} (\w+) = (.*)")
_LOCAL = re.compile(rf"(\s+){_TYPE} (\w+);(.*)")
_LOOP = re.compile(rf"(\s+)for \({_TYPE} (\w+) = (.*)")


@dataclass(frozen=True)
class Language:
    """A language that the shader is translated to.

    folder: of `runtime`, with the texts that differ by language.  head: how a whole text begins.
    ending: of the files of its libraries.  suffix: after the names of passes.  translated:
    translates a text of the source.  number, numbers, directions: write a constant, an array of
    constants, and an array of vectors, by name.
    """

    folder: str
    head: str
    ending: str
    suffix: str
    translated: Callable[[str], str]
    number: Callable[[str, str, str], str]
    numbers: Callable[[str, Sequence[str]], str]
    directions: Callable[[str, Sequence[tuple[str, str]]], str]


def preprocessed(text: str, flags: Mapping[str, bool]) -> str:
    """A text without its `#if`: of each, the lines of the first branch that holds are kept."""
    kept: list[str] = []
    # For every #if around a line: whether its present branch holds, and whether any did.
    around: list[tuple[bool, bool]] = []
    for line in text.splitlines():
        word, _, name = line.partition(" ")
        if word == "#if":
            around.append((flags[name], flags[name]))
        elif word == "#elif":
            _, any_ = around.pop()
            around.append((flags[name] and not any_, any_ or flags[name]))
        elif word == "#else":
            _, any_ = around.pop()
            around.append((not any_, True))
        elif word == "#endif":
            around.pop()
        elif all(holds for holds, _ in around):
            kept.append(line)
    return "\n".join(kept) + "\n"


def _replaced(text: str, words: Mapping[str, str]) -> str:
    return re.sub(rf"\b({'|'.join(words)})\b", lambda found: words[found[0]], text)


def _by_line(line: Callable[[str], str]) -> Callable[[str], str]:
    """Comments are left as they are."""

    def translated(text: str) -> str:
        parts = (one.partition("//") for one in text.splitlines())
        return "\n".join(line(code) + mark + said for code, mark, said in parts) + "\n"

    return translated


def _hlsl_line(line: str) -> str:
    line = line.replace("uniform ", "")
    if line.startswith("const "):
        line = f"static {line}"
    return _replaced(line, _HLSL)


def _wgsl(text: str) -> str:
    return "\n".join(_wgsl_lines(text)) + "\n"


def _wgsl_lines(text: str) -> Iterator[str]:
    inside = False  # of a struct
    for whole in text.splitlines():
        line, mark, said = whole.partition("//")
        inside = line.startswith("struct ") or (inside and not line.startswith("}"))
        if inside and (found := _LOCAL.fullmatch(line)):
            space, kind, name, rest = found.groups()
            yield f"{space}{name}: {_wgsl_type(kind)},{rest}{mark}{said}"
        else:
            yield _wgsl_line(line) + mark + said


def _wgsl_line(line: str) -> str:
    if found := _FUNCTION.fullmatch(line):
        kind, name, listed = found.groups()
        pairs = (one.split(" ") for one in listed.split(", "))
        taken = ", ".join(f"{one}: {_wgsl_type(of)}" for of, one in pairs)
        return f"fn {name}({taken}) -> {_wgsl_type(kind)}"
    if found := _GLOBAL.fullmatch(line):
        kind, name, rest = found.groups()
        return f"const {name}: {_wgsl_type(kind)} = {_replaced(rest, _WGSL)}"
    if found := _LOOP.fullmatch(line):
        space, kind, name, rest = found.groups()
        return f"{space}for (var {name}: {_wgsl_type(kind)} = {rest}"
    if found := _MADE.fullmatch(line):
        space, kind, name, rest = found.groups()
        return f"{space}var {name}: {_wgsl_type(kind)} = {_replaced(rest, _WGSL)}"
    if found := _LOCAL.fullmatch(line):
        space, kind, name, rest = found.groups()
        return f"{space}var {name}: {_wgsl_type(kind)};{rest}"
    if found := _UNIFORM.fullmatch(line):
        kind, name, rest = found.groups()
        return f"@group(0) @binding({BINDINGS.index(name)}) var {name}: {_wgsl_type(kind)};{rest}"
    return _replaced(line, _WGSL)


def _wgsl_type(kind: str) -> str:
    return _WGSL.get(kind, kind)


RESIDUAL = "rhytid_residual"
# Where WGSL has its textures: the numbers of their bindings.
BINDINGS = (
    "rhytid_stretch",
    "rhytid_weights",
    "rhytid_wrinkles",
    "rhytid_wrinkle_codes",
    "rhytid_maps",
    "rhytid_triangles",
    "rhytid_cushions",
    "rhytid_cushion_owners",
    "rhytid_cushion_lines",
    "rhytid_cushion_stretch",
    "rhytid_cushion",
    RESIDUAL,
    "rhytid_heights",
)


def _glsl(head: str) -> Language:
    return Language(
        folder="glsl",
        head=head,
        ending="glsl",
        suffix="",
        translated=lambda text: text,
        number=lambda kind, name, value: f"const {kind} {name} = {value};",
        numbers=lambda name, values: (
            f"const float {name}[{len(values)}] = float[{len(values)}]({', '.join(values)});"
        ),
        directions=lambda name, pairs: (
            f"const vec2 {name}[{len(pairs)}] = vec2[{len(pairs)}]({_vectors(pairs, 'vec2')});"
        ),
    )


def _vectors(pairs: Sequence[tuple[str, str]], kind: str) -> str:
    return ", ".join(f"{kind}({x}, {y})" for x, y in pairs)


_ES = (
    "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n"
    "precision highp sampler2DArray;\nprecision highp usampler2DArray;\n"
)
# The languages by their names in the manifest.
LANGUAGES = {
    "glsl-es-300": _glsl(_ES),
    "glsl-410": _glsl("#version 410\n"),
    "hlsl": Language(
        folder="hlsl",
        head="",
        ending="hlsl",
        suffix=".hlsl",
        translated=_by_line(_hlsl_line),
        number=lambda kind, name, value: f"static const {kind} {name} = {value};",
        numbers=lambda name, values: (
            f"static const float {name}[{len(values)}] = {{ {', '.join(values)} }};"
        ),
        directions=lambda name, pairs: (
            f"static const float2 {name}[{len(pairs)}] = {{ {_vectors(pairs, 'float2')} }};"
        ),
    ),
    "wgsl": Language(
        folder="wgsl",
        head="",
        ending="wgsl",
        suffix=".wgsl",
        translated=_wgsl,
        number=lambda kind, name, value: f"const {name}: {_wgsl_type(kind)} = {value};",
        numbers=lambda name, values: (
            f"var<private> {name}: array<f32, {len(values)}> = "
            f"array<f32, {len(values)}>({', '.join(values)});"
        ),
        directions=lambda name, pairs: (
            f"var<private> {name}: array<vec2<f32>, {len(pairs)}> = "
            f"array<vec2<f32>, {len(pairs)}>({_vectors(pairs, 'vec2<f32>')});"
        ),
    ),
}


def runtime_text(language: Language, name: str) -> str:
    """The text of a file that `runtime` has for a language."""
    return runtime(f"{language.folder}/{name}")
