"""Displacement: tiles, whole maps, and the precomputed maps of the fast method."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike, NDArray

from rhytid_client import npy, parse
from rhytid_client.calls.asset_calls import asset_id, strictly
from rhytid_client.choices import Layer, Method, Sampling, StretchModel, TileFormat
from rhytid_client.errors import BadAnswer
from rhytid_client.exchange import Flow
from rhytid_client.multipart_mixed import boundary_of, read_mixed
from rhytid_client.requests import Request, get, with_positions
from rhytid_client.results import Asset, Bins
from rhytid_client.tiles import Tile
from rhytid_client.warned import tell

# udim, level, row, column
Address = tuple[int, int, int, int]


def tile(
    asset: Asset | str,
    frame: str,
    udim: int,
    level: int,
    row: int,
    column: int,
    *,
    method: Method = "redraw",
    stretch: StretchModel = "tensor",
    sampling: Sampling = "nearest",
    layer: Layer = "displacement",
    format: TileFormat = "npy",
    if_none_match: Tile | None = None,
) -> Flow[Tile]:
    """One tile of displacement, in mesh units; row 0 is at the top.

    method: neutral, redraw, binned or convolved.  format: npy (float32), f16, exr, exr16 or png.
    stretch: how it is measured: tensor, tension (mesh tension, one value for all directions) or uv
    (along u and v).  layer: slopes: in place of displacement the moments of slopes (n, n, 5), mean
    slope along tangent and bitangent and the means of xx, xy and yy; npy and exr alone.
    if_none_match: a tile had before: it is returned itself where it has not changed.
    """
    query = _query(method, stretch, sampling, layer, format)
    place = ("v1", "assets", asset_id(asset), "frames", frame, "tiles", udim, level, row, column)
    wanted = get(*place, params=query, headers=_known(if_none_match))
    label = f"{udim}.{frame}.{level}.{row}.{column}"
    return (yield from _drawn(wanted, if_none_match, format, label))


def map(
    asset: Asset | str,
    frame: str,
    udim: int,
    *,
    level: int = 0,
    method: Method = "redraw",
    stretch: StretchModel = "tensor",
    sampling: Sampling = "nearest",
    layer: Layer = "displacement",
    format: TileFormat = "npy",
    if_none_match: Tile | None = None,
) -> Flow[Tile]:
    """The whole map of one UDIM at a level; it equals its tiles bit for bit.

    method, stretch, sampling, layer, format, if_none_match: as for a tile.
    """
    query = _query(method, stretch, sampling, layer, format)
    place = ("v1", "assets", asset_id(asset), "frames", frame, "maps", udim)
    wanted = get(*place, params={"level": level, **query}, headers=_known(if_none_match))
    label = f"{udim}.{frame}.{level}" if level else f"{udim}.{frame}"
    return (yield from _drawn(wanted, if_none_match, format, label))


def tiles(
    asset: Asset | str,
    positions: ArrayLike,
    addresses: Iterable[Address],
    *,
    method: Method = "redraw",
    stretch: StretchModel = "tensor",
    sampling: Sampling = "nearest",
    layer: Layer = "displacement",
    format: TileFormat = "npy",
    strict: bool = False,
    allow: str | Iterable[str] = (),
) -> Flow[list[Tile]]:
    """Positions (V, 3) in, tiles out in the order of `addresses`, in one round trip.

    An address is (udim, level, row, column). Nothing is stored.
    method, stretch, sampling, layer, format: as for a tile.
    strict: RequestError, and nothing is drawn, where there would be `warnings`; allow: but for
    those of these codes.
    """
    names = ["/".join(str(number) for number in address) for address in addresses]
    query = _query(method, stretch, sampling, layer, format)
    params = (*(("tile", name) for name in names), *query.items(), *strictly(strict, allow))
    place = ("v1", "assets", asset_id(asset), "tiles")
    response = yield with_positions("POST", *place, positions=positions, params=params)
    body = parse.content(response)
    parts = read_mixed(body, boundary_of(response.headers.get("content-type", "")))
    answered = [part.headers.get("x-rhytid-tile") for part in parts]
    if answered != names:
        raise BadAnswer(f"asked for tiles {names}, answered with {answered}")
    warned = parse.header_warnings(response)
    tell(warned)
    drawn = [parse.read_tile(part.content, part.headers, format) for part in parts]
    labels = [name.replace("/", ".") for name in names]
    return [replace(t, warnings=warned, label=n) for t, n in zip(drawn, labels, strict=True)]


def bins(asset: Asset | str) -> Flow[Bins]:
    """The precomputed maps of an asset: angles, samples, steps and layers."""
    return parse.one(Bins, (yield get("v1", "assets", asset_id(asset), "bins")))


def bin_tile(
    asset: Asset | str,
    udim: int,
    level: int,
    row: int,
    column: int,
    *,
    bin: int | None = None,
    sample: int | None = None,
    layer: str = "wrinkles",
) -> Flow[NDArray[Any]]:
    """One tile of quantised codes, int8 or int16; the manifest's step turns them into heights.
    Owners of cushions are int32, rows of the graph.

    layer: one of the manifest's: wrinkles, pores, for a mellow merge wrinkle_bulges and
    pore_bulges, with tilts wrinkle_tilts; of the cushions, coarse and with an apron,
    cushions, cushion_places and cushion_owners; grain.  bin, sample: needed where the layer has
    more than one: grain, places and owners have one of both, pores and cushions one bin,
    wrinkle_tilts one sample.
    """
    place = ("v1", "assets", asset_id(asset), "bins", udim, level, row, column)
    given = {"bin": bin, "sample": sample, "layer": layer}
    query = {name: value for name, value in given.items() if value is not None}
    return npy.decode(parse.content((yield get(*place, params=query))))


def _query(method: str, stretch: str, sampling: str, layer: str, format: str) -> dict[str, str]:
    """The query of a tile or a map. Servers without layers are not told of the usual one."""
    query = {"method": method, "stretch": stretch, "sampling": sampling, "format": format}
    return {**query, **({} if layer == "displacement" else {"layer": layer})}


def _known(tile: Tile | None) -> dict[str, str]:
    return {"If-None-Match": tile.etag} if tile is not None and tile.etag else {}


def _drawn(wanted: Request, known: Tile | None, format: TileFormat, label: str) -> Flow[Tile]:
    response = yield wanted
    if response.status == 304 and known is not None:
        return known
    return replace(parse.tile(response, format), label=label)
