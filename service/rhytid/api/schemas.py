"""What requests and answers hold, so that the OpenAPI document is true."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from rhytid.domain.methods import DISPLACEMENT, LAYERS, METHODS, SAMPLINGS, STRETCH_MODELS
from rhytid.domain.notices import NOTICES
from rhytid.domain.warnings import CODES
from rhytid.engine.messages import MapQuery
from rhytid.exports.curves import CURVE_FORMATS
from rhytid.exports.meshes import MESH_FORMATS
from rhytid.formats.tiles import FORMATS

STRICT = "warnings are an error: 422, with `warnings`; nothing is stored or begun"
ALLOW = (
    "a code that `strict=true` does not refuse, repeated for several: it stays a warning; an "
    "unknown code is 422, with or without strict"
)
GRAPH_FORMATS = ("safetensors", *CURVE_FORMATS)


def _options(values: Any) -> dict[str, Any]:
    return {"enum": list(values)}


CODE = {"type": "string", **_options(CODES)}


class _Query(BaseModel):
    """Query parameters; unknown names are refused."""

    model_config = ConfigDict(extra="forbid")


class TileQuery(_Query):
    """Which displacement, and in which format."""

    method: str = Field(
        "redraw",
        json_schema_extra=_options(METHODS),
        description="`redraw` draws every wrinkle anew, exact; `binned` blends precomputed maps, "
        "fast; `convolved` blurs and sharpens the neutral map; `neutral` ignores the frame",
    )
    stretch: str = Field(
        "tensor",
        json_schema_extra=_options(STRETCH_MODELS),
        description="how stretch is measured: the full tensor, edge tension, or along u and v",
    )
    sampling: str = Field(
        "nearest",
        json_schema_extra=_options(SAMPLINGS),
        description="stretch of whole triangles (`nearest`), or interpolated (`smooth`)",
    )
    layer: str = Field(
        DISPLACEMENT,
        json_schema_extra=_options(LAYERS),
        description="`slopes`: in place of displacement five float32 of each texel, the mean slope "
        "of level 0 along tangent and bitangent and the means of xx, xy and yy; `npy` (rows, "
        "columns, 5) and `exr` (channels slope.x, slope.y, slope.xx, slope.xy, slope.yy) alone",
    )
    format: str = Field(
        "npy",
        json_schema_extra=_options(FORMATS),
        description="file format; `f16` and `exr16` have half floats, `png` 16 bits and "
        "`X-Rhytid-Scale`",
    )

    def map_query(self) -> MapQuery:
        """The part that the engine answers; raises QueryError naming the known values."""
        return MapQuery(self.method, self.stretch, self.sampling, self.layer)


class WholeMapQuery(TileQuery):
    """The same, and the level of a whole map."""

    level: int = Field(0, ge=0, description="0 is the full resolution; every level halves it")


class TilesQuery(TileQuery):
    """The same, and the tiles wanted, in the order of the answer."""

    strict: bool = Field(False, description=STRICT)
    allow: list[str] = Field([], description=ALLOW, json_schema_extra={"items": CODE})
    tile: list[str] = Field(min_length=1, description="udim/level/row/column, repeated for several")


class BinQuery(_Query):
    """Which quantised map: the layer, the bin in it and the sample of log stretch."""

    bin: int | None = Field(
        None, ge=0, description="index into the layer's bins; needed where it has more than one"
    )
    sample: int | None = Field(
        None, ge=0, description="index into the layer's samples; needed where it has more than one"
    )
    layer: str = Field("wrinkles", description="a layer of the manifest")


class GraphQuery(_Query):
    """In which form a wrinkle graph comes."""

    format: str = Field(
        "safetensors",
        json_schema_extra=_options(GRAPH_FORMATS),
        description="the whole graph (`safetensors`), or its wrinkles as lines in space",
    )


class MeshQuery(_Query):
    """In which form a neutral mesh comes."""

    format: str = Field("glb", json_schema_extra=_options(MESH_FORMATS), description="file format")


class PackageQuery(_Query):
    """How much of a skin package there is."""

    levels: int = Field(1, ge=1, le=16, description="levels of the maps; 1 is the finest alone")
    key: str | None = Field(
        None,
        min_length=1,
        max_length=64,
        description="`X-Rhytid-Package` of the first file that was read: 409 where the package of "
        "the asset is another one now, so that files of two are not mixed",
    )


class _Answer(BaseModel):
    """Read from the engine's message of the same shape."""

    model_config = ConfigDict(from_attributes=True)


class InputWarning(_Answer):
    """Something that is probably wrong; `rhytid warnings CODE` says what to do about each."""

    code: str = Field(json_schema_extra=_options(CODES), description="which kind of warning")
    detail: str = Field(description="what is wrong, in plain text")
    where: str = Field(description="the mesh or the frame, and the place on it")


class Notice(_Answer):
    """Something worth knowing of an asset that is no mistake; `strict=true` does not refuse it."""

    code: str = Field(json_schema_extra=_options(NOTICES), description="which kind of notice")
    detail: str = Field(description="what, and what to do, in plain text")


class Problem(BaseModel):
    """RFC 9457 problem details."""

    type: str = Field(description="URI that names the kind of problem, or about:blank")
    title: str = Field(description="the kind in a few words")
    status: int = Field(description="the HTTP status")
    detail: str = Field(description="what is wrong, and where")
    warnings: list[InputWarning] | None = Field(
        None, description="those that `strict=true` turned into a problem; of `allow` none"
    )
    request_id: str = Field(
        description="as `X-Request-Id` of the answer: that of the request, where it was well formed"
    )


class Status(BaseModel):
    """Alive, or ready."""

    status: str = Field(description="`alive` or `ready`")


class Root(BaseModel):
    """What this is, and the paths to start from."""

    name: str = Field(description="`rhytid`")
    version: str = Field(description="version of the program")
    docs: str = Field(description="documentation of the API as a page")
    openapi: str = Field(description="the same as an OpenAPI document")
    assets: str = Field(description="the assets")
    devices: str = Field(description="the OpenCL devices")
    health: str = Field(description="answers while the process is alive")
    metrics: str = Field(description="figures for Prometheus")


class Device(_Answer):
    """An OpenCL device; memory in bytes."""

    name: str = Field(description="as the driver gives it")
    platform: str = Field(description="the OpenCL platform, which names the driver")
    kind: str = Field(description="gpu, cpu or other")
    version: str = Field(description="the OpenCL version")
    compute_units: int = Field(description="number of compute units")
    memory: int = Field(description="what the driver says the device has")
    budget: int = Field(description="what this server allows itself; 0 where not selected")
    used: int = Field(description="what this server has allocated")
    selected: bool = Field(description="whether this server computes on it")
    restarts: int = Field(description="how often its process was started again")


class Bytes(_Answer):
    """What is held of a budget of bytes."""

    limit: int = Field(description="bytes that may be held at once")
    used: int = Field(description="bytes held now")
    waiting: int = Field(description="requests that wait for bytes now")
    purposes: dict[str, int] = Field(description="bytes held now, by what they are held for")


class HostMemory(_Answer):
    """Bytes that requests and jobs hold on the host."""

    host: Bytes = Field(description="answers until they are sent, uploads, frames that wait")
    small: Bytes = Field(description="small answers and frames, beside these")
    spool: Bytes = Field(description="uploads on disk")


class GraphStatistics(BaseModel):
    """Figures of a wrinkle graph."""

    spacing: float = Field(
        description="distance of pores where density is 1, mesh units, as the metadata of the "
        "graph have it: the usual depth and other lengths are in proportion to it"
    )
    distance: float = Field(
        description="mean distance from a pore to the nearest as measured, mesh units: less where "
        "painted density is above 1"
    )
    degree: float = Field(description="mean number of wrinkles per pore")
    strengths: list[int] = Field(description="wrinkles by weight, in tenths from 0 to 1")
    events: dict[str, int] = Field(
        default_factory=dict, description="bumps, scars, moles and other single features, by kind"
    )


class Asset(_Answer):
    """An asset; `settings` are fully resolved once it is ready."""

    id: str = Field(description="made of the content: the same content has the same id")
    state: str = Field(
        json_schema_extra=_options(("building", "ready", "failed")),
        description="tiles can be asked for once it is `ready`",
    )
    job: str | None = Field(description="id of the job that builds it, null without one")
    reason: str | None = Field(description="why the build failed, else null")
    settings: dict[str, Any]
    udims: list[int] = Field(description="UDIMs that the mesh lies in")
    levels: int = Field(description="levels of a map, down to one texel")
    vertices: int = Field(description="vertices of the mesh, V")
    triangles: int = Field(description="triangles of the mesh, F")
    pores: int = Field(
        description="each once, copies at UV seams not counted; 0 until the graph exists"
    )
    wrinkles: int = Field(
        description="each once, copies at UV seams not counted; 0 until the graph exists"
    )
    statistics: GraphStatistics | None = Field(description="null until the graph exists")
    warnings: list[InputWarning] = Field(
        description="what is probably wrong with the mesh; in the answer to POST also with frames"
    )
    notices: list[Notice] = Field(description="what is worth knowing of the present settings")
    centre: list[float] = Field(
        description="what is subtracted from positions before they become float32, mesh units"
    )


class Job(_Answer):
    """Long work."""

    id: str = Field(description="id of the job")
    asset: str = Field(description="id of its asset")
    kind: str = Field(
        description="what it does, such as build, frames, calibration, bins or package"
    )
    state: str = Field(
        json_schema_extra=_options(("queued", "running", "done", "failed", "cancelled")),
        description="the last three are final",
    )
    progress: float = Field(description="from 0 to 1")
    stage: str = Field(description="what it does now")
    detail: str = Field(description="why it failed, else empty")
    warnings: list[InputWarning] = Field(description="about the frame of a calibration")


class Frame(_Answer):
    """A stored frame."""

    name: str = Field(description="name of the frame, unique within the asset")
    log_stretch: dict[str, float] = Field(
        description="percentiles of the clamped log stretch, over triangles and axes"
    )
    warnings: list[InputWarning] = Field(description="what is probably wrong with the frame")


class TiltLine(_Answer):
    """How the depth of a bin goes over its tilts."""

    node: float = Field(
        description="where σ_d is taken for the line: this share of the way from the middle of a "
        "bin to its edge, to either side"
    )
    share: float = Field(
        description="depths were scaled by 1 ± this from edge to edge of a bin in the two drawings "
        "whose difference gives the tilts"
    )
    width: float = Field(description="what half widths were scaled by in these drawings")


class CushionLayer(_Answer):
    """How the maps of the cushions lie under the texels, and are blended."""

    factor: int = Field(description="texels per sample, per side")
    apron: int = Field(
        description="samples that a tile has beyond those under its own texels, on every side"
    )
    samples: list[float] = Field(description="log stretch of each of its maps")
    exponent: float = Field(description="e of the depth scale exp(-e r) that codes lack")


class GrainLayer(_Answer):
    """How the grain follows a frame."""

    exponent: float = Field(description="e of its gain, the mean of exp(-e log ρ) over both axes")


class Bins(_Answer):
    """The precomputed maps of an asset, and the numbers that blending them takes: docs/binned.md
    has the formulas."""

    angles: list[float] = Field(
        description="direction of each bin, radians from v towards u; θ = (sin, cos)"
    )
    samples: list[float] = Field(description="log stretch of each sample of the wrinkles")
    pore_samples: list[float] = Field(description="log stretch of each sample of the pores")
    steps: dict[str, list[float]] = Field(
        description="mesh units per code, by layer and sample; of tilts 1 over the largest code; "
        "of grain in the neutral"
    )
    bits: int = Field(description="of a code, signed; the largest is 2^(bits-1) - 1")
    merge: str = Field(
        description="how layers meet: min; soft, whose two deepest valleys a >= b come to "
        "a + min(b, (w - (a - b))²/4w) with the square only where a - b < w, w = 4 log(2) "
        "depth/sharpness, and the highest bulge is added; signed and mellow, the mellow-max"
    )
    depth_factored: bool = Field(
        description="maps have no depth scale: the blend is multiplied by σ_d of its own stretch"
    )
    layers: dict[str, int] = Field(
        description="bins of each layer; a mellow merge has layers of bulges too. wrinkle_tilts: "
        "where in its bin a wrinkle runs, code/largest from -1, the edge of the smaller angle, to "
        "1. cushions: of the broad layer, coarse; cushion_owners: int32, the row of the graph "
        "whose log stretch a sample takes, -1 for none; cushion_places: where along it, "
        "code/largest from 0 to 1. grain: noise of the neutral, int8"
    )
    depth: float = Field(description="of a wrinkle of strength 1, mesh units")
    sharpness: float = Field(description="β of the merge, per depth")
    log_stretch_limit: float = Field(description="log ρ is clamped to ± this before anything else")
    scale_limit: float = Field(description="σ stays within 1/this and this")
    depth_exponents: dict[str, float] = Field(
        description="by wrinkles and pores: what is multiplied by is exp(-exponent r); 0: nothing"
    )
    measured_in: str = Field(
        description="where the angle between a bin and the axes of stretch is taken: uv, surface"
    )
    tilt: TiltLine | None = Field(description="null without tilts")
    soft_limits: bool = Field(description="log ρ and the logs of σ are limited by a knee")
    pore_depth_limit: float = Field(description="σ_d of pores is at most this")
    cushion: CushionLayer | None = Field(description="null without cushions")
    grain: GrainLayer | None = Field(description="null without grain")
