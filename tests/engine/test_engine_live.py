"""A live connection over a real engine: the tiles of a call, bit for bit; shapes over a restart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from api.live import serving
from engine.engines import built, new_asset, running
from pipeline.scenes import sheet
from rhytid.domain.expressions import Expressions
from rhytid.domain.tiles import TileAddress
from rhytid.engine.frames import Frame
from rhytid.engine.messages import MapQuery
from rhytid_client import Client

TILES = [TileAddress(1001, 0, 1, 2), TileAddress(1001, 0, 2, 1), TileAddress(1001, 2, 0, 0)]


def test_weights_become_the_tiles_of_their_positions(tmp_path: Path) -> None:
    mesh = sheet()
    stretched = (1.25, 1.0, 1.0), (1.0, 0.75, 1.0)
    shapes = np.stack([mesh.positions * np.float32(factor) for factor in stretched])
    named = Expressions.checked(shapes, len(mesh.positions), ["mouthSmile_L", "browInnerUp"])
    with running(tmp_path) as engine:
        asset = built(engine, replace(new_asset(mesh), shapes=named))
    half = mesh.positions + 0.5 * (shapes[0].astype(float) - mesh.positions)
    wanted = [(at.udim, at.level, at.row, at.column) for at in TILES]
    with running(tmp_path) as engine, serving(engine) as http:
        client = Client(str(http.base_url))
        names = ["tongueOut", "mouthSmileLeft"]
        with client, client.live(asset, tiles=wanted, method="binned", shapes=names) as live:
            assert live.asset.unknown == ("tongueOut",)
            live.send(weights=[1.0, 0.5])
            found = {tile.address: tile.array for tile in live.receive()}
        frame = Frame.of(half.astype(np.float32))
        for address, at in zip(wanted, TILES, strict=True):
            drawn = engine.tiles.draw(asset, frame, MapQuery("binned"), at).tile
            assert drawn.any()
            assert found[address].tobytes() == drawn.tobytes()
        assert [frame.name for frame in engine.frames.all(asset)] == ["neutral"]
        # The same upload without shapes keeps them, another set takes their place.
        engine.assets.create(new_asset(mesh))
        assert engine.assets.shapes(asset).names == named.names
        other = Expressions.checked(shapes[:1], len(mesh.positions), ["jawOpen"])
        engine.assets.create(replace(new_asset(mesh), shapes=other))
        assert engine.assets.shapes(asset).names == ("jawOpen",)
