"""USD layers as text: the head of a layer, and a look.

The look is a material whose displacement is a baked map, another one at every frame. Two networks
have the same heights: UsdPreviewSurface, after
https://openusd.org/release/spec_usdpreviewsurface.html, and MaterialX, for renderers that take it.
Frames are time samples of `inputs:file`: USD holds a file until the next sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

from rhytid.domain.lengths import millimetres
from rhytid.exports.look import Look
from rhytid.exports.look_shine import DEFAULTS, FILTERS, SHINE, SURFACE

_SCOPE = "Looks"
# Prefix of the names of nodes, since a material that is given displacement has nodes of its own.
_NODE = "rhytid"
Lines = Iterator[str]
Path = tuple[str, ...]
# Metadata of a prim, and its rows.
Part = tuple[str, list[str]]
# Types of USD by those of MaterialX, and outputs of such nodes.
_TYPES = {
    "float": "float", "integer": "int", "string": "string", "color3": "color3f",
    "vector3": "float3",
}  # fmt: skip
_OUT = {type: f"{_TYPES[type]} outputs:out" for type in ("float", "color3", "vector3")}


def usd_look(look: Look) -> str:
    """The text of a USD layer with a look, which goes among the sublayers of a scene."""
    return "\n".join([*_header(look), "", *_prims(look), ""])


def _header(look: Look) -> list[str]:
    rows = [f"framesPerSecond = {look.fps:g}", f"timeCodesPerSecond = {look.fps:g}"]
    if look.material is None:
        rows.append(f'defaultPrim = "{_SCOPE}"')
    if len(look.frames) > 1:
        rows.append(f"startTimeCode = {int(look.frames[0])}")
        rows.append(f"endTimeCode = {int(look.frames[-1])}")
    return usda_header(look.scene_unit, rows)


def _prims(look: Look) -> Lines:
    own = (_SCOPE, look.identifier)
    path = look.material or "/" + "/".join(own)
    parts = {_parts(path): ("", list(_material(look, path)))}
    if look.bind is not None:
        api = ' (\n    prepend apiSchemas = ["MaterialBindingAPI"]\n)'
        uv = 'uniform token faceVaryingLinearInterpolation = "all"'
        parts[_parts(look.bind)] = (api, [uv, f"rel material:binding = <{path}>"])
    heads = {own[:1]: f'def Scope "{own[0]}"', own: f'def Material "{own[1]}"'}
    yield from _tree(parts, heads if look.material is None else {})


def _material(look: Look, path: str) -> Lines:
    """Outputs of a material and the nodes behind them."""
    nodes = f"{path}/{_NODE}"
    yield f"token outputs:displacement.connect = <{nodes}Preview.outputs:displacement>"
    yield f"token outputs:mtlx:displacement.connect = <{nodes}MtlxDisplacement.outputs:out>"
    if look.material is None:
        yield f"token outputs:surface.connect = <{nodes}Preview.outputs:surface>"
        yield f"token outputs:mtlx:surface.connect = <{nodes}MtlxSurface.outputs:out>"
    yield ""
    yield from (*_preview(look, nodes), "", *_materialx(look, nodes))


def _preview(look: Look, nodes: str) -> Lines:
    yield from _shader(
        "Preview",
        "UsdPreviewSurface",
        [
            f"float inputs:displacement.connect = <{nodes}Heights.outputs:r>",
            "token outputs:displacement",
            "token outputs:surface",
        ],
    )
    scale = f"{look.scale!r}"
    yield ""
    yield from _shader(
        "Heights",
        "UsdUVTexture",
        [
            # A missing file must not move the surface, and neither must UV outside of the map.
            "float4 inputs:bias = (0, 0, 0, 0)",
            "float4 inputs:fallback = (0, 0, 0, 0)",
            *_files(look),
            # Blender takes the first of four; others multiply each.
            f"float4 inputs:scale = ({', '.join([scale] * 4)})",
            'token inputs:sourceColorSpace = "raw"',
            f"float2 inputs:st.connect = <{nodes}Coordinates.outputs:result>",
            'token inputs:wrapS = "clamp"',
            'token inputs:wrapT = "clamp"',
            "float outputs:r",
        ],
    )
    yield ""
    rows = [f'string inputs:varname = "{look.uv}"', "float2 outputs:result"]
    yield from _shader("Coordinates", "UsdPrimvarReader_float2", rows)


def _materialx(look: Look, nodes: str) -> Lines:
    if look.material is None:
        rows = ["token outputs:out"]
        for input, type, node in SURFACE if look.shine else ():
            rows.append(f"{_TYPES[type]} inputs:{input}.connect = <{nodes}{node}.outputs:out>")
        yield from _shader("MtlxSurface", "ND_standard_surface_surfaceshader", rows)
        yield ""
    rows = [
        f"float inputs:displacement.connect = <{nodes}MtlxHeights.outputs:out>",
        f"float inputs:scale = {look.scale!r}",
        "token outputs:out",
    ]
    yield from _shader("MtlxDisplacement", "ND_displacement_float", rows)
    rows = [
        "float inputs:default = 0",
        *_files(look),
        'string inputs:filtertype = "linear"',
        f"float2 inputs:texcoord.connect = <{nodes}MtlxCoordinates.outputs:out>",
        'string inputs:uaddressmode = "clamp"',
        'string inputs:vaddressmode = "clamp"',
        "float outputs:out",
    ]
    yield from ("", *_shader("MtlxHeights", "ND_image_float", rows), "")
    if look.shine:
        yield from _shine(look, nodes)
    rows = [f'string inputs:geomprop = "{look.uv}"', "float2 outputs:out"]
    yield from _shader("MtlxCoordinates", "ND_geompropvalue_vector2", rows)


def _shine(look: Look, nodes: str) -> Lines:
    """Nodes of roughness and anisotropy."""
    for node in SHINE:
        rows = [f"{_TYPES[t]} inputs:{name} = {_literal(t, v)}" for name, t, v in node.values]
        for name, type, other in node.links:
            rows.append(f"{_TYPES[type]} inputs:{name}.connect = <{nodes}{other}.outputs:out>")
        if node.map is not None:
            rows += [
                f"color3f inputs:default = ({DEFAULTS[node.map]})",
                *_files(look, partial(look.shine_file, node.map)),
                f'string inputs:filtertype = "{FILTERS[node.map]}"',
                f"float2 inputs:texcoord.connect = <{nodes}MtlxCoordinates.outputs:out>",
                'string inputs:uaddressmode = "clamp"',
                'string inputs:vaddressmode = "clamp"',
            ]
        yield from (*_shader(node.name, node.definition, [*rows, _OUT[node.type]]), "")


def _literal(type: str, value: str) -> str:
    return f'"{value}"' if type == "string" else value


def _files(look: Look, file: Callable[[str], str] | None = None) -> Lines:
    """The file of the first frame for readers without time, then that of every frame.  file: names
    it; that of the heights unless given."""
    named = look.file if file is None else file
    yield f"asset inputs:file = @./{named(look.frames[0])}@ ("
    yield from ('    colorSpace = "raw"', ")")
    if len(look.frames) > 1:
        yield "asset inputs:file.timeSamples = {"
        yield from (f"    {int(frame)}: @./{named(frame)}@," for frame in look.frames)
        yield "}"


def _shader(name: str, kind: str, rows: Sequence[str]) -> Lines:
    yield from _prim(f'def Shader "{_NODE}{name}"', [f'uniform token info:id = "{kind}"', *rows])


def _tree(parts: Mapping[Path, Part], heads: Mapping[Path, str], above: Path = ()) -> Lines:
    """Prims by their paths, each with its rows; those without a head are there already: overs."""
    for number, name in enumerate(dict.fromkeys(path[0] for path in parts)):
        here = (*above, name)
        after, rows = parts.get((name,), ("", []))
        below = {p[1:]: part for p, part in parts.items() if p[0] == name and len(p) > 1}
        inside = list(_tree(below, heads, here))
        gap = [""] if rows and inside else []
        yield from [""] if number else []
        yield from _prim(heads.get(here, f'over "{name}"') + after, [*rows, *gap, *inside])


def _parts(path: str) -> Path:
    return tuple(path.strip("/").split("/"))


def _prim(head: str, rows: Sequence[str]) -> Lines:
    yield from head.split("\n")
    yield from ("{", *indented(rows), "}")


def usda_header(unit: str, metadata: Sequence[str]) -> list[str]:
    """The lines of the head of a layer, Y up.

    unit: of length, of the layer; metersPerUnit is left out where the unit has no known length.
    metadata: further rows, `name = value`.
    """
    rows = sorted(metadata)
    if (length := millimetres(unit)) is not None:
        rows = sorted([*rows, f"metersPerUnit = {length / 1000!r}"])
    return ["#usda 1.0", "(", *indented([*rows, 'upAxis = "Y"']), ")"]


def indented(rows: Sequence[str]) -> Iterator[str]:
    """The rows of a block, four spaces to the right."""
    yield from (f"    {row}" if row else "" for row in rows)
