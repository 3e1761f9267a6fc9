"""The parts of the OpenAPI document that signatures cannot express: bodies, binary answers,
problems, scopes."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from rhytid import __version__
from rhytid.api.accept import OCTETS
from rhytid.api.access import ALIVE, OPEN, ROUTES
from rhytid.api.encoding import WARNINGS
from rhytid.api.events import EVENT_STREAM
from rhytid.api.problems import MEDIA_TYPE
from rhytid.api.schemas import Problem
from rhytid.api.uploads import TAR
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import MOST_EXPRESSIONS
from rhytid.domain.painted_maps import CONTROLS, MOST_TEXELS, REGION_PREFIX
from rhytid.domain.scan import AUTO, FLIPS
from rhytid.domain.setting_fields import settings_schema
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.formats.limits import MOST_SCAN_SIDE, MOST_SIDE
from rhytid.formats.tiles import FORMATS

Responses = dict[int | str, dict[str, Any]]
BINARY = {"type": "string", "format": "binary"}
TAGS = [
    {"name": "assets", "description": "A neutral mesh with its wrinkle graph and settings."},
    {"name": "frames", "description": "Positions of the deformed mesh, kept in memory."},
    {"name": "tiles", "description": "Displacement, signed, in the unit of the mesh."},
    {"name": "bins", "description": "Precomputed maps of the method `binned`."},
    {"name": "jobs", "description": "Long work."},
    {"name": "service", "description": "Health, figures, devices."},
]


UNCHANGED: Responses = {304: {"description": "The client has these bytes (If-None-Match)"}}
SCHEME = "key"
KEY = {
    "type": "http",
    "scheme": "bearer",
    "description": "A key that `rhytid keys create` made, needed where the server has keys. "
    "Every call names the scope that the key must have.",
}
_PROBLEM = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}


def problems(*statuses: int) -> Responses:
    """Responses of a call that are problems: these statuses, and 500."""
    schema = {"$ref": "#/components/schemas/Problem"}
    content = {MEDIA_TYPE: {"schema": schema}}
    return {s: {"description": HTTPStatus(s).phrase, "content": content} for s in (*statuses, 500)}


def binary(*media_types: str) -> Responses:
    """A 200 whose body is bytes of one of these media types; for files also
    `application/octet-stream`, as `PlainBytes` labels them.

    Generated clients know that type, and few others.
    """
    content = {media_type: {"schema": BINARY} for media_type in media_types}
    if all(media_type.startswith(("application/", "model/")) for media_type in media_types):
        content.setdefault(OCTETS, {"schema": BINARY})
    return {200: {"description": "OK", "content": content}}


def in_ranges(*media_types: str) -> Responses:
    """As `binary`, of a file of which a range of bytes may be asked for."""
    whole = binary(*media_types)
    some = {"description": "The range of bytes that Range asks for; If-Range takes the ETag"}
    return {**whole, 206: {**whole[200], **some}, 416: problems(416)[416]}


def body(content: Mapping[str, Any], required: bool = True) -> dict[str, Any]:
    """Return an `openapi_extra` for a body that the route reads by itself."""
    return {"requestBody": {"required": required, "content": dict(content)}}


def reference(schema: str, description: str = "") -> dict[str, Any]:
    """Refer to a component of the document, with a description of its use here."""
    place = {"$ref": f"#/components/schemas/{schema}"}
    return {**place, "description": description} if description else place


def _scan_schema() -> dict[str, Any]:
    """The schema of how a scan is read: a setting that an upload may have, and no answer has."""
    number = {"type": "number"}
    scale = [number, {"type": "array", "items": number, "minItems": 1, "maxItems": 3}]
    how = {
        "scale": {
            "oneOf": scale,
            "description": "length of the full range of codes, or of 1 in floats; three for bands, "
            "from coarse to fine; below 0 turns the relief inside out; codes need one",
        },
        "unit": {"type": "string", "description": "of scale; absent: that of the mesh"},
        "detail": {
            **number,
            "minimum": 0,
            "maximum": 1,
            "description": "grain where the scan ends, from none to without a step in its "
            "spectrum; a number counts from where that falls away; absent: 1, but only below the "
            "texels of the map, where resolution is above these",
        },
        "fill": {
            **number,
            "minimum": 0,
            "description": "width of the border, in the unit of scale, over which grown skin fills "
            "in where the scan is flat, masked out by part scan_mask or missing; absent or 0: none",
        },
        "midlevel": {
            "oneOf": [number, {"type": "string", "enum": [AUTO]}],
            "description": "value without relief; absent: 0.5 for codes, 0 for floats",
        },
        "flip": {"type": "string", "enum": list(FLIPS), "description": "turns the maps over"},
        "partial": {"type": "boolean", "description": "UDIMs of the mesh may have no map"},
    }
    return {
        "type": "object",
        "additionalProperties": False,
        "writeOnly": True,
        "properties": how,
        "description": "how part scan of an upload is read; in no answer",
    }


def _asset_settings() -> dict[str, Any]:
    schema = settings_schema(AssetSettings())
    return {**schema, "properties": {**schema["properties"], "scan": _scan_schema()}}


# Components that are made of the declarations of the settings.
SETTINGS = {
    "AssetSettings": {
        **_asset_settings(),
        "description": "Settings of an asset. All are optional; unknown ones are refused.",
    },
    "SettingsChange": {
        **settings_schema(AssetSettings(), CHANGEABLE),
        "description": "The settings that can change without another synthesis. Those that are "
        "left out stay as they are.",
    },
}
CHANGES = body(
    {
        media_type: {"schema": reference("SettingsChange")}
        for media_type in ("application/json", "application/merge-patch+json")
    }
)


def _control(name: str) -> dict[str, Any]:
    what = f"where skin is {name.removeprefix(REGION_PREFIX)}: white wholly, black not at all"
    if not name.startswith(REGION_PREFIX):
        what = _MEANT[name]
    text = f"guides synthesis: {what}. Grey PNG or EXR, one per UDIM, named by it: {name}.1001.png"
    return {"type": "array", "items": BINARY, "description": text}


_MEANT = {
    "density": "pores and wrinkles per area, white is 4 times, black is none",
    "strength": "strengths of lines and pores, white is double up to 1, black is none of them",
    "direction": "angle of the lines in UV, 180° is white; black leaves the preferred lines",
    "turn": "of the preferred lines, black is 90° to the right, white to the left",
    "anisotropy": "how far lines keep to it, white is double, black is not at all",
    "scale": "width of wrinkles, white is 4 times, black a quarter",
    "pore_radius": "radius of pores, white is 4 times, black a quarter",
    "events": "number of bumps, scars, moles and the like, white is double, black is none",
}
POSITIONS = body(
    {
        "application/x-npy": {"schema": {**BINARY, "description": "(V, 3) float .npy"}},
        "application/octet-stream": {
            "schema": {**BINARY, "description": "(V, 3) float32, little-endian, row by row"}
        },
    }
)
ASSET_FORM = body(
    {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["mesh"],
                "properties": {
                    "mesh": {**BINARY, "description": "OBJ, PLY, glTF, GLB or .npz, by filename"},
                    "settings": reference("AssetSettings", "JSON, all of it optional"),
                    "graph": {
                        **BINARY,
                        "description": "safetensors; absent = synthesise. Its metadata may hold "
                        "unit, spacing, depth, sigma, wave_frequency, grain_size, undulation_size, "
                        "patch_size (lengths in that unit, converted to settings.unit), seed (of "
                        "the relief between the lines; explicit settings override all of these) "
                        "and mesh, a "
                        "digest of the triangles and UV: a graph of another mesh is refused",
                    },
                    "force": {
                        "type": "string",
                        "enum": ["true", "false"],
                        "description": "true: take a graph that was made for another mesh",
                    },
                    "stiffness": {
                        "type": "array",
                        "items": BINARY,
                        "description": "grey PNG of 8 or 16 bits, or EXR of one channel from 0 to "
                        "1 of any compression, one per UDIM (repeat the part), "
                        "named by it: stiffness.1002.png; 1 moves freely, 0 is rigid; "
                        "a UDIM without one is 1; "
                        f"at most {MOST_SIDE} texels per side and {MOST_TEXELS:,} in all",
                    },
                    "scan": {
                        "type": "array",
                        "items": BINARY,
                        "description": "displacement along the normal, scanned or sculpted, one "
                        "file per UDIM (repeat the part), named by it: head.1001.tif. EXR, PNG or "
                        "TIFF, JPEG, grey or three bands; settings.scan says how it is read. Its "
                        "lines and pores are traced in place of a synthesis, what they do not draw "
                        f"stays, and at rest the skin is the scan; at most {MOST_SCAN_SIDE} texels "
                        "per side. Warnings of `rhytid check --scan` are among those of the asset",
                    },
                    "scan_mask": {
                        "type": "array",
                        "items": BINARY,
                        "description": "where part scan counts: grey images, one per UDIM, given "
                        "like stiffness. Black is left out: no lines are traced there, and with "
                        "settings.scan.fill grown skin fills in",
                    },
                    "shapes": {
                        **BINARY,
                        "description": "expressions that lines grow by: .npz with shapes "
                        "(E, V, 3), positions, and names (E,), or with frames (N, V, 3); or .npy "
                        f"(E, V, 3), by filename. Of more than {MOST_EXPRESSIONS}, that many are "
                        "picked evenly. "
                        "Absent: shapes, frames or morph targets of the mesh file. Named ones are "
                        "kept, for the weights of live connections",
                    },
                    **{name: _control(name) for name in CONTROLS},
                },
            },
            "encoding": {"settings": {"contentType": "application/json"}},
        }
    }
)
_SNAPSHOT = {"schema": {**BINARY, "description": "a file of `getSnapshot`, as it is"}}
SNAPSHOT = body({TAR: _SNAPSHOT, OCTETS: _SNAPSHOT})
EVENTS: Responses = {
    200: {
        "description": "Server-sent events until the job ends: `progress`, then one `end`; the "
        "data of each is a Job as JSON",
        # No schema: tools disagree whether it is of the stream or of an event.
        "content": {EVENT_STREAM: {}},
    }
}
TILES: Responses = {
    200: {
        **binary(*(kind.media_type for kind in FORMATS.values()))[200],
        "headers": {
            "ETag": {
                "schema": {"type": "string"},
                "description": "strong entity tag",
            },
            "X-Rhytid-Scale": {
                "schema": {"type": "number"},
                "description": "png only: h = (p − 32768)/32767 · scale",
            },
        },
    },
    **UNCHANGED,
}
TILES_ONCE: Responses = {
    200: {
        **binary("multipart/mixed")[200],
        "headers": {
            WARNINGS: {
                "schema": {"type": "string"},
                "description": "JSON list of warnings (code, detail, where), ASCII; absent where "
                "there are none",
            },
        },
    },
}


def describe(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI document, with problems in place of the framework's own error models."""
    if app.openapi_schema is None:
        document = get_openapi(
            # Generators name a package after it; that of the SDK is rhytid_client.
            title="rhytid HTTP",
            version=__version__,
            summary="Dynamic facial wrinkles: an animated face in, displacement tiles out.",
            routes=app.routes,
            tags=TAGS,
        )
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        place = "#/components/schemas/{model}"
        schemas["Problem"] = Problem.model_json_schema(ref_template=place)
        schemas.update(schemas["Problem"].pop("$defs", {}))
        schemas.update(SETTINGS)
        schemas["Asset"]["properties"]["settings"] = reference(
            "AssetSettings", "all of them, resolved once the asset is ready"
        )
        _document_access(document)
        app.openapi_schema = document
    return app.openapi_schema


def _document_access(document: dict[str, Any]) -> None:
    """Add to every call of a document the scope that it needs and the statuses by which it may be
    refused."""
    document["components"]["securitySchemes"] = {SCHEME: KEY}
    for path, calls in document["paths"].items():
        for method, call in calls.items():
            scope = ROUTES[f"{method.upper()} {path}"]
            if scope != OPEN:
                call["security"] = [{SCHEME: [scope]}]
            for status in refusals(path, scope, sends="requestBody" in call):
                described = {"description": HTTPStatus(status).phrase, "content": _PROBLEM}
                call["responses"].setdefault(str(status), described)
            call["responses"] = dict(sorted(call["responses"].items()))


def refusals(path: str, scope: str, *, sends: bool) -> list[int]:
    """Return the statuses of refusals that come before a route runs.  sends: whether the call takes
    a body."""
    keys = [] if scope == OPEN else [401]
    return [400, *keys, 403, *([415] if sends else []), *([] if path == ALIVE else [429])]
