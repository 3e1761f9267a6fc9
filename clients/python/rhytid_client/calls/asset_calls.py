"""Assets: a neutral mesh with its wrinkle graph and settings."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rhytid_client import npy, parse
from rhytid_client.choices import GraphFormat, MeshFormat
from rhytid_client.exchange import Flow
from rhytid_client.from_trimesh import TrimeshLike, arrays
from rhytid_client.multipart_form import Form, Part
from rhytid_client.requests import Params, get, request, with_json
from rhytid_client.results import Asset
from rhytid_client.warned import tell

File = str | os.PathLike[str] | bytes
# One image, some with the UDIM in their names, or images by UDIM.
Images = File | Sequence[File] | Mapping[int, File]
_EXR = b"\x76\x2f\x31\x01"


def asset_id(asset: Asset | str) -> str:
    """The id of an asset given as itself or as its id."""
    return asset.id if isinstance(asset, Asset) else asset


def strictly(strict: bool, allow: str | Iterable[str]) -> Params:
    """The query of a call that may be strict, but for warnings of some codes."""
    codes = (allow,) if isinstance(allow, str) else allow
    return (*((("strict", "true"),) if strict else ()), *(("allow", code) for code in codes))


def create_asset(
    mesh: File | Mapping[str, ArrayLike] | TrimeshLike,
    *,
    name: str | None = None,
    settings: Mapping[str, Any] | None = None,
    graph: File | None = None,
    force: bool = False,
    stiffness: Images | None = None,
    controls: Mapping[str, Images] | None = None,
    progress: Callable[[int, int], None] | None = None,
    strict: bool = False,
    allow: str | Iterable[str] = (),
    shapes: File | ArrayLike | Mapping[str, ArrayLike] | None = None,
    scan: Images | None = None,
    scan_settings: Mapping[str, Any] | None = None,
    scan_mask: Images | None = None,
) -> Flow[Asset]:
    """Send a mesh and have an asset built of it; `wait` for it before asking for tiles.

    mesh: the path of an OBJ, PLY, glTF, GLB or npz file; or the bytes of one, with a `name` whose
    extension gives the format; or the arrays positions (V, 3), faces (F, 3), uv (T, 2),
    face_uv (F, 3) and optionally frames (N, V, 3); or a `trimesh.Trimesh` with UV, whose vertices
    stay in the order that they have: load it with `process=False`, and take frames from meshes that
    are loaded alike, for trimesh splits and reorders those of an OBJ at seams.
    graph: safetensors, absent to synthesise one.
    force: take the graph even where it was made for another mesh.
    stiffness: grey PNG or EXR images by UDIM; or paths whose names end on the UDIM, as in
    skin.1002.png; or one image for a mesh of one UDIM. 1 moves freely, 0 is rigid. At most
    8192 texels per side and 134,217,728 in all.
    controls: maps that guide synthesis, by name, given like stiffness: density, strength,
    direction, turn, anisotropy, scale, pore_radius, events, and region_forehead and the like.
    shapes: expressions that lines grow by: positions (E, V, 3), or a mapping of names to positions
    (V, 3), or a .npy or .npz file; absent, those of the mesh file count, or its frames.
    scan: displacement along the normal, scanned or sculpted, as EXR, PNG, TIFF or JPEG, given like
    stiffness: its lines are traced and move, and at rest the skin is the scan.
    scan_settings: how it is read: scale (a number, or three for bands; codes need one), unit,
    midlevel (a number or "auto"), flip ("v", "u", "uv"), partial (UDIMs may have no map), detail
    (grain where the scan ends, 0 to 1), fill (width of the border of grown skin that fills in).
    scan_mask: where the scan counts, given like stiffness; black is left out.
    progress: called with bytes sent and bytes in all.
    strict: RequestError, and nothing is kept, where there would be `warnings`; allow: but for those
    of these codes.

    The asset is named after the file; `name` names other meshes, and the setting `name` any.
    The same content gives the same asset. Raises RequestError naming what is wrong with it,
    ValueError for a Trimesh without UV, TypeError for something else of trimesh.
    """
    parts = [_mesh(mesh, name)]
    if scan_settings is not None:
        settings = {**(settings or {}), "scan": dict(scan_settings)}
    if settings is not None:
        text = json.dumps(dict(settings), allow_nan=False).encode()
        parts.append(Part("settings", text, "application/json"))
    if graph is not None:
        parts.append(_file("graph", graph, None))
    if force:
        parts.append(Part("force", b"true", "text/plain"))
    parts += _images("stiffness", stiffness)
    parts += _images("scan", scan)
    parts += _images("scan_mask", scan_mask)
    for control, images in (controls or {}).items():
        parts += _images(control, images)
    if shapes is not None:
        parts.append(_shapes(shapes))
    form = Form(tuple(parts), progress)
    response = yield request("POST", "v1", "assets", params=strictly(strict, allow), content=form)
    made = parse.one(Asset, response)
    tell(made.warnings)
    return made


def assets() -> Flow[list[Asset]]:
    """Every asset of the server."""
    return parse.many(Asset, (yield get("v1", "assets")))


def asset(asset: Asset | str) -> Flow[Asset]:
    """An asset as it is now."""
    return parse.one(Asset, (yield get("v1", "assets", asset_id(asset))))


def change_asset(asset: Asset | str, settings: Mapping[str, Any]) -> Flow[Asset]:
    """Change response, shape, depth, angles, preset, bins, convolve or name; nothing is
    synthesised."""
    changes = with_json("PATCH", "v1", "assets", asset_id(asset), value=dict(settings))
    return parse.one(Asset, (yield changes))


def delete_asset(asset: Asset | str, *, shared: bool = False) -> Flow[None]:
    """Remove an asset with its frames.  shared: from the store that servers share, too."""
    params = {"shared": "true"} if shared else {}
    parse.content((yield request("DELETE", "v1", "assets", asset_id(asset), params=params)))


def graph(asset: Asset | str, *, format: GraphFormat = "safetensors") -> Flow[bytes]:
    """The wrinkle graph of an asset, as a safetensors file that gives the depth, spacing and unit
    it is drawn with; or its wrinkles as lines in space, an
    `obj` or `usda` file."""
    params = {"format": format}
    return parse.content((yield get("v1", "assets", asset_id(asset), "graph", params=params)))


def mesh(asset: Asset | str, *, format: MeshFormat = "glb") -> Flow[bytes]:
    """The neutral mesh of an asset as a `glb` or `ply` file, with one uv a vertex: first the
    vertices in the order that they were sent in, then those that UV seams need beside them."""
    params = {"format": format}
    return parse.content((yield get("v1", "assets", asset_id(asset), "mesh", params=params)))


def _mesh(mesh: File | Mapping[str, ArrayLike] | TrimeshLike, name: str | None) -> Part:
    if isinstance(mesh, Mapping):
        return Part("mesh", npy.pack(mesh), filename=name or "mesh.npz")
    if not isinstance(mesh, (str, bytes, os.PathLike)):
        return Part("mesh", npy.pack(arrays(mesh)), filename=name or "mesh.npz")
    if isinstance(mesh, bytes) and name is None:
        raise ValueError("mesh bytes need a name: its extension gives their format")
    return _file("mesh", mesh, name)


def _shapes(shapes: File | ArrayLike | Mapping[str, ArrayLike]) -> Part:
    if isinstance(shapes, Mapping):
        arrays = {"shapes": np.stack([np.asarray(s) for s in shapes.values()])}
        packed = npy.pack({**arrays, "names": np.array([str(name) for name in shapes])})
        return Part("shapes", packed, filename="shapes.npz")
    if isinstance(shapes, bytes):
        archive = shapes.startswith(b"PK")
        return Part("shapes", shapes, filename="shapes.npz" if archive else "shapes.npy")
    if isinstance(shapes, (str, os.PathLike)):
        return _file("shapes", shapes, None)
    return Part("shapes", npy.encode(np.asarray(shapes)), filename="shapes.npy")


def _images(field: str, given: Images | None) -> list[Part]:
    if given is None:
        return []
    if isinstance(given, Mapping):
        return [_file(field, image, f"{udim}{_extension(image)}") for udim, image in given.items()]
    images = [given] if isinstance(given, (str, bytes, os.PathLike)) else given
    return [_file(field, image, None) for image in images]


def _extension(image: File) -> str:
    if isinstance(image, bytes):
        return ".exr" if image.startswith(_EXR) else ".png"
    return ".exr" if Path(image).suffix.lower() == ".exr" else ".png"


def _file(field: str, given: File, name: str | None) -> Part:
    if isinstance(given, bytes):
        return Part(field, given, filename=name or field)
    path = Path(given)
    return Part(field, path, filename=name or path.name)
