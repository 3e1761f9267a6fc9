"""Smooth sampling through the engine: the laws that hold bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from engine.engines import REDRAW, assembled, built, new_asset, running, same
from meshes import deform
from pipeline.scenes import sheet
from rhytid.domain.mesh import Mesh
from rhytid.domain.methods import SAMPLINGS, STRETCH_MODELS
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import MapQuery

METHODS = ("redraw", "binned", "convolved")
QUERIES = [MapQuery(m, stretch, "smooth") for m in METHODS for stretch in STRETCH_MODELS]


def ids(query):
    return f"{query.method}-{query.stretch}"


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_the_neutral_frame_is_the_neutral_of_any_sampling(made, query):
    plain = MapQuery(query.method)
    for udim in (1001, 1012):
        found, wanted = (
            made.engine.tiles.plan_map(made.asset, "neutral", q, udim, 0).draw()
            for q in (query, plain)
        )
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("stretch", STRETCH_MODELS)
def test_the_method_neutral_is_neutral_in_every_frame(made, stretch):
    query = MapQuery("neutral", stretch, "smooth")
    wanted = made.engine.tiles.plan_map(made.asset, "neutral", REDRAW, 1001, 0).draw()
    assert same([made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0).draw()], [wanted])


@pytest.mark.parametrize("query", QUERIES, ids=ids)
@pytest.mark.parametrize("level", range(9))
def test_tiles_put_together_are_the_map(made, query, level):
    whole = made.engine.tiles.plan_map(made.asset, "bent", query, 1012, level).draw()
    assert np.isfinite(whole).all()
    assert same([whole], [assembled(made.engine, made.asset, "bent", query, 1012, level)])


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_it_is_near_nearest_and_not_the_same(made, query):
    depth = np.abs(made.engine.tiles.plan_map(made.asset, "neutral", REDRAW, 1001, 0).draw()).max()
    found = made.engine.tiles.plan_map(made.asset, "bent", query, 1001, 0).draw()
    nearest = made.engine.tiles.plan_map(
        made.asset, "bent", MapQuery(query.method, query.stretch), 1001, 0
    ).draw()
    assert 0 < np.sqrt(np.mean((found - nearest) ** 2)) < 0.05 * depth


def test_samplings_have_keys_of_their_own(made):
    address = TileAddress(1001, 0, 1, 1)
    keys = {made.engine.tiles.plan(made.asset, "bent", q, address).key for q in (*QUERIES, REDRAW)}
    assert len(keys) == len(QUERIES) + 1


def pinched():
    """A sheet with one vertex nearly on another: smooth sampling finds no |J ŝ| as small as that of
    the triangles between them."""
    mesh = sheet()
    positions = mesh.positions.copy()
    one, other = mesh.faces[75, :2]
    positions[one] += np.float32(0.97) * (positions[other] - positions[one])
    return Mesh(positions, mesh.faces, mesh.uv, mesh.face_uv)


def test_samplings_do_not_share_the_neutral_tile_that_is_convolved(tmp_path):
    # What is kept around a tile goes by the sampling: what the other reads may lie beyond.
    mesh, address = pinched(), TileAddress(1001, 0, 1, 1)
    tiles = []
    for order in (SAMPLINGS, SAMPLINGS[::-1]):
        with running(tmp_path / order[0]) as engine:
            asset = built(engine, new_asset(mesh, convolve={"sigma": 0.02}))
            base = engine._on_device.loaded(engine.assets._assets.get(asset)).mesh
            aprons = [
                maker.apron(base.settings, 1001, 64, 64, 64)
                for maker in (base.convolve, base.smooth_convolve)
            ]
            assert aprons[0] > aprons[1]
            engine.frames.put(asset, "bent", deform(mesh.positions, 3, 0.15))
            queries = {sampling: MapQuery("convolved", sampling=sampling) for sampling in order}
            found = {
                s: engine.tiles.plan(asset, "bent", query, address).draw()
                for s, query in queries.items()
            }
            tiles.append([found[sampling] for sampling in SAMPLINGS])
    assert same(*tiles)
