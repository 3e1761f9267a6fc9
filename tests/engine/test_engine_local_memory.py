"""A device with the local memory that OpenCL promises, and no more, gives the same bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.engines import built, running, same
from meshes import deform
from pipeline.scenes import settings_of, sheet
from rhytid.device import select
from rhytid.domain.methods import METHODS, SAMPLINGS
from rhytid.domain.painted_maps import Stiffness
from rhytid.engine.messages import MapQuery, NewAsset

pytestmark = pytest.mark.release

PROMISED = 32 << 10
MERGES = ({"merge": "min"}, {"merge": "mellow"}, {"merge": "signed"}, {"preset": "best"})


def drawn(tmp_path):
    """What kernels make: a synthesised graph, maps by every method, sampling and merge, with waves
    and stiffness; and the rows of a work-group."""
    stiffness = Stiffness({1001: np.linspace(0.5, 1, 64).reshape(8, 8)})
    shape = {"wave_amplitude": 0.02}
    settings = settings_of(graph={"wrinkles": 1000}, shape=shape)
    found = []
    with running(tmp_path) as engine:
        asset = built(engine, NewAsset(sheet(), settings, stiffness=stiffness))
        engine.frames.put(asset, "bent", deform(sheet().positions, 3, 0.15))
        found += engine.assets.graph(asset).arrays().values()
        for changes in MERGES:
            engine.assets.change(asset, changes if "preset" in changes else {"bins": changes})
            found.append(engine.tiles.plan_map(asset, "bent", MapQuery("binned"), 1001, 0).draw())
        for method in METHODS:
            for sampling in SAMPLINGS:
                query = MapQuery(method, sampling=sampling)
                found.append(engine.tiles.plan_map(asset, "bent", query, 1001, 1).draw())
        return found, engine._device.shape.rows


@pytest.mark.slow
def test_32_kib_are_enough_and_change_no_bit(tmp_path, monkeypatch):
    candidates = select.candidates()
    plenty, rows = drawn(tmp_path / "plenty")
    small = tuple(replace(c, local_memory=PROMISED) for c in candidates)
    monkeypatch.setattr(select, "candidates", lambda: small)
    promised, fewer = drawn(tmp_path / "promised")
    assert fewer == 32 <= rows
    assert same(plenty, promised)
