"""Scanned skin: the scan at rest, the residual in every method and level, kept and told apart."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine.engines import (
    QUERIES,
    assembled,
    built,
    finish,
    maps,
    new_asset,
    running,
    same,
    settle,
)
from meshes import deform
from pipeline.scenes import sheet
from reference import tracing as reference
from rhytid.domain.mesh import Mesh
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.domain.scan import resampled
from rhytid.domain.tiles import TileAddress, udim_origin
from rhytid.domain.warnings import InputWarning
from rhytid.engine.assets.upload import content_id
from rhytid.engine.engine import Engine
from rhytid.engine.messages import MapQuery, NewAsset
from rhytid.errors import ConflictError, InputError
from rhytid.pictures.raster import rasterize_uv

pytestmark = pytest.mark.usefixtures("no_maps_ahead")

MESH = sheet(udims=2)
BENT = deform(MESH.positions, 3, 0.15)
SIDE, DEPTH = 256, 0.1
UDIMS = (1001, 1002, 1011, 1012)
EVERY = (*QUERIES, *(MapQuery(m, sampling="smooth") for m in ("redraw", "binned", "convolved")))


def residual(mesh: Mesh = MESH) -> Residual:
    """Noise and a swell in three of four UDIMs, above the surface in one."""
    rng = np.random.default_rng(5)
    swell = 0.02 * np.sin(np.arange(SIDE) / 30.0)
    found = {u: swell + 0.004 * rng.normal(size=(SIDE, SIDE)) for u in UDIMS[:3]}
    found[1002] = found[1002] + 0.3
    return Residual.of({u: map.astype(np.float32) for u, map in found.items()})


def rest_of(residual: Residual) -> dict[int, np.ndarray]:
    """In double, from the definition."""
    found = {u: np.zeros((SIDE, SIDE)) for u in UDIMS}
    for udim, codes in residual.codes.items():
        step, middle = residual.steps[udim]
        found[udim] = middle + step * codes.astype(np.float64)
    return found


def whole(engine: Engine, id: str, query: MapQuery, udim: int, level: int = 0) -> np.ndarray:
    return engine.tiles.plan_map(id, "bent", query, udim, level).draw()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """An engine with an asset that has a residual and one that has none, both bent."""
    with running(tmp_path_factory.mktemp("scanned")) as engine:
        ids = (
            built(engine, replace(new_asset(MESH), residual=residual())),
            built(engine, new_asset(MESH)),
        )
        for id in ids:
            engine.frames.put(id, "bent", BENT)
        yield engine, *ids


@pytest.mark.parametrize("query", EVERY, ids=str)
def test_every_method_has_the_residual(made, query):
    engine, scanned, plain = made
    for udim, added in rest_of(residual()).items():
        wanted = whole(engine, plain, query, udim) + added
        np.testing.assert_allclose(whole(engine, scanned, query, udim), wanted, rtol=0, atol=1e-7)


@pytest.mark.parametrize("query", QUERIES, ids=str)
@pytest.mark.parametrize("level", [0, 1, 8])
def test_tiles_put_together_are_the_map_and_levels_are_means(made, query, level):
    engine, scanned, _ = made
    map = whole(engine, scanned, query, 1002, level)
    assert same([map], [assembled(engine, scanned, "bent", query, 1002, level)])
    side = SIDE >> level
    means = whole(engine, scanned, query, 1002).reshape(side, SIDE // side, side, -1).mean((1, 3))
    np.testing.assert_allclose(map, means, rtol=0, atol=1e-6)


def test_png_tiles_hold_the_residual(made):
    engine, *ids = made
    scales = [
        engine.tiles.plan(id, "bent", QUERIES[1], TileAddress(1001, 0, 0, 0)).header.scale
        for id in ids
    ]
    assert scales[0] - scales[1] == pytest.approx(residual().largest)
    assert residual().largest == pytest.approx(np.abs(rest_of(residual())[1002]).max())


def test_what_cannot_hold_it_is_refused(made):
    engine, scanned, plain = made
    for call in (
        lambda id: engine.tiles.bins(id),
        lambda id: engine.tiles.bin_tile(id, TileAddress(1001, 0, 0, 0), "pores"),
    ):
        with pytest.raises(ConflictError, match="is a scanned skin: precomputed maps"):
            call(scanned)
    engine.tiles.bins(plain)


def test_changes_keep_it(made):
    engine, scanned, plain = made
    for id in (scanned, plain):
        engine.assets.change(id, {"response": {"alpha_d": 3.0}})
    try:
        added = rest_of(residual())[1011]
        found, wanted = (whole(engine, id, QUERIES[1], 1011) for id in (scanned, plain))
        np.testing.assert_allclose(found, wanted + added, rtol=0, atol=1e-7)
        assert not same([wanted], [found])
    finally:
        for id in (scanned, plain):
            engine.assets.change(id, {"response": {"alpha_d": 4.0}})


def test_another_depth_is_noticed_with_the_way_back(made):
    engine, scanned, plain = made
    depth = engine.assets.info(scanned).settings["depth"]
    assert "scan-redrawn" not in codes(engine, plain, {"depth": 2.0 * depth})
    engine.assets.change(plain, {"depth": depth})
    found = engine.assets.change(scanned, {"depth": 2.0 * depth}).notices
    (notice,) = [one for one in found if one.code == "scan-redrawn"]
    assert notice.detail.endswith(f'PATCH {{"depth": {depth}}}')
    assert "scan-redrawn" in codes(engine, scanned, {"depth": depth})
    assert "scan-redrawn" not in codes(engine, scanned, {"response": {"alpha_d": 4.0}})


def codes(engine: Engine, asset: str, changes: dict) -> list[str]:
    return [notice.code for notice in engine.assets.change(asset, changes).notices]


def test_its_memory_is_counted(made):
    engine, scanned, plain = made
    one, other = (
        sum(part.nbytes for part in mesh.residuals.values())
        for mesh in (
            engine._on_device.loaded(engine.assets._assets.get(id)).mesh for id in (scanned, plain)
        )
    )
    assert (one, other) == (3 * SIDE**2 * 2, 0)


def test_it_is_part_of_the_id_and_survives_restart_and_snapshot(tmp_path):
    new = new_asset(MESH)
    other = Residual.of({1001: residual().heights(1001)})
    with running(tmp_path / "one") as engine:
        ids = [built(engine, replace(new, residual=r)) for r in (residual(), other)]
        assert len({*ids, engine.assets.create(new).id}) == 3
        engine.frames.put(ids[0], "bent", BENT)
        before = maps(engine, ids[0], "bent")
        resized = engine.assets.resized(ids[0], 512)
        finish(engine, resized.job)
        large = engine.tiles.plan_map(resized.id, "neutral", QUERIES[0], 1002, 0).draw()
        assert large.mean() == pytest.approx(before[1].mean(), abs=0.002)
        with engine.snapshots.of(ids[0]) as snapshot:
            data = b"".join(snapshot.pieces())
    assert b'"format":3' in data[:4096]
    with running(tmp_path / "one") as engine:
        settle(engine, ids[0])
        engine.frames.put(ids[0], "bent", BENT)
        assert same(before, maps(engine, ids[0], "bent"))
    with running(tmp_path / "two") as engine:
        engine.snapshots.restore(BytesIO(data), len(data))
        engine.frames.put(ids[0], "bent", BENT)
        assert same(before, maps(engine, ids[0], "bent"))


def relief(seed: int) -> np.ndarray:
    """Lines and pores on a swell, mesh units; a step across two rows, as at the end of a chart."""
    rng = np.random.default_rng(seed)
    starts = rng.uniform(30, 226, (25, 2))
    lines = np.concatenate([starts, starts + rng.uniform(-30, 30, (25, 2))], axis=1)
    found = reference.relief_of_lines(SIDE, lines, 3.0, 0.05, 1.0)
    found = found + reference.relief_of_pores(SIDE, rng.uniform(30, 226, (20, 2)), 4.0, 0.04)
    return (found + 0.02 * np.sin(np.arange(SIDE) / 20.0)).astype(np.float32)


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """An engine with an asset that was traced, of two UDIMs of four, and its scan."""
    scan = ScanRelief({udim: relief(udim) for udim in (1001, 1012)}, 1e-6)
    settings = new_asset(MESH, depth=None, preset="best", unit="mm").settings
    with running(tmp_path_factory.mktemp("traced")) as engine:
        id = built(engine, NewAsset(MESH, settings, scan=scan))
        engine.frames.put(id, "bent", BENT)
        yield engine, id, scan


def test_at_rest_it_is_the_scan(traced):
    engine, id, scan = traced
    step = max(float(np.ptp(map)) for map in scan.maps.values()) / 65535
    for udim in UDIMS:
        wanted = scan.maps.get(udim, np.zeros((SIDE, SIDE), np.float32))
        for query in QUERIES[:2]:
            found = engine.tiles.plan_map(id, "neutral", query, udim, 0).draw()
            assert np.abs(found - wanted).max() <= 0.5 * step + 1e-8, (udim, query)


def test_its_lines_move_and_can_be_had(traced):
    engine, id, scan = traced
    bent = whole(engine, id, QUERIES[1], 1001)
    assert np.abs(bent - scan.maps[1001]).max() > 0.01
    graph, info = engine.assets.graph(id), engine.assets.info(id)
    assert graph.counts() == (info.pores, info.wrinkles)
    assert info.wrinkles > 50
    assert info.settings["shape"]["grain"] == info.settings["shape"]["undulation"] == 0.0
    assert info.settings["depth"] == pytest.approx(0.04, rel=0.5)
    settings = new_asset(MESH, depth=None, preset="best", unit="mm").settings
    sent = NewAsset(MESH, settings, scan=scan)
    assert id == content_id(sent) == engine.assets.create(sent).id


def test_detail_leaves_the_means_of_the_scan_and_is_the_same_asset_again(tmp_path):
    """In every method at rest, and it moves; another server that finds it draws it alike."""
    own = {udim: relief(udim)[::2, ::2] for udim in (1001, 1012)}
    maps = {udim: resampled(map, SIDE, SIDE) for udim, map in own.items()}
    scan = ScanRelief(maps, 1e-6, dict.fromkeys(own, SIDE // 2), 1.0)
    settings = new_asset(MESH, depth=None, preset="best", unit="mm").settings
    sent = NewAsset(MESH, settings, scan=scan)
    with running(tmp_path) as engine:
        id = built(engine, sent)
        engine.frames.put(id, "bent", BENT)
        assert id != content_id(replace(sent, scan=replace(scan, detail=0.5)))
        assert "settings-changed" not in [w.code for w in engine.assets.create(sent).warnings]
        info, step = engine.assets.info(id), max(map(np.ptp, maps.values())) / 65535
        assert info.settings["shape"]["grain"] > 0.0
        rest = {u: engine.tiles.plan_map(id, "neutral", QUERIES[1], u, 0).draw() for u in maps}
        for udim, found in rest.items():
            added = found - maps[udim]
            halves = added.astype(np.float64).reshape(SIDE // 2, 2, SIDE // 2, 2).mean((1, 3))
            assert np.abs(halves).max() <= 0.5 * step + 1e-8
            assert np.abs(added).max() > 20 * step
        bent = [whole(engine, id, query, 1001) for query in QUERIES]
    with running(tmp_path) as engine:
        engine.frames.put(id, "bent", BENT)
        assert same(bent, [whole(engine, id, query, 1001) for query in QUERIES])


def test_there_is_no_detail_where_no_map_ends(tmp_path):
    """Beside a UDIM with detail: at rest one without a map is smooth, and another is its map. Far
    from the first there is none that would move."""
    maps = {1001: resampled(relief(1001)[::2, ::2], SIDE, SIDE), 1012: relief(1012)}
    scan = ScanRelief(maps, 1e-6, {1001: SIDE // 2}, 1.0)
    settings = new_asset(MESH, depth=None, preset="best", unit="mm").settings
    with running(tmp_path) as engine:
        id = built(engine, NewAsset(MESH, settings, scan=scan))
        engine.frames.put(id, "bent", BENT)
        for udim in UDIMS[1:]:
            found = engine.tiles.plan_map(id, "neutral", QUERIES[1], udim, 0).draw()
            assert np.abs(found - maps.get(udim, 0.0)).max() < 2e-6
        assert np.abs(whole(engine, id, QUERIES[1], 1002)[:, SIDE // 2 :]).max() < 2e-6
        graph = engine.assets.graph(id)
        ends = np.isin(np.arange(graph.pores), graph.edge_nodes)
        silent = graph.own_nodes & (graph.node_weight == 0) & ~ends
        assert silent.any()
        assert engine.assets.info(id).pores == np.count_nonzero(graph.own_nodes & ~silent)


BORDER = 0.05


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A scan of two UDIMs of four, the left third of the first masked out, in which skin grows; the
    same skin without a scan; their maps at rest by UDIM, and how far each texel is from where there
    is no scan."""
    denied = np.zeros((SIDE, SIDE), np.uint8)
    denied[:, : SIDE // 3] = 1
    maps = {udim: relief(udim) for udim in (1001, 1012)}
    scan = ScanRelief(maps, 1e-6, denied={1001: denied}, border=BORDER)
    graph = {"spacing": 0.05, "seed": 3, "events": 0.0}
    settings = new_asset(MESH, depth=0.06, preset="best", unit="mm", graph=graph).settings
    with running(tmp_path_factory.mktemp("filled")) as engine:
        sent = NewAsset(MESH, settings, scan=scan)
        id, plain = built(engine, sent), built(engine, NewAsset(MESH, settings))
        assert id == content_id(sent) == engine.assets.create(sent).id
        assert "settings-unused" not in [w.code for w in engine.assets.create(sent).warnings]
        rest = [
            {u: engine.tiles.plan_map(one, "neutral", QUERIES[1], u, 0).draw() for u in UDIMS}
            for one in (id, plain)
        ]
        yield maps, rest[0], rest[1], far_from_denied(denied), engine.assets.graph(id)


def far_from_denied(denied: np.ndarray) -> dict[int, np.ndarray]:
    """(SIDE, SIDE) distance in space to the nearest texel without a scan, in double; below 0 in
    those, to the nearest with one; 0 outside of charts."""
    scanned = {u: np.full((SIDE, SIDE), u == 1012) for u in UDIMS} | {1001: denied == 0}
    seen = {u: rasterize_uv(MESH.triangle_uv() - udim_origin(u), SIDE) for u in UDIMS}
    places = {u: s.smooth(MESH.positions[MESH.faces].astype(float)) for u, s in seen.items()}
    without, having = (
        cKDTree(np.concatenate([places[u][seen[u].covered & (scanned[u] == kept)] for u in UDIMS]))
        for kept in (False, True)
    )
    far = {u: np.zeros((SIDE, SIDE)) for u in UDIMS}
    for u in UDIMS:
        on, off = seen[u].covered & scanned[u], seen[u].covered & ~scanned[u]
        far[u][on] = without.query(places[u][on])[0]
        far[u][off] = -having.query(places[u][off])[0]
    return far


def test_from_the_border_on_a_scan_in_which_skin_grows_is_the_scan(filled):
    maps, rest, _, far, _ = filled
    step = max(float(np.ptp(rest[u] - maps[u])) for u in maps) / 65535
    for udim, map in maps.items():
        there = far[udim] > 1.1 * BORDER
        assert there.mean() > 0.2
        assert np.abs(rest[udim] - map)[there].max() <= 0.5 * step + 1e-7
        assert np.abs(rest[udim] - map)[far[udim] < 0.4 * BORDER].std() > 0.005


def test_far_from_a_scan_skin_is_as_it_grows(filled):
    """A triangle and more away: grain and undulation are linear between vertices."""
    _, rest, plain, far, _ = filled
    for udim in (1002, 1011):
        there = far[udim] < -0.3
        assert there.mean() > 0.1
        assert np.abs(rest[udim] - plain[udim])[there].max() < 1e-5
        assert plain[udim][there].std() > 0.003


def test_nothing_grows_in_a_scan_without_lines(tmp_path):
    """Grain and undulation are drawn where skin grows alone: not in all of the scan, where they
    would move."""
    swell = np.sin(np.arange(SIDE) / 40.0) * np.ones((SIDE, 1))
    scan = ScanRelief({u: swell.astype(np.float32) for u in (1001, 1012)}, 1e-6, border=BORDER)
    graph = {"spacing": 0.05, "seed": 3, "events": 0.0}
    settings = new_asset(MESH, depth=0.06, preset="best", unit="mm", graph=graph).settings
    with running(tmp_path) as engine:
        id = built(engine, NewAsset(MESH, settings, scan=scan))
        engine.frames.put(id, "bent", BENT)
        rest = engine.tiles.plan_map(id, "neutral", QUERIES[1], 1001, 0).draw()
        moved = np.abs(whole(engine, id, QUERIES[1], 1001) - rest)
    assert moved[SIDE // 3 : -SIDE // 3, : SIDE // 3].max() < 1e-6
    assert moved[:, -SIDE // 8 :].max() > 1e-4


def test_there_is_no_step_at_the_border(filled):
    """From texel to texel heights differ no more than in the scan and in skin that grows."""
    maps, rest, plain, far, _ = filled
    border = np.abs(far[1001]) < BORDER
    steps = [np.abs(np.diff(one[1001], axis=1))[border[:, 1:]] for one in (rest, plain, maps)]
    steep = [np.quantile(one, 0.999) for one in steps]
    assert steep[0] < 1.2 * max(steep[1:])


def test_its_graph_has_both_kinds_of_lines_once(filled):
    *_, graph = filled
    assert graph.edge_weight.min() > 0.0
    assert 0.0 == graph.node_grain.min() < graph.node_grain.max()
    partners = graph.edge_partners
    known = np.argwhere(partners >= 0)
    shared = graph.original_nodes(graph.edge_nodes)
    for edge, end in known[:: max(len(known) // 200, 1)]:
        assert shared[edge, end] in shared[partners[edge, end]]


def test_warnings_of_a_scan_outlive_a_server_that_ends_while_it_is_traced(tmp_path):
    """And no notice of few texels between pores half a millimetre apart: it has none of these."""
    told = InputWarning("scan-bits", "it has 8 bits", "scan.png, UDIM 1001")
    settings = new_asset(MESH, depth=None, preset="best", unit="m").settings
    sent = NewAsset(MESH, settings, scan=ScanRelief({1001: relief(1)}), noted=(told,))
    with running(tmp_path) as engine:
        id = engine.assets.create(sent).id
    with running(tmp_path) as engine:
        assert engine.assets.info(id).state == "building"
        settle(engine, id)
        info = engine.assets.info(id)
    assert told in info.warnings
    assert "few-texels" not in [notice.code for notice in info.notices]


def test_what_does_not_fit_is_refused(traced):
    engine, _, scan = traced
    new = new_asset(MESH)
    small = {1001: np.zeros((128, 128), np.float32)}
    for changes, error in (
        ({"graph": None, "residual": residual()}, "residual is what a traced graph does not draw"),
        ({"scan": scan}, "a graph and a scan"),
        ({"residual": Residual.of(small)}, "UDIM 1001 has 128 texels a side, the asset has 256"),
        ({"residual": Residual({}, {})}, "without a map"),
        ({"graph": None, "scan": ScanRelief({1003: relief(1)})}, "UDIM 1003, which has no mesh"),
    ):
        with pytest.raises(InputError, match=error):
            engine.assets.create(replace(new, **changes))
    flat = ScanRelief({1001: np.zeros((SIDE, SIDE), np.float32)})
    info = engine.assets.create(NewAsset(MESH, replace(new.settings, depth=None), scan=flat))
    job = finish(engine, info.job)
    assert (job.state, "no lines in the scan" in job.detail) == ("failed", True)
