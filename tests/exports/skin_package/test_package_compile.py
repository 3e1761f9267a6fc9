"""The compiler of Khronos takes every shader of a package in GLSL and HLSL. WGSL is compiled in
tests/viewer. Run by `pytest -m glslang`."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from exports.skin_package.conftest import Written
from exports.skin_package.variants import whole_shaders
from rhytid.exports.skin_package.languages import LANGUAGES
from rhytid.exports.skin_package.manifest import Manifest

pytestmark = pytest.mark.glslang
MATERIAL = """
uniform sampler2D slopes;
uniform sampler2D products;
in vec3 position;
in vec3 normal;
in vec2 uv;
out vec4 out_;
void main()
{
%s
    out_ = vec4(s.roughness, s.axis + s.slope);
}
"""
HLSL_MATERIAL = """
float4 main(float4 read : READ) : SV_Target
{
    RhytidShine s = rhytid_shine(read, read, read.xy, read.zw, 0.35);
    return float4(s.roughness, s.axis + s.slope);
}
"""
PAGE = Path(__file__).parents[3] / "docs" / "package.md"
AS_HLSL = ("-D", "-V", "--auto-map-bindings", "-e", "main")


@pytest.mark.parametrize("language", ["glsl-es-300", "glsl-410", "glsl-430", "hlsl"])
def test_every_shader_compiles(language: str, written: Written, tmp_path: Path) -> None:
    manifest = Manifest.model_validate_json((written.folder / "manifest.json").read_bytes())
    of = {}  # by text: variants share some
    for name, stage, text in whole_shaders(manifest, language):
        of[stage, text] = name
    options = AS_HLSL if language == "hlsl" else ()
    said = {name: compiled(text, stage, options, tmp_path) for (stage, text), name in of.items()}

    assert {name: text for name, text in said.items() if text} == {}
    stages = {stage for stage, _ in of}
    assert stages == {"comp"} if language == "glsl-430" else stages >= {"vert", "frag"}


@pytest.mark.parametrize("language", ["glsl-es-300", "glsl-410", "hlsl"])
def test_materials_may_call_the_function_of_shine(
    language: str, written: Written, tmp_path: Path
) -> None:
    manifest = Manifest.model_validate_json((written.folder / "manifest.json").read_bytes())
    library = (written.folder / manifest.shaders[language].libraries["shine"]).read_text()
    beside = (written.folder / manifest.shaders[language].libraries["skin"]).read_text()
    hlsl = language == "hlsl"
    (documented,) = re.findall(r"```glsl\n(.*?)```", PAGE.read_text(), re.DOTALL)
    material = HLSL_MATERIAL if hlsl else MATERIAL % documented
    text = f"{LANGUAGES[language].head}{beside}{library}{material}"

    assert compiled(text, "frag", AS_HLSL if hlsl else (), tmp_path) == ""


def compiled(text: str, stage: str, options: tuple[str, ...], folder: Path) -> str:
    """What the compiler has to say, where it does not take a text."""
    file = folder / f"shader.{stage}"
    file.write_text(text)
    out = ("-o", str(folder / "shader.spv")) if options else ()
    command = ["glslangValidator", *options, "-S", stage, str(file), *out]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr if done.returncode else ""
