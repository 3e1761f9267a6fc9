"""Looks as USD and as MaterialX, read back and checked by usd-core and by MaterialX."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import MaterialX as mx
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdValidation

from rhytid.errors import InputError
from rhytid.exports.look import Look, materialx_look
from rhytid.exports.look_shine import SHINE
from rhytid.exports.usda import usd_look

LOOK = Look("face", (1001,), ("0007", "0008", "0010"), "cm", "cm", bind="/root/face/mesh")
TILES = replace(LOOK, udims=(1001, 1002, 1011))
OTHERS = [
    LOOK,
    TILES,
    replace(LOOK, frames=("smile",), scene_unit="m"),
    replace(LOOK, name="7-up", fps=29.97, uv="UVMap"),
    replace(LOOK, udims=(1002,), bind=None),
    replace(LOOK, shine=True),
    replace(LOOK, material="/root/skin"),
    replace(LOOK, material="/root/face/mesh/skin"),
    replace(LOOK, bind="/Looks/mesh"),
]
MATERIALS = ("/root/skin", "/root/face/mesh/skin")
SCENE = """#usda 1.0
(
    defaultPrim = "root"
    metersPerUnit = 0.01
    upAxis = "Z"
    timeCodesPerSecond = FPS
    subLayers = [@./face.look.usda@, @./mesh.usda@]
)
"""


@pytest.fixture(scope="module")
def library() -> mx.Document:
    """MaterialX' own definitions of nodes."""
    found = mx.createDocument()
    path = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), path, found)
    return found


def write_mesh(folder: Path) -> None:
    stage = Usd.Stage.CreateNew(str(folder / "mesh.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/root").GetPrim())
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    mesh = UsdGeom.Mesh.Define(stage, "/root/face/mesh")
    mesh.CreatePointsAttr([Gf.Vec3f(0), Gf.Vec3f(1, 0, 0), Gf.Vec3f(0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    mesh.CreateExtentAttr([Gf.Vec3f(0), Gf.Vec3f(1, 1, 0)])
    for path in MATERIALS:
        skin = UsdShade.Material.Define(stage, path)
        shader = UsdShade.Shader.Define(stage, f"{path}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        surface = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        skin.CreateSurfaceOutput().ConnectToSource(surface)
    stage.GetRootLayer().Save()


def scene(folder: Path, look: Look, fps: float = 24.0) -> Usd.Stage:
    """A scene with a mesh and a look, and files that its maps resolve to."""
    write_mesh(folder)
    (folder / "face.look.usda").write_text(usd_look(look))
    (folder / "shot.usda").write_text(SCENE.replace("FPS", f"{fps:g}"))
    for udim in look.udims:
        for frame in look.frames:
            (folder / f"{look.name}.{udim}.{frame}.exr").touch()
            for map in ("roughness", "anisotropy"):
                (folder / f"{look.name}.{map}.{udim}.{frame}.png").touch()
    return Usd.Stage.Open(str(folder / "shot.usda"))


def shader(stage: Usd.Stage, kind: str) -> UsdShade.Shader:
    (found,) = [
        UsdShade.Shader(prim)
        for prim in stage.Traverse()
        if prim.IsA(UsdShade.Shader) and UsdShade.Shader(prim).GetShaderId() == kind
    ]
    return found


def file_at(stage: Usd.Stage, kind: str, frame: float) -> str:
    return Path(shader(stage, kind).GetInput("file").Get(frame).path).name


@pytest.mark.parametrize("look", OTHERS, ids=lambda look: f"{look.name}-{look.udims}")
def test_usd_finds_nothing_wrong(tmp_path: Path, library: mx.Document, look: Look) -> None:
    """But ids of MaterialX, which the wheel of usd-core is built without and MaterialX knows."""
    stage = scene(tmp_path, look)
    assert stage.GetCompositionErrors() == []
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    alone = Usd.Stage.Open(str(tmp_path / "face.look.usda"))
    wrong = [*context.Validate(stage)]
    if look.material is None:  # a layer of overs alone has no default prim
        wrong += context.Validate(alone)
    others = []
    for error in wrong:
        unknown = re.search(r"shaderId '(ND_\w+)'", error.GetMessage())
        if not (unknown and library.getNodeDef(unknown[1])):
            others.append((error.GetName(), error.GetMessage()))
    assert others == []


def test_the_checker_would_see_a_wrong_type(tmp_path: Path) -> None:
    file = tmp_path / "face.look.usda"
    file.write_text(usd_look(LOOK).replace("float4 inputs:scale", "token inputs:scale", 1))
    wrong = re.sub(r"(token inputs:scale = ).*", r'\1"1"', file.read_text())
    file.write_text(wrong)
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    names = {error.GetName() for error in context.Validate(Usd.Stage.Open(str(file)))}
    assert names - {"MissingShaderIdInRegistry"}


@pytest.mark.parametrize("kind", ["UsdUVTexture", "ND_image_float"])
def test_every_frame_has_its_file_until_the_next(tmp_path: Path, kind: str) -> None:
    stage = scene(tmp_path, LOOK)
    files = [file_at(stage, kind, time) for time in (7, 8, 9.5, 10, 99)]
    assert files == [f"face.1001.{n:04d}.exr" for n in (7, 8, 8, 10, 10)]
    first = shader(stage, kind).GetInput("file").Get(Usd.TimeCode.Default())
    assert first.resolvedPath == str(tmp_path / "face.1001.0007.exr")


def test_udims_are_a_token(tmp_path: Path) -> None:
    stage = scene(tmp_path, TILES)
    assert file_at(stage, "UsdUVTexture", 8) == "face.<UDIM>.0008.exr"
    assert replace(LOOK, udims=(1002,)).file("0007") == "face.<UDIM>.0007.exr"


def test_frames_are_those_of_a_scene_with_that_rate(tmp_path: Path) -> None:
    """USD scales the times of a sublayer whose rate is another one."""
    stage = scene(tmp_path, replace(LOOK, fps=48.0), fps=48.0)
    assert [file_at(stage, "UsdUVTexture", t) for t in (7, 10)] == [
        "face.1001.0007.exr",
        "face.1001.0010.exr",
    ]
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "face.look.usda"))
    assert (layer.startTimeCode, layer.endTimeCode, layer.framesPerSecond) == (7, 10, 48)


@pytest.mark.parametrize(
    ("unit", "scale"), [("cm", 1.0), ("m", 0.01), ("mm", 10.0), ("in", 1 / 2.54)]
)
def test_heights_are_scaled_and_nothing_else(tmp_path: Path, unit: str, scale: float) -> None:
    stage = scene(tmp_path, replace(LOOK, scene_unit=unit))
    heights = shader(stage, "UsdUVTexture")
    assert list(heights.GetInput("scale").Get()) == pytest.approx([scale] * 4)
    assert list(heights.GetInput("bias").Get()) == [0] * 4
    assert list(heights.GetInput("fallback").Get()) == [0] * 4
    assert heights.GetInput("sourceColorSpace").Get() == "raw"
    assert heights.GetInput("file").GetAttr().GetColorSpace() == "raw"
    moved = shader(stage, "ND_displacement_float")
    assert moved.GetInput("scale").Get() == pytest.approx(scale)


def test_the_mesh_is_displaced_in_both_networks(tmp_path: Path) -> None:
    stage = scene(tmp_path, replace(LOOK, uv="UVMap"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/root/face/mesh"))
    assert mesh.GetFaceVaryingLinearInterpolationAttr().Get() == "all"
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    preview, name, _ = material.ComputeDisplacementSource()
    assert (preview.GetShaderId(), name) == ("UsdPreviewSurface", "displacement")
    (heights,) = preview.GetInput("displacement").GetConnectedSources()[0]
    assert (heights.source.GetPath(), heights.sourceName) == (
        shader(stage, "UsdUVTexture").GetPath(),
        "r",
    )
    other, _, _ = material.ComputeDisplacementSource("mtlx")
    assert other.GetShaderId() == "ND_displacement_float"
    assert shader(stage, "UsdPrimvarReader_float2").GetInput("varname").Get() == "UVMap"
    assert shader(stage, "ND_geompropvalue_vector2").GetInput("geomprop").Get() == "UVMap"


def test_a_material_of_the_scene_keeps_its_surface(tmp_path: Path) -> None:
    stage = scene(tmp_path, replace(LOOK, material="/root/skin"))
    skin = UsdShade.Material(stage.GetPrimAtPath("/root/skin"))
    surface, _, _ = skin.ComputeSurfaceSource()
    assert surface.GetPath() == "/root/skin/surface"
    assert skin.ComputeDisplacementSource()[0].GetPath() == "/root/skin/rhytidPreview"
    bound, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(LOOK.bind)).ComputeBoundMaterial()
    assert bound.GetPath() == "/root/skin"


@pytest.mark.parametrize("look", [LOOK, replace(LOOK, material="/root/skin")])
def test_nodes_of_materialx_have_its_inputs(
    tmp_path: Path, library: mx.Document, look: Look
) -> None:
    stage = scene(tmp_path, look)
    shaders = [UsdShade.Shader(p) for p in stage.Traverse() if p.IsA(UsdShade.Shader)]
    ours = [s for s in shaders if s.GetShaderId().startswith("ND_")]
    assert len(ours) == (4 if look.material is None else 3)
    for node in ours:
        known = library.getNodeDef(node.GetShaderId())
        types = {i.getName(): i.getType() for i in known.getActiveInputs()}
        for given in node.GetInputs():
            kind = {"asset": "filename", "float2": "vector2"}.get(
                str(given.GetTypeName()), str(given.GetTypeName())
            )
            assert types[given.GetBaseName()] == kind
        assert {o.GetBaseName() for o in node.GetOutputs()} == {
            o.getName() for o in known.getActiveOutputs()
        }


@pytest.mark.parametrize("look", OTHERS, ids=lambda look: f"{look.name}-{look.udims}")
def test_materialx_finds_nothing_wrong(library: mx.Document, look: Look) -> None:
    document = mx.createDocument()
    mx.readFromXmlString(document, materialx_look(look).decode())
    document.importLibrary(library)
    assert document.validate() == (True, "")
    (material,) = [n for n in document.getMaterialNodes() if not n.getSourceUri()]
    moved = material.getInput("displacementshader").getConnectedNode()
    assert moved.getInputValue("scale") == pytest.approx(look.scale)
    image = moved.getInput("displacement").getConnectedOutput().getConnectedNode()
    assert image.getNodeDef().getName() == "ND_image_float"
    assert image.getInput("file").getColorSpace() == "none"
    frame = "0008" if "0008" in look.frames else look.frames[0]
    resolver = document.createStringResolver()
    resolver.setUdimString(f"{look.udims[0]}")
    resolver.setFilenameSubstitution("{04frame}", frame)
    found = image.getInput("file").getResolvedValueString(resolver)
    assert found == f"{look.name}.{look.udims[0]}.{frame}.exr"


def test_the_checker_of_materialx_sees_a_wrong_connection(library: mx.Document) -> None:
    document = mx.createDocument()
    text = materialx_look(LOOK).decode().replace('nodename="heights"', 'nodename="nothing"')
    mx.readFromXmlString(document, text)
    document.importLibrary(library)
    assert not document.validate()[0]


@pytest.mark.parametrize(
    ("frames", "token"),
    [
        (("0001", "0002"), "{04frame}"),
        (("9", "10"), "{frame}"),
        (("0999", "1000", "10000"), "{04frame}"),
        (("smile",), "smile"),
    ],
)
def test_the_token_is_that_of_the_names(frames: tuple[str, ...], token: str) -> None:
    assert replace(LOOK, frames=frames).frame_token() == token


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"frames": ("0001", "smile")}, "frame smile has no number: --frame chooses"),
        ({"frames": ("01", "002")}, "frame 002 is not padded as others are, to 2 digits"),
        ({"udims": (1001, 1101)}, "UDIM 1101: USD reads 1001 to 1100"),
        ({"material": LOOK.bind}, "/root/face/mesh is a material"),
    ],
)
def test_what_cannot_be_told_is_refused(changes: dict[str, object], why: str) -> None:
    with pytest.raises(InputError, match=why):
        replace(LOOK, **changes)


def test_an_unknown_unit_is_scaled_into_none() -> None:
    assert replace(LOOK, unit="span", scene_unit="span").scale == 1.0
    assert "metersPerUnit" not in usd_look(replace(LOOK, unit="span", scene_unit="span"))
    with pytest.raises(InputError, match="'span' is no known unit"):
        usd_look(replace(LOOK, unit="span"))


@pytest.mark.parametrize("named", ["specular_roughness", "specular_anisotropy", "tangent"])
def test_shine_ends_at_the_surface(named: str) -> None:
    document = mx.createDocument()
    mx.readFromXmlString(document, materialx_look(replace(LOOK, shine=True)).decode())
    surface = document.getNode("face_surface")
    output = surface.getInput(named).getConnectedOutput()
    assert output.getConnectedNode() is not None
    graph = document.getNodeGraph("face_shine")
    files = {n.getName(): n.getInputValue("file") for n in graph.getNodes("image")}
    assert files == {
        "Roughness": "face.roughness.1001.{04frame}.png",
        "Axis": "face.anisotropy.1001.{04frame}.png",
    }


def _shine(along: float, across: float) -> dict[str, float]:
    """Values of the nodes of roughness and anisotropy, of maps with these two values."""
    found = {"Roughness": [along, across, 0.0]}
    work = {
        "max": max,
        "multiply": lambda a, b: a * b,
        "divide": lambda a, b: a / b,
        "subtract": lambda a, b: a - b,
        "sqrt": lambda a: a**0.5,
    }
    for node in SHINE:
        given = {name: found.get(of) for name, _, of in node.links}
        given |= {name: float(value) for name, type, value in node.values if type == "float"}
        if None in given.values() or node.map:
            continue  # of the axis
        if node.category == "extract":
            found[node.name] = given["in"][int(node.values[0][2])]
        elif node.category in work and node.type == "float":
            found[node.name] = work[node.category](*(given[name] for name in sorted(given)))
    return found


def test_skin_without_roughness_has_a_finite_look() -> None:
    """Both are 0 where a base roughness of 0 has no relief over it."""
    flat, ridges, usual = _shine(0.0, 0.0), _shine(0.3, 0.0), _shine(0.4, 0.3)
    assert (flat["Strength"], flat["Both"]) == (0.0, pytest.approx(0.001))
    assert 0.99 < ridges["Strength"] < 1.0 - 1e-6
    assert usual["Strength"] == pytest.approx(1.0 - (0.3 / 0.4) ** 2)
    assert usual["Both"] == pytest.approx(0.12**0.5)
