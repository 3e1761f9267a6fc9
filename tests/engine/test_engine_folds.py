"""Lines grown by expressions in the engine: ids, restarts, settings, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.engines import built, finish, running, settle
from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.domain.expressions import Expressions, expressions_for_lines
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError
from rhytid.pipeline.folds import measured_folds
from rhytid.storage.asset_ids import asset_id
from rhytid.storage.records import StoredRequest
from rhytid.storage.store import AssetStore
from rhytid.synthesis.surface import Surface
from synthesis import sheets

MESH = sheet()


def shapes(factor: float = 0.8, names=("squint",)) -> Expressions:
    """The sheet, compressed along x."""
    return Expressions.checked(
        (MESH.positions * np.float32([factor, 1, 1]))[None], len(MESH.positions), list(names)
    )


def asked(expressions=None, **graph) -> NewAsset:
    settings = settings_of(graph={"wrinkles": 800, **graph})
    return NewAsset(MESH, settings, shapes=expressions)


def graph_bytes(engine, asset):
    return {name: array.tobytes() for name, array in engine.assets.graph(asset).arrays().items()}


def order(engine, asset) -> complex:
    """Mean e^2iθ of the wrinkles at angles θ to x on the surface, seen from above."""
    graph = engine.assets.graph(asset)
    place = sheets.places(Surface.of(MESH), graph)[:, :2]
    way = np.diff(place[graph.edge_nodes], axis=1)[:, 0] @ [1, 1j]
    weight = graph.edge_weight.astype(float) ** 2
    return complex((weight * (way / abs(way)) ** 2).sum() / weight.sum())


@pytest.mark.slow
def test_expressions_guide_the_build_and_are_part_of_the_id(tmp_path):
    wanted = [None, shapes(), shapes(0.7), shapes(names=("other",))]
    with running(tmp_path) as engine:
        ids = [built(engine, asked(e)) for e in wanted]
        assert len(set(ids)) == 4
        assert engine.assets.create(asked(shapes())).id == ids[1]
        # Across what is compressed: upright. Without expressions lines are level.
        level, upright = (order(engine, asset) for asset in ids[:2])
        assert level.real > 0.1
        assert upright.real < -0.4
        assert abs(upright.imag) < 0.3
        before = graph_bytes(engine, ids[1])
    with running(tmp_path) as engine:
        settle(engine, ids[1])
        assert graph_bytes(engine, ids[1]) == before
        assert engine.assets.create(asked(shapes())).id == ids[1]


def test_level_lines_and_automatic_ones_are_what_they_say(tmp_path):
    with running(tmp_path) as engine:
        plain, level = built(engine, asked()), built(engine, asked(shapes(), lines="level"))
        grown = built(engine, asked(shapes()))
        assert plain == level != grown
        for lines in ("auto", "expressions"):
            assert engine.assets.create(asked(shapes(), lines=lines)).id == grown
        assert engine.assets.create(asked(lines="auto")).id == plain


def test_ids_without_expressions_stay():
    new = asked()
    parsed = settings_of(graph={"wrinkles": 800, "seed": 1, "neighbours": 8})
    assert asset_id(new.mesh, parsed, None) == asset_id(new.mesh, new.settings, None)
    assert asset_id(new.mesh, asked(lines="level").settings, None) == asset_id(
        new.mesh, new.settings, None
    )


def test_expressions_that_move_nothing_leave_level_lines(tmp_path):
    with running(tmp_path) as engine:
        plain = built(engine, asked())
        still = built(engine, asked(shapes(1.0)))
        assert still != plain
        one, two = (graph_bytes(engine, asset) for asset in (plain, still))
        assert one == two


def test_asking_for_expressions_without_any_is_refused(tmp_path):
    none = Expressions.checked(np.empty((0, len(MESH.positions), 3)), len(MESH.positions))
    with running(tmp_path) as engine:
        for given in (None, none):
            with pytest.raises(InputError, match='"expressions", and none came with the mesh'):
                engine.assets.create(asked(given, lines="expressions"))
        assert engine.assets.all() == []
        built(engine, asked(none))


def test_beside_a_graph_expressions_do_nothing(tmp_path):
    new = replace(asked(shapes()), graph=random_graph(1))
    with running(tmp_path) as engine:
        one = engine.assets.create(new)
        assert finish(engine, one.job).state == "done"
        assert engine.assets.create(replace(new, shapes=None)).id == one.id


def test_an_interrupted_build_goes_on_with_what_expressions_left(tmp_path):
    new = asked(shapes())
    with running(tmp_path / "one") as engine:
        asset = built(engine, new)
        wanted = graph_bytes(engine, asset)
        settings = new.settings
        folds = measured_folds(
            engine._device, new.mesh, expressions_for_lines(settings.graph.lines, new.shapes),
            settings.response.log_stretch_limit, settings.length_unit, lambda *_: None,
            engine._on_device.run_patiently,
        )  # fmt: skip
    assert folds.tensor.nbytes < 30 * len(MESH.positions)
    with AssetStore(tmp_path / "two") as store:
        store.put_request(asset, StoredRequest(new.mesh, new.settings, None, folds=folds))
        again = store.request(asset).folds
        np.testing.assert_array_equal(again.tensor, folds.tensor)
        assert again.moving == folds.moving == 1
    with running(tmp_path / "two") as engine:
        settle(engine, asset)
        assert graph_bytes(engine, asset) == wanted
