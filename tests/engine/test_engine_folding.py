"""Folds of the mesh in what is drawn: every method, model and sampling gives them their share."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from engine.engines import built, new_asset, settle
from pipeline.scenes import DEPTH, settings_of, sheet
from pipeline.test_stage_folding import pressed
from rhytid.domain.methods import METHODS, SAMPLINGS, STRETCH_MODELS
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.messages import MapQuery

EVERY = [MapQuery(*names) for names in product(METHODS, STRETCH_MODELS, SAMPLINGS)]


@pytest.fixture
def folded(engine):
    """Draws every map, and its key, of a sheet that is folded, with folds as given."""
    new = new_asset(unit="1.5cm", preset="best")
    asset = built(engine, new)
    engine.frames.put(asset, "folded", pressed(new.mesh))

    def drawn(amount):
        engine.assets.change(asset, {"response": {"folds": amount}})
        settle(engine, asset)
        plans = [engine.tiles.plan_map(asset, "folded", query, 1001, 0) for query in EVERY]
        return [(plan.key, plan.draw()) for plan in plans], engine.frames.stretch(asset, "folded")

    return drawn


def test_every_method_gives_folds_their_share(folded):
    (without, plain), (given, stretch) = folded(0.0), folded(1.0)
    np.testing.assert_array_equal(stretch.ratios, plain.ratios)
    assert plain.folds.max() == 0.0
    assert stretch.folds.max() > 0.3
    for query, (key, one), (other_key, other) in zip(EVERY, without, given, strict=True):
        changed = query.method != "neutral"
        assert (key != other_key) == changed, query
        assert (np.abs(one - other).max() > 0.02 * DEPTH) == changed, query


def test_percentiles_are_those_of_the_mesh(engine):
    new = new_asset(unit="1.5cm", preset="best")
    asset = built(engine, new)
    one = engine.frames.put(asset, "folded", pressed(new.mesh)).log_stretch
    engine.assets.change(asset, {"response": {"folds": 0.0}})
    settle(engine, asset)
    assert engine.frames.info(asset, "folded").log_stretch == one


def test_a_preset_tells_in_its_answer_alone_that_it_set_folds_anew(engine):
    asset = built(engine, new_asset(unit="1.5cm", preset="best"))
    answers = [
        engine.assets.change(asset, change)
        for change in ({"response": {"folds": 0.25}}, {"preset": "best"}, {"depth": 0.5 * DEPTH})
    ]
    details = [[n.detail for n in a.notices if n.code == "preset-set"] for a in answers]
    assert [len(found) for found in details] == [0, 1, 0]
    assert "response.folds is 1.0, was 0.25" in details[1][0]


def test_folds_are_of_frames_and_change_no_elements(device):
    """So that a PATCH of them, of any number of wrinkles, is quick."""
    asset = DeviceAsset(device, sheet(), settings_of(preset="best").resolved(0.1))
    now = asset.mesh.settings
    assert now.response.folds == 1.0
    assert not asset.mesh.prepares(now.changed({"response": {"folds": 0.5}}))
    assert asset.mesh.prepares(now.changed({"response": {"folds": 0.5, "beta_w": 1.0}}))
    asset.release()
