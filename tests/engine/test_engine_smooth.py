"""Smooth sampling through the engine: the laws that hold bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from engine.engines import REDRAW, assembled, same
from rhytid.domain.tiles import TileAddress
from rhytid.engine.messages import STRETCH_MODELS, MapQuery

METHODS = ("redraw", "binned", "convolved")
QUERIES = [MapQuery(m, stretch, "smooth") for m in METHODS for stretch in STRETCH_MODELS]


def ids(query):
    return f"{query.method}-{query.stretch}"


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_the_neutral_frame_is_the_neutral_of_any_sampling(made, query):
    plain = MapQuery(query.method)
    for udim in (1001, 1012):
        found, wanted = (made.engine.map(made.asset, "neutral", q, udim, 0) for q in (query, plain))
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("stretch", STRETCH_MODELS)
def test_the_method_neutral_is_neutral_in_every_frame(made, stretch):
    query = MapQuery("neutral", stretch, "smooth")
    wanted = made.engine.map(made.asset, "neutral", REDRAW, 1001, 0)
    assert same([made.engine.map(made.asset, "bent", query, 1001, 0)], [wanted])


@pytest.mark.parametrize("query", QUERIES, ids=ids)
@pytest.mark.parametrize("level", range(9))
def test_tiles_put_together_are_the_map(made, query, level):
    whole = made.engine.map(made.asset, "bent", query, 1012, level)
    assert np.isfinite(whole).all()
    assert same([whole], [assembled(made.engine, made.asset, "bent", query, 1012, level)])


@pytest.mark.parametrize("query", QUERIES, ids=ids)
def test_it_is_near_nearest_and_not_the_same(made, query):
    depth = np.abs(made.engine.map(made.asset, "neutral", REDRAW, 1001, 0)).max()
    found = made.engine.map(made.asset, "bent", query, 1001, 0)
    nearest = made.engine.map(made.asset, "bent", MapQuery(query.method, query.stretch), 1001, 0)
    assert 0 < np.sqrt(np.mean((found - nearest) ** 2)) < 0.05 * depth


def test_samplings_have_keys_of_their_own(made):
    address = TileAddress(1001, 0, 1, 1)
    keys = {made.engine.tile_key(made.asset, "bent", q, address) for q in (*QUERIES, REDRAW)}
    assert len(keys) == len(QUERIES) + 1
