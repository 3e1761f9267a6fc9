"""The shader's source and its other languages, without anything that runs them."""

from __future__ import annotations

import json
import re

import pytest

from exports.skin_package.conftest import Written
from rhytid.exports.skin_package.languages import BINDINGS, LANGUAGES, RESIDUAL, preprocessed
from rhytid.exports.skin_package.runtime import runtime

SOURCE = """
#if A
a
#elif B
b
#else
c
#if A
d
#endif
e
#endif
f
"""


@pytest.mark.parametrize(
    ("a", "b", "left"), [(True, True, "a f"), (False, True, "b f"), (False, False, "c e f")]
)
def test_branches_are_chosen(a: bool, b: bool, left: str) -> None:
    assert preprocessed(SOURCE, {"A": a, "B": b}).split() == left.split()


@pytest.mark.parametrize(
    ("line", "hlsl", "wgsl"),
    [
        (
            "vec4 f(sampler2D from_, ivec2 at)",
            "float4 f(Texture2D<float4> from_, int2 at)",
            "fn f(from_: texture_2d<f32>, at: vec2<i32>) -> vec4<f32>",
        ),
        (
            "    const float most = fract(x);",
            "    const float most = frac(x);",
            "    var most: f32 = fract(x);",
        ),
        ("    RhytidStretch s;", "    RhytidStretch s;", "    var s: RhytidStretch;"),
        (
            "    for (int n = 0; n < 3; n++) {",
            "    for (int n = 0; n < 3; n++) {",
            "    for (var n: i32 = 0; n < 3; n++) {",
        ),
        (
            "const vec3 NONE = vec3(1.0, 0.0, 0.0); // vec3",
            "static const float3 NONE = float3(1.0, 0.0, 0.0); // vec3",
            "const NONE: vec3<f32> = vec3<f32>(1.0, 0.0, 0.0); // vec3",
        ),
        (
            "uniform usampler2DArray rhytid_triangles; // each",
            "Texture2DArray<uint4> rhytid_triangles; // each",
            "@group(0) @binding(5) var rhytid_triangles: texture_2d_array<u32>; // each",
        ),
        ("    x += float(n);", "    x += float(n);", "    x += f32(n);"),
    ],
)
def test_a_line_becomes(line: str, hlsl: str, wgsl: str) -> None:
    assert LANGUAGES["hlsl"].translated(line) == f"{hlsl}\n"
    assert LANGUAGES["wgsl"].translated(line) == f"{wgsl}\n"
    assert LANGUAGES["glsl-410"].translated(line) == line


def test_members_of_a_struct_become_those_of_wgsl() -> None:
    found = LANGUAGES["wgsl"].translated("struct A {\n    vec2 x; // said\n};\n    vec2 y;")
    assert found == "struct A {\n    x: vec2<f32>, // said\n};\n    var y: vec2<f32>;\n"


@pytest.mark.parametrize("name", ["weights", "skin", "stretch", "slopes", "shine"])
def test_the_source_keeps_to_the_common_subset(name: str) -> None:
    for line in runtime(f"{name}.glsl").splitlines():
        code = line.partition("//")[0].rstrip()
        assert "?" not in code, line
        assert not re.match(r"\s+(float|int|vec\d|ivec2) \w+(, | = [^(]*, \w+ =)", code), line
        assert not re.match(r"\s*(if|for) \(", code) or code.endswith("{"), line


def test_no_words_of_another_language_are_left(written: Written) -> None:
    manifest = json.loads((written.folder / "manifest.json").read_text())
    left = {
        "hlsl": r"\b(i?vec[234]|texelFetch|uniform|gl_\w+|u?sampler2D\w*|mix|fract)\b",
        "wgsl": r"\b(ivec2|float|int|uint|texelFetch|uniform|gl_\w+|u?sampler2D\w*|static)\b",
    }
    for language, words in left.items():
        shaders = manifest["shaders"][language]
        files = [*shaders["libraries"].values(), shaders["vertex"], *shaders["passes"].values()]
        files += shaders["moments"].values()
        for file in (*files, manifest["stretch"]["compute"][language]):
            text = re.sub(r"//.*", "", (written.folder / file).read_text())
            found = {one[0] for one in re.finditer(words, text)}
            assert found - ({"float", "int", "uint"} if language == "hlsl" else set()) == set(), (
                file
            )


def test_every_texture_has_a_binding(written: Written) -> None:
    manifest = json.loads((written.folder / "manifest.json").read_text())
    bindings = manifest["shaders"]["wgsl"]["bindings"]
    assert list(bindings) == [name for name in BINDINGS if name != RESIDUAL]
    declared = set()
    shaders = manifest["shaders"]["wgsl"]
    for file in (*shaders["passes"].values(), *shaders["moments"].values()):
        text = (written.folder / file).read_text()
        for number, name in re.findall(r"@binding\((\d+)\) var (\w+)", text):
            assert bindings[name] == int(number)
            declared.add(name)
    assert declared == set(bindings)
