"""Painted synthesis in the engine: ids, restarts, and refusals before a job begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.engines import built, finish, running, settle
from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.domain.painted_maps import Controls
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError, LimitError
from rhytid.storage.asset_ids import asset_id
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore

RAMP = np.tile(np.linspace(0, 1, 8, dtype=np.float32), (8, 1))
MAPS = Controls({"density": {1001: RAMP}, "region_nose": {1001: RAMP.T}})


def asked(controls=MAPS, **graph):
    settings = settings_of(graph={"wrinkles": 400, **graph})
    return NewAsset(sheet(), settings, controls=controls)


def graph_bytes(engine, asset):
    return {name: array.tobytes() for name, array in engine.assets.graph(asset).arrays().items()}


@pytest.mark.slow
def test_maps_guide_the_build_and_are_part_of_the_id(tmp_path):
    other = Controls({"density": {1001: RAMP[:, ::-1]}, "region_nose": {1001: RAMP.T}})
    moved = Controls({"density": {1001: RAMP}, "region_lip": {1001: RAMP.T}})
    with running(tmp_path) as engine:
        ids = [built(engine, asked(c)) for c in (MAPS, other, moved, None)]
        assert len(set(ids)) == 4
        assert engine.assets.create(asked()).id == ids[0]
        # Black is left: the middle of all pores lies to the right.
        graphs = [engine.assets.graph(id) for id in ids]
        middles = [np.median(graph.node_uv[graph.own_nodes, 0]) for graph in graphs]
        assert middles[0] > 0.65
        assert middles[1] < 0.35
        assert engine.assets.info(ids[3]).wrinkles == 400
        assert engine.assets.info(ids[0]).wrinkles != 400
        before = graph_bytes(engine, ids[0])
    with running(tmp_path) as engine:
        settle(engine, ids[0])
        assert graph_bytes(engine, ids[0]) == before


@pytest.mark.slow
def test_an_interrupted_build_goes_on_with_them(tmp_path):
    new = asked()
    with running(tmp_path / "one") as engine:
        asset = built(engine, new)
        wanted = graph_bytes(engine, asset)
    with AssetStore(tmp_path / "two") as store:
        store.put_request(asset, StoredRequest(new.mesh, new.settings, None, None, new.controls))
    with running(tmp_path / "two") as engine:
        settle(engine, asset)
        assert graph_bytes(engine, asset) == wanted


def test_ids_without_controls_stay():
    new = asked(None)
    plain = asset_id(new.mesh, new.settings, None)
    # As it was before there were controls: the settings of the graph were these three.
    parsed = settings_of(graph={"wrinkles": 400, "seed": 1, "neighbours": 8, "density": 1.0})
    assert asset_id(new.mesh, parsed, None) == plain
    for change in ({"density": 1.5}, {"region": "lip"}, {"turn": 5}, {"strength": 0.5}):
        assert asset_id(new.mesh, asked(None, **change).settings, None) != plain


@pytest.mark.parametrize(
    ("controls", "graph", "error", "told"),
    [
        (Controls({"density": {1001: 0 * RAMP}}), {}, InputError, "leaves no room for pores"),
        (None, {"density": 0.1}, InputError, "at least 100, graph.wrinkles of 1000 or more"),
        (None, {"wrinkles": 10_000_000}, LimitError, r"device memory can hold \d+"),
        (
            Controls({"turn": {1002: RAMP}}),
            {},
            InputError,
            "turn is of UDIM 1002, which has no",
        ),
    ],
)
def test_what_cannot_be_grown_is_refused_before_work(tmp_path, controls, graph, error, told):
    with running(tmp_path, device_memory=256 << 20) as engine:
        with pytest.raises(error, match=told):
            engine.assets.create(asked(controls, **graph))
        assert engine.assets.all() == []


def test_maps_do_not_go_with_a_graph(tmp_path):
    with running(tmp_path) as engine:
        with pytest.raises(InputError, match="density, region_nose: maps that guide synthesis"):
            engine.assets.create(replace(asked(), graph=random_graph(1)))
        info = engine.assets.create(asked(None))
        assert finish(engine, info.job).state == "done"
