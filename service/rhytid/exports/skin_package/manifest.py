"""manifest.json of a skin package: what its files are and the numbers that blending takes."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

FORMAT, VERSION = "rhytid-skin", 2
# Of packages of scanned skin, so that who does not know a residual refuses them.
SCANNED_VERSION = 3


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Layer(_Part):
    """Maps of one kind: of every bin those of its samples, then those of the next bin."""

    name: str = Field(description="wrinkles, pores, wrinkle_tilts, grain, events or cushions")
    first: int = Field(ge=0, description="the first of its maps in its array, of a page")
    bins: int = Field(ge=1)
    samples: list[float] = Field(
        description="log stretch of each sample; [0] where there is one; [0, 0] of events, which "
        "are the sum of a coarse and a fine map of the neutral"
    )
    steps: list[float] = Field(
        description="of each sample what code 1 stands for: mesh units along the outward normal; "
        "of tilts the share of half a bin"
    )
    depth_exponent: float = Field(
        description="e of the depth scale exp(-e r) that blending multiplies by; 0 where the maps "
        "have it in them"
    )
    depth_limit: float = Field(description="the largest depth scale")


class Textures(_Part):
    """A texture array of every UDIM. Layer page * maps + map."""

    files: dict[str, str] = Field(description="KTX2 file by UDIM")
    format: str = Field(
        description="R8_SNORM, R16_UINT or R32_UINT; a file of another UDIM may be narrower"
    )
    size: int = Field(ge=1, description="texels a side")
    maps: int = Field(ge=1, description="maps of a page")
    pages: int = Field(ge=1, description="parts that a UDIM is cut into, row by row")
    pages_a_row: int = Field(ge=1)
    levels: int = Field(ge=1, description="level L + 1 has the means of 2 x 2 texels of level L")
    bytes: int = Field(ge=0, description="of the texels of all UDIMs and levels")
    bytes_of_level_0: int = Field(ge=0)


class Codes(_Part):
    """What the numbers of sets stand for: an R8_SNORM texture array of every UDIM, a layer for each
    sample. Set i is at column i % width, row i / width."""

    files: dict[str, str] = Field(description="KTX2 file by UDIM")
    width: int
    bytes: int = Field(ge=0, description="of the texels of all UDIMs")


class Wrinkles(_Part):
    """The maps of the bins: of every texel and bin the number of the set of its samples' codes."""

    textures: Textures
    codes: Codes


class Lines(_Part):
    """What wrinkles answer to stretch by: an R32_UINT texture array of every UDIM, line i at column
    i % width, row i / width. Its layers are the triangle; the direction, u in the lower 16 bits and
    v in the upper, each 32768 + 32767 times the component; and of the start and of the end 1 + the
    line that continues there, 0 for none. The last line is of samples without an owner."""

    files: dict[str, str] = Field(description="KTX2 file by UDIM")
    width: int
    height: int = Field(description="of the largest")
    ends: float = Field(description="how far r at an end goes to the mean with the next line's")
    bytes: int = Field(ge=0, description="of the texels of all UDIMs")


class Cushion(_Part):
    """The broad layer of the wrinkles, coarse. The maps of `textures` are those of the samples of
    `layer`, then where along its owner each sample lies, 127 at the end."""

    textures: Textures
    owners: Textures = Field(description="of each sample the line that it answers by")
    lines: Lines
    layer: Layer
    factor: int = Field(description="texels to a sample")
    apron: int = Field(description="samples more on every side of a UDIM")


class Residual(_Part):
    """What the lines and pores of a scanned skin do not draw, added last, in every frame alike."""

    textures: Textures = Field(description="R16_UINT, one map")
    step: float = Field(description="mesh units: a texel is first + step * number")
    first: float = Field(description="what number 0 stands for, mesh units")


class Tilt(_Part):
    """How the depth of a bin depends on the angle of a wrinkle in it."""

    node: float


class Grain(_Part):
    """Noise of the neutral surface, added last."""

    exponent: float


class Blend(_Part):
    """The numbers of docs/binned.md."""

    angles: list[float] = Field(description="of the bins, radians from v towards u")
    r_max: float
    last_sample: float = Field(description="log stretch of the outermost sample")
    merge: str = Field(description="min, soft or signed")
    sharpness: float
    depth: float = Field(description="of strength 1, mesh units")
    log_stretch_limit: float
    scale_limit: float
    soft_limits: bool
    tilt: Tilt | None
    grain: Grain | None


class Folds(_Part):
    """What folds of the mesh take of log compression: the numbers of folds.py and folds.js."""

    length: float = Field(
        description="mesh units; folds where the variance of b is `least` + 15 take half of `most`"
    )
    most: float = Field(description="the largest share, times response.folds")
    least: float = Field(description="of the variance of b, what is no fold")
    most_bend: float = Field(description="limit of length times a change of curvature")
    rounds: int = Field(description="of means of b and its square over the triangles of a vertex")
    normal_rounds: int = Field(description="of the normals of the vertices")
    python: str
    javascript: str


class Stretch(_Part):
    """The texture that is written for every frame: RGBA32F, two texels of each triangle: s1 and s2;
    log rho1, log rho2, the share that folds of the mesh take of compression, 0. The entry after the
    last triangle is unstretched."""

    triangles: int
    triangles_a_row: int
    width: int
    height: int
    rest: str = Field(description="file: 8 doubles of each triangle, little-endian")
    python: str
    javascript: str
    compute: dict[str, str] = Field(
        description="compute shaders that write the texture, by language: positions, indices and "
        "rest as float32 in buffers 0 to 2, 64 triangles a group; they leave the share of folds 0"
    )
    folds: Folds | None = Field(description="null where response.folds is 0")


class Weights(_Part):
    """The target of the pass of weights.frag, RGBA32F: texel (t % width, layer * rows + t / width)
    of triangle t. Layers are the bins, the pores and, where there is grain or are events, how much
    of each shows."""

    width: int
    height: int
    rows: int


class Mesh(_Part):
    """The neutral. Triangles are in the order of the textures."""

    file: str
    vertices: int = Field(description="of the mesh as it was sent; frames of it have as many")
    shapes: list[str] = Field(description="names of the morph targets")
    centre: list[float] = Field(description="what was subtracted from positions, mesh units")


class Shaders(_Part):
    """A shader text in one language: passes in the order in which they run."""

    libraries: dict[str, str] = Field(
        description="functions alone: weights; skin, the rest of the passes; shine, for materials"
    )
    vertex: str
    passes: dict[str, str]
    moments: dict[str, str] = Field(
        default={}, description="passes after height, for shine: slopes, and their products"
    )
    bindings: dict[str, int] | None = Field(description="of the textures in group 0, in WGSL")


class MaterialX(_Part):
    """The shader as a node."""

    document: str
    implementations: dict[str, str] = Field(description="of the node, by target of MaterialX")


class Manifest(_Part):
    """All of it."""

    format: str
    version: int
    rhytid_version: str
    asset: str
    preset: str
    unit: str
    unit_in_metres: float | None
    scale: float = Field(description="the largest displacement that is possible, mesh units")
    resolution: int
    udims: list[int]
    settings: dict[str, Any] = Field(description="of the asset, all of them")
    mesh: Mesh
    blend: Blend
    layers: list[Layer]
    wrinkles: Wrinkles
    textures: Textures
    triangles: Textures
    cushion: Cushion | None
    residual: Residual | None = Field(
        default=None, description="of scanned skin, in packages of version 3; others lack it"
    )
    stretch: Stretch
    weights: Weights
    shaders: dict[str, Shaders]
    materialx: MaterialX
    texture_bytes: int = Field(description="of all textures but that of the stretch")
    texture_bytes_of_level_0: int
    conventions: dict[str, str]
    left_out: list[str] = Field(description="what the package does not have")


CONVENTIONS = {
    "texel": "column, row of a UDIM; row 0 is at the top, its centre at v = 1 - 0.5 / resolution",
    "uv": "of the mesh, v up; skin.glb has v down, as glTF wants it: row = v * resolution",
    "displacement": "mesh units along the outward normal, furrows negative",
    "codes": "R8_SNORM: 127 times what a shader reads; code times step is displacement",
    "axes": "unit vectors in UV, v up; their signs are free",
    "log_stretch": "natural logarithm of deformed over neutral length, not clamped",
    "triangle": "index in the order of skin.glb; stretch.triangles where there is none",
}
LEFT_OUT = [
    "smooth sampling",
    "stiffness",
    "events that widen with stretch",
    "folds of the mesh where a compute shader measures stretch",
]


def schema() -> dict[str, Any]:
    """The JSON schema of manifest.json."""
    return Manifest.model_json_schema()
