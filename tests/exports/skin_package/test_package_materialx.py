"""The node of MaterialX of a package: the document, what generators make of it, and that drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import MaterialX as mx
import MaterialX.PyMaterialXGenGlsl as genglsl
import MaterialX.PyMaterialXGenOsl as genosl
import MaterialX.PyMaterialXGenShader as gen
import numpy as np
import pytest

from exports.skin_package.conftest import Written
from exports.skin_package.test_package_compile import compiled
from meshes import deform
from rhytid.exports.skin_package.runtime import stretch

GENERATORS = {
    "genglsl": genglsl.GlslShaderGenerator,
    "essl": genglsl.EsslShaderGenerator,
    "genosl": genosl.OslShaderGenerator,
}


@pytest.fixture(scope="module")
def document(written: Written) -> mx.Document:
    found = mx.createDocument()
    mx.readFromXmlFile(found, str(written.folder / "skin.mtlx"))
    library = mx.createDocument()
    path = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), path, library)
    found.setDataLibrary(library)
    return found


def generated(document: mx.Document, package: Path, target: str) -> Any:
    """The shader of the node alone."""
    generator = GENERATORS[target].create()
    context = gen.GenContext(generator)
    path = mx.getDefaultDataSearchPath()
    path.append(mx.FileSearchPath(str(package)))
    context.registerSourceCodeSearchPath(path)
    return generator.generate("skin", document.getChild("skin_height"), context)


def test_the_document_is_valid(document: mx.Document) -> None:
    assert document.validate() == (True, "")
    material = document.getChild("skin")
    (shader,) = mx.getShaderNodes(material, mx.DISPLACEMENT_SHADER_TYPE_STRING)
    assert shader.getConnectedNode("displacement").getNodeDef().getName().startswith("ND_rhytid")


@pytest.mark.parametrize("target", GENERATORS)
def test_generators_take_what_there_is_of_their_language(
    document: mx.Document, written: Written, target: str
) -> None:
    text = generated(document, written.folder, target).getSourceCode("pixel")
    assert ("rhytid_height_at(file, " in text) == (target != "genosl")
    assert ("NG_rhytid_height_float(file_, " in text) == (target == "genosl")


@pytest.mark.glslang
@pytest.mark.parametrize("target", ["genglsl", "essl"])
def test_what_they_generate_compiles(
    document: mx.Document, written: Written, target: str, tmp_path: Path
) -> None:
    shader = generated(document, written.folder, target)
    for stage, kind in (("vertex", "vert"), ("pixel", "frag")):
        assert compiled(shader.getSourceCode(stage), kind, (), tmp_path) == ""


@pytest.mark.peers
@pytest.mark.parametrize("target", ["genglsl", "essl"])
def test_what_they_generate_draws_the_heights(
    document: mx.Document, written: Written, target: str
) -> None:
    from exports.skin_package.rendering import Renderer  # the plain run has no moderngl

    moved = deform(written.mesh.positions, 5, 0.1)
    rest = stretch.read_rest(written.folder / "triangles.bin")
    found = stretch.log_stretch(moved, written.mesh.faces, rest)
    renderer = Renderer(written.folder, 1001, "glsl-410")
    frame = stretch.texture(found, renderer.manifest["stretch"]["triangles_a_row"])
    shader = generated(document, written.folder, target)
    try:
        wanted = renderer.heights(frame)
        renderer.take("node", *(shader.getSourceCode(stage) for stage in ("vertex", "pixel")))
        got = renderer.heights(frame, "node")
    finally:
        renderer.release()
    assert np.abs(wanted).max() > 0
    assert np.abs(got - wanted).max() <= 1e-6 * np.abs(wanted).max()
