"""Tiles and maps over HTTP: formats, ETags, HEAD, many at once; and what is refused."""

from __future__ import annotations

from email import message_from_bytes
from email.policy import HTTP
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi import routing

from api.asking import NPY, array_of, is_problem, npy
from api.fake_engine import FakeEngine
from api.fake_frames import FakeFrames
from api.fake_tiles import FakeTiles
from api.live import serving
from api.patch import smile, upload
from rhytid.api.dependencies import drawing_of, drawn_positions_of, no_repeats
from rhytid.api.quick_route import TileRoute, TilesRoute
from rhytid.api.routes.tiles import tile_router, tiles_router
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery

TILE = "tiles/1001/1/1/0"
# Headers that are another's in every answer.
_OWN = {"date", "x-request-id"}


def told(response: httpx.Response) -> tuple[int, dict[str, str], bytes | dict[str, Any]]:
    """An answer without what differs from request to request."""
    headers = {name: text for name, text in response.headers.items() if name not in _OWN}
    if response.is_error:
        headers.pop("content-length")
        problem = response.json()
        return response.status_code, headers, {**problem, "instance": "", "request_id": ""}
    return response.status_code, headers, response.content


def test_a_tile_is_the_crop_of_the_map(client: httpx.Client, frame: str) -> None:
    whole = array_of(client.get(f"{frame}/maps/1001"))
    assert (whole.shape, whole.dtype) == ((256, 256), np.float32)
    tile = array_of(client.get(f"{frame}/tiles/1001/0/2/1"))
    np.testing.assert_array_equal(tile, whole[128:192, 64:128])
    coarse = array_of(client.get(f"{frame}/maps/1001", params={"level": 8}))
    assert coarse.shape == (1, 1)


@pytest.mark.parametrize(
    ("format", "media_type", "start"),
    [
        ("npy", "application/x-npy", b"\x93NUMPY"),
        ("f16", "application/octet-stream", b""),
        ("exr", "image/x-exr", b"\x76\x2f\x31\x01"),
        ("exr16", "image/x-exr", b"\x76\x2f\x31\x01"),
        ("png", "image/png", b"\x89PNG"),
    ],
)
def test_formats(
    client: httpx.Client, frame: str, format: str, media_type: str, start: bytes
) -> None:
    response = client.get(f"{frame}/{TILE}", params={"format": format})
    assert response.status_code == 200
    assert response.headers["content-type"] == media_type
    assert response.content.startswith(start)
    assert ("x-rhytid-scale" in response.headers) == (format == "png")


def test_f16_is_the_tile_in_half(client: httpx.Client, frame: str) -> None:
    tile = array_of(client.get(f"{frame}/{TILE}"))
    half = client.get(f"{frame}/{TILE}", params={"format": "f16"}).content
    np.testing.assert_array_equal(np.frombuffer(half, "<f2").reshape(64, 64), tile.astype("<f2"))


@pytest.mark.parametrize("call", [TILE, "maps/1001"])
def test_a_known_tile_is_not_drawn_again(
    client: httpx.Client, engine: Any, frame: str, call: str
) -> None:
    first = client.get(f"{frame}/{call}")
    tag = first.headers["etag"]
    assert tag.startswith('"')
    drawn = len(getattr(engine, "drawn", []))
    for known in (tag, f'W/{tag}, "else"', "*"):
        response = client.get(f"{frame}/{call}", headers={"If-None-Match": known})
        assert (response.status_code, response.content) == (304, b"")
        assert response.headers["etag"] == tag
    assert len(getattr(engine, "drawn", [])) == drawn
    other = client.get(f"{frame}/{call}", headers={"If-None-Match": '"else"'})
    assert (other.status_code, other.headers["etag"]) == (200, tag)


def test_a_tag_names_frame_query_and_format(client: httpx.Client, frame: str) -> None:
    def tag(**query: str) -> str:
        return client.get(f"{frame}/{TILE}", params=query).headers["etag"]

    tags = [tag(), tag(format="f16"), tag(format="png"), tag(method="neutral")]
    client.put(frame, content=npy(smile(0.2)), headers=NPY)
    assert len({*tags, tag()}) == 5
    client.put(frame, content=npy(smile()), headers=NPY)
    assert tag() == tags[0]


@pytest.mark.parametrize("call", [TILE, "maps/1001"])
@pytest.mark.parametrize("method", ["redraw", "binned"])
def test_every_stretch_model_answers_under_a_tag_of_its_own(
    client: httpx.Client, frame: str, call: str, method: str
) -> None:
    tags = set()
    for model in ("tensor", "tension", "uv"):
        response = client.get(f"{frame}/{call}", params={"method": method, "stretch": model})
        assert np.isfinite(array_of(response)).all()
        tags.add(response.headers["etag"])
    assert len(tags) == 3


class RacingTiles(FakeTiles):
    """Another client replaces the frame whenever a tile is drawn."""

    def tile(self, asset: str, frame: str, query: MapQuery, address: TileAddress) -> Any:
        drawn = super().tile(asset, frame, query, address)
        FakeFrames(self.state).put(asset, frame, smile(0.01 * len(self.state.drawn)))
        return drawn


class RacingEngine(FakeEngine):
    """Draws `RacingTiles`."""

    def __init__(self) -> None:
        super().__init__()
        self.tiles = RacingTiles(self.state)


def test_a_tile_whose_frame_was_replaced_meanwhile_has_no_tag() -> None:
    with serving(RacingEngine()) as client:
        path = f"/v1/assets/{client.post('/v1/assets', files=upload()).json()['id']}/frames/live"
        client.put(path, content=npy(smile(0.5)), headers=NPY)
        response = client.get(f"{path}/{TILE}")
        assert response.status_code == 200
        assert "etag" not in response.headers
        assert response.headers["cache-control"] == "no-store"


def test_head_says_what_get_would(client: httpx.Client, engine: Any, frame: str) -> None:
    drawn = len(getattr(engine, "drawn", []))
    head = client.head(f"{frame}/{TILE}", params={"format": "png"})
    assert (head.status_code, head.content) == (200, b"")
    assert len(getattr(engine, "drawn", [])) == drawn
    get = client.get(f"{frame}/{TILE}", params={"format": "png"})
    for name in ("etag", "content-type", "x-rhytid-scale", "cache-control"):
        assert head.headers[name] == get.headers[name]
    assert "content-length" not in head.headers


def parts_of(response: httpx.Response) -> list[Any]:
    assert response.status_code == 200, response.text
    header = f"Content-Type: {response.headers['content-type']}\r\n\r\n".encode()
    message = message_from_bytes(header + response.content, policy=HTTP)
    assert message.get_content_type() == "multipart/mixed"
    return list(message.iter_parts())


def test_many_tiles_come_in_the_order_asked(client: httpx.Client, asset: str, frame: str) -> None:
    wanted = ["1001/0/3/3", "1001/8/0/0", "1001/1/0/1", "1001/0/3/3"]
    query = {"tile": wanted, "format": "f16", "method": "redraw"}
    response = client.post(
        f"/v1/assets/{asset}/tiles", params=query, content=npy(smile()), headers=NPY
    )
    parts = parts_of(response)
    assert [p["X-Rhytid-Tile"] for p in parts] == wanted
    assert parts[1].get_filename().startswith("1001.8.0.0.")
    for part, at in zip(parts, wanted, strict=True):
        body = part.get_payload(decode=True)
        assert int(part["Content-Length"]) == len(body)
        assert body == client.get(f"{frame}/tiles/{at}", params={"format": "f16"}).content


def test_many_png_tiles_carry_their_scale(client: httpx.Client, asset: str) -> None:
    response = client.post(
        f"/v1/assets/{asset}/tiles",
        params={"tile": "1001/0/0/0", "format": "png"},
        content=npy(smile()),
        headers=NPY,
    )
    (part,) = parts_of(response)
    assert float(part["X-Rhytid-Scale"]) > 0


BAD_QUERIES = {
    "unknown method": ("?method=magic", "query", "magic"),
    "unknown stretch": ("?stretch=magic", "query", "magic"),
    "unknown sampling": ("?sampling=magic", "query", "magic"),
    "unknown format": ("?format=tiff", "query", "tiff"),
    "unknown layer": ("?layer=magic", "query", "magic"),
    "no format of slopes": ("?layer=slopes&format=png", "query", "of the layer slopes: one of npy"),
    "unknown parameter": ("?methd=redraw", "query", "unknown query parameter methd"),
    "sent twice": ("?format=npy&format=png", "query", "'format' was sent more than once"),
}


@pytest.mark.parametrize(("query", "kind", "what"), BAD_QUERIES.values(), ids=BAD_QUERIES.keys())
@pytest.mark.parametrize("call", [TILE, "maps/1001"])
def test_bad_queries_are_refused(
    client: httpx.Client, frame: str, call: str, query: str, kind: str, what: str
) -> None:
    assert what in is_problem(client.get(f"{frame}/{call}{query}"), 422, kind)


@pytest.mark.parametrize(
    ("call", "what"),
    [
        ("tiles/1001/abc/0/0", "path parameter level is 'abc'"),
        ("tiles/1001/0/-1/0", "path parameter row is '-1'"),
        ("tiles/1001/0/0/99999999999", "path parameter column"),
        ("maps/1001?level=abc", "query parameter level is 'abc'"),
        ("maps/1001?level=-1", "query parameter level"),
        ("maps/1001?row=0", "unknown query parameter row"),
    ],
)
def test_wrong_types_are_named(client: httpx.Client, frame: str, call: str, what: str) -> None:
    assert what in is_problem(client.get(f"{frame}/{call}"), 422, "query")


@pytest.mark.parametrize(
    ("call", "what"),
    [
        ("tiles/1002/0/0/0", "1002"),
        ("tiles/1001/9/0/0", "level 9"),
        ("tiles/1001/0/4/0", "row 4"),
        ("tiles/1001/2/0/1", "column 1"),
        ("maps/1011", "1011"),
        ("maps/1001?level=9", "level 9"),
    ],
)
def test_what_does_not_exist_is_404(client: httpx.Client, frame: str, call: str, what: str) -> None:
    assert what in is_problem(client.get(f"{frame}/{call}"), 404, "not-found")


def test_an_unknown_frame_is_404(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/frames/nobody/{TILE}"
    assert "nobody" in is_problem(client.get(path), 404, "not-found")
    assert client.head(path).status_code == 404


@pytest.mark.parametrize(
    ("query", "status", "kind", "what"),
    [
        ("", 422, "query", "tile is missing"),
        ("?tile=1001/0/0", 422, "query", "'1001/0/0'"),
        ("?tile=1001/0/0/0&tile=1001/0/9/0", 404, "not-found", "row 9"),
        ("?tile=1001/0/0/0&format=gif", 422, "query", "gif"),
        ("?tile=1001/0/0/0&frame=a", 422, "query", "unknown query parameter frame"),
    ],
)
def test_bad_lists_of_tiles_are_refused(
    client: httpx.Client, asset: str, query: str, status: int, kind: str | None, what: str
) -> None:
    path = f"/v1/assets/{asset}/tiles{query}"
    response = client.post(path, content=npy(smile()), headers=NPY)
    assert what in is_problem(response, status, kind)


def test_bad_positions_of_many_tiles_are_refused(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/tiles?tile=1001/0/0/0"
    sent = client.post(path, content=npy(smile()[:3]), headers=NPY)
    assert "25" in is_problem(sent, 422, "frame")


def test_more_texels_than_a_map_are_refused(
    client: httpx.Client, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rhytid.api.routes.tiles.TEXELS", 2 * 64**2)
    query = {"tile": ["1001/0/0/0"] * 3}
    path = f"/v1/assets/{asset}/tiles"
    sent = client.post(path, params=query, content=npy(smile()), headers=NPY)
    assert "12288 texels: at most 8192" in is_problem(sent, 413, "limit")


@pytest.mark.parametrize(
    ("query", "usual"),
    [
        ("", False),
        ("?method=neutral&format=f16", False),
        ("?method=guess", False),
        ("?else=1", True),
        ("?format=npy&format=npy", True),
        ("?level=0", True),
    ],
)
def test_what_is_plainly_right_takes_the_quick_way(
    query: str, usual: bool, client: httpx.Client, frame: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    solve = routing.solve_dependencies

    async def counted(**named: Any) -> Any:
        asked.append(named["request"].url.path)
        return await solve(**named)

    monkeypatch.setattr(routing, "solve_dependencies", counted)
    client.get(f"{frame}/tiles/1001/0/2/1{query}")
    assert bool(asked) == usual

    asked.clear()
    long = client.get(f"{frame}/tiles/1001/0/0000000002/1{query}")
    assert len(asked) == 1
    quick = client.get(f"{frame}/tiles/1001/0/2/1{query}")
    assert told(long) == told(quick)
    for more in ({"If-None-Match": quick.headers.get("etag", "")}, {"If-None-Match": '"other"'}):
        again, other = (
            client.get(f"{frame}/tiles/1001/0/{row}/1{query}", headers=more)
            for row in ("2", "0000000002")
        )
        assert told(again) == told(other)


def test_the_quick_way_is_not_by_the_handler_of_fastapi(
    client: httpx.Client, frame: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    handled, usual = [], routing.APIRoute.handle

    async def counted(self: routing.APIRoute, *given: Any) -> None:
        handled.append(self.path)
        await usual(self, *given)

    monkeypatch.setattr(routing.APIRoute, "handle", counted)
    assert client.get(f"{frame}/{TILE}").status_code == 200
    refused = client.get(f"{frame}/{TILE}", params={"method": "magic"})
    assert "magic" in is_problem(refused, 422, "query")
    assert not handled
    assert client.delete(f"{frame}/{TILE}").status_code == 405


def test_the_quick_way_has_all_that_the_route_depends_on() -> None:
    """A dependency that is added to the route has to be added to `TileRoute` or `TilesRoute`,
    too; the guard is one of the whole app."""
    assert len(tile_router.routes) == 2
    for route in tile_router.routes:
        assert isinstance(route, TileRoute)
        found = [one.call for one in route.dependant.dependencies]
        assert found == [no_repeats, drawing_of]
    (route,) = tiles_router.routes
    assert isinstance(route, TilesRoute)
    found = [one.call for one in route.dependant.dependencies]
    assert found == [no_repeats, drawing_of, drawn_positions_of]


@pytest.mark.parametrize(
    ("query", "usual"),
    [
        ("?tile=1001/0/0/0", False),
        ("?tile=1001/0/0/0&tile=1001/0/0/1&method=neutral&strict=false&allow=size", False),
        ("?tile=1001/0/0&method=guess", False),
        ("", True),
        ("?tile=1001/0/0/0&strict=maybe", True),
        ("?tile=1001/0/0/0&else=1", True),
        ("?tile=1001/0/0/0&format=npy&format=npy", True),
    ],
)
def test_tiles_of_positions_are_plainly_asked_for(
    query: str, usual: bool, client: httpx.Client, asset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    handled, handle = [], routing.APIRoute.handle

    async def counted(self: routing.APIRoute, *given: Any) -> None:
        handled.append(self.path)
        await handle(self, *given)

    def sent() -> tuple[int, object]:
        path = f"/v1/assets/{asset}/tiles{query}"
        found = client.post(path, content=npy(smile()), headers=NPY)
        if found.is_error:
            return told(found)[0], told(found)[2]
        mark = found.headers["content-type"].partition("boundary=")[2].encode()
        return found.status_code, found.content.replace(mark, b"")

    monkeypatch.setattr(routing.APIRoute, "handle", counted)
    quick = sent()
    assert bool(handled) == usual
    monkeypatch.setattr(TilesRoute, "handle", handle)
    assert sent() == quick


@pytest.mark.parametrize("place", ["x/0/0/0", "1001/0/-1/0", "1001/0/0/3000000000", "1001/0/0/²"])
def test_a_place_that_is_no_number_is_refused_in_the_usual_way(
    place: str, client: httpx.Client, frame: str
) -> None:
    assert client.get(f"{frame}/tiles/{place}").status_code == 422
