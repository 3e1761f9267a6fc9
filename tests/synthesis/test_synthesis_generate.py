"""The whole way from a mesh to its wrinkle graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

import face_data
from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import CancelledError, MeshError
from rhytid.synthesis.build_size import shares_of_time
from rhytid.synthesis.generate import Synthesis, synthesize
from rhytid.synthesis.seams.charts import neighbours, trace
from rhytid.synthesis.statistics import statistics
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.sheets import wanted


@pytest.fixture(scope="module")
def made(device: Device) -> Synthesis:
    return synthesize(sheets.sheet(sheets.uneven), wanted(3000), device)


def same(one: WrinkleGraph, two: WrinkleGraph) -> bool:
    pairs = zip(one.arrays().items(), two.arrays().items(), strict=True)
    return all(a == b and x.tobytes() == y.tobytes() for (a, x), (b, y) in pairs)


def test_the_same_seed_gives_the_same_bits(device: Device, made: Synthesis) -> None:
    again = synthesize(sheets.sheet(sheets.uneven), wanted(3000), device)
    assert same(made.graph, again.graph)
    assert made.spacing == again.spacing
    other = synthesize(sheets.sheet(sheets.uneven), wanted(3000, seed=2), device)
    assert not same(made.graph, other.graph)


def test_twice_the_strength_is_twice_that_of_each_line_and_pore_up_to_one(
    device: Device, made: Synthesis
) -> None:
    twice = replace(wanted(3000), strength=2.0)
    graph = synthesize(sheets.sheet(sheets.uneven), twice, device).graph
    for name in ("node_uv", "node_radius", "edge_nodes", "edge_half_width"):
        np.testing.assert_array_equal(getattr(graph, name), getattr(made.graph, name), name)
    for name in ("node_weight", "edge_weight"):
        found, usual = getattr(graph, name), getattr(made.graph, name)
        assert 0 < (found == 1).mean() < 0.5
        np.testing.assert_array_equal(found, np.minimum(2 * usual, 1), name)


@pytest.mark.parametrize("count", [100, 101, 2347])
@pytest.mark.parametrize("make", [sheets.sheet, sheets.tube, sheets.with_hole])
def test_the_count_is_exact(device: Device, make: sheets.Callable[[], Mesh], count: int) -> None:
    graph = synthesize(make(), wanted(count), device).graph
    assert graph.counts()[1] == count
    assert graph.edge_weight.min() > 0
    joined = graph.original_nodes(graph.edge_nodes[graph.own_edges])
    assert len(np.unique(np.sort(joined, axis=1), axis=0)) == count


def in_shreds(n: int, space: float, uv: float) -> Mesh:
    """A sheet whose triangles are apart, smaller by factors in space and in UV."""
    mesh = sheets.sheet(n=n)
    apart = np.arange(mesh.faces.size).reshape(-1, 3)

    def shrunk(corners: sheets.Floats, factor: float) -> sheets.Floats:
        middle = corners.mean(axis=1, keepdims=True)
        return (middle + factor * (corners - middle)).reshape(-1, corners.shape[-1])

    positions = shrunk(mesh.positions[mesh.faces], space)
    return Mesh(positions.astype(np.float32), apart, shrunk(mesh.triangle_uv(), uv), apart)


@pytest.mark.slow
def test_a_mesh_in_shreds_gets_the_count_too(device: Device) -> None:
    assert synthesize(in_shreds(8, 1.0, 0.8), wanted(400), device).graph.counts()[1] == 400


def test_shreds_too_small_for_two_pores_are_refused_and_more_wrinkles_fit(device: Device) -> None:
    shreds = in_shreds(45, 0.3, 0.3)
    with pytest.raises(MeshError, match=r"only 0 of 100 .* ask for more wrinkles"):
        synthesize(shreds, wanted(100), device)
    assert synthesize(shreds, wanted(1000), device).graph.counts()[1] == 1000


def test_uv_too_small_for_float32_is_refused(device: Device) -> None:
    tiny = sheets.sheet(lambda xy: 0.5 + 1e-8 * xy)
    with pytest.raises(MeshError, match=r"graph\.wrinkles is 500"):
        synthesize(tiny, wanted(500), device)


@pytest.mark.parametrize("power", [-20, 20])
def test_scale_by_a_power_of_two_changes_no_bit(
    device: Device, made: Synthesis, power: int
) -> None:
    scaled = synthesize(sheets.sheet(sheets.uneven, scale=2.0**power), wanted(3000), device)
    assert same(made.graph, scaled.graph)
    assert scaled.spacing == made.spacing * 2.0**power


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e6, 1e9])
def test_any_scale_gives_the_same_picture(device: Device, made: Synthesis, scale: float) -> None:
    # Rounding of the positions may turn a walker; where pores lie and what is joined stays.
    graph = synthesize(sheets.sheet(sheets.uneven, scale=scale), wanted(3000), device).graph
    # Their numbers follow the lattice, which is another at another scale.
    apart, same_pore = cKDTree(made.graph.node_uv).query(graph.node_uv)
    assert apart.max() < 1e-6
    assert sorted(same_pore) == list(range(len(made.graph.node_uv)))
    pairs = [
        set(map(tuple, np.sort(nodes, axis=1).tolist()))
        for nodes in (same_pore[graph.edge_nodes], made.graph.edge_nodes)
    ]
    assert len(pairs[0] & pairs[1]) > 0.95 * 3000


def test_progress_rises_to_one_and_can_cancel(device: Device) -> None:
    seen: list[tuple[float, str]] = []
    synthesize(sheets.sheet(), wanted(500), device, lambda *report: seen.append(report))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert {stage for _, stage in seen} >= {"pores", "edges", "trails", "shapes"}
    used = device.budget.used
    for stop in range(0, len(seen), 5):
        left = iter(range(stop))

        def cancel(fraction: float, stage: str, left: object = left) -> None:
            if next(left, None) is None:  # type: ignore[call-overload]
                raise CancelledError("enough")

        with pytest.raises(CancelledError, match="enough"):
            synthesize(sheets.sheet(), wanted(500), device, cancel)
        assert device.budget.used == used


def test_progress_goes_on_over_seams(device: Device) -> None:
    """Where there are many, copies over them take longest."""
    seen: list[tuple[float, str]] = []
    tube = sheets.tube()
    synthesize(tube, wanted(500), device, lambda *report: seen.append(report))
    copying = shares_of_time(tube, neighbours(tube), 500)[1]
    late = {at for at, stage in seen if stage == "shapes" and at > 1.0 - copying - 1e-9}
    assert len(late) > 2


def test_progress_begins_with_the_share_of_what_is_done_once(device: Device) -> None:
    """Else an estimate of the time left is many times too long."""
    seen: list[tuple[float, str]] = []
    mesh = sheets.sheet()
    synthesize(mesh, wanted(3000), device, lambda *report: seen.append(report))
    begun = shares_of_time(mesh, neighbours(mesh), 3000)[0]
    assert [at for at, _ in seen if 0.0 < at < begun] == []
    assert seen[1] == (pytest.approx(begun), "pores")


@pytest.mark.parametrize("make", [sheets.sheet, sheets.tube, sheets.with_hole])
def test_every_wrinkle_lies_on_the_map(device: Device, make: sheets.Callable[[], Mesh]) -> None:
    mesh = make()
    graph = synthesize(mesh, wanted(2000), device).graph
    surface = Surface.of(mesh)
    assert graph.node_triangle is not None
    uv, ends = graph.node_uv.astype(float), graph.edge_nodes[graph.own_edges]
    step = uv[ends[:, 1]] - uv[ends[:, 0]]
    start = graph.node_triangle[ends[:, 0]].astype(np.int64)
    line = trace(surface, neighbours(mesh), start, uv[ends[:, 0]], step)
    whole = (graph.node_weight[ends] > 0).all(axis=1)
    assert (line.share[whole] == 1.0).all()
    assert (line.share[~whole] < 1.0).all()


def test_a_wrinkle_across_a_seam_joins_its_pores_on_both_sides(device: Device) -> None:
    mesh = sheets.tube()
    surface, graph = Surface.of(mesh), synthesize(mesh, wanted(2000), device).graph
    joined = graph.original_nodes(graph.edge_nodes)
    across = np.flatnonzero((joined != graph.edge_nodes).any(axis=1) & graph.own_edges)
    assert len(across) > 20
    pore, beyond = graph.edge_nodes[across].T
    assert (graph.node_weight[pore] > 0).all()
    assert (graph.node_weight[joined[across]] > 0).all()
    assert ((graph.node_uv[beyond, 0] < 0.1) | (graph.node_uv[beyond, 0] > 0.9)).all()
    at, copies = sheets.places(surface, graph), np.flatnonzero(~graph.own_edges)
    for row in across:
        copy = copies[graph.edge_copy_of[copies] == row]
        assert len(copy) == 1
        # Its second end is the second pore, its first is beyond the border on that side.
        start, stop = graph.edge_nodes[copy[0]]
        length = np.linalg.norm(at[joined[row, 1]] - at[joined[row, 0]])
        assert np.linalg.norm(at[stop] - at[joined[row, 1]]) < 0.02 * length
        assert not 0.1 < graph.node_uv[start, 0] < 0.9
        assert graph.edge_weight[copy[0]] == graph.edge_weight[row]


@pytest.mark.face
def test_the_real_face(device: Device, face: face_data.Face) -> None:
    mesh = Mesh(face.positions, face.faces, face.uv.astype(np.float64), face.face_uv)
    found = synthesize(mesh, wanted(20_000), device)
    figures = statistics(mesh, found.graph, device)
    assert figures["wrinkles"] == 20_000
    assert found.stretched == 0
    # No seam in this layout, so no node without weight, and nothing is stored twice.
    assert figures["pores"] == figures["drawn_pores"] == found.graph.pores
    assert found.graph.arrays().keys().isdisjoint(["node_copy_of", "edge_copy_of", "edge_metric"])
    # A little more than on even skin, for patches are denser and sparser.
    assert figures["distance"]["deviation"] < 0.13 * figures["distance"]["mean"]
    assert figures["crossings"] < 0.001
    assert 3.9 < figures["degree"]["mean"] < 4.5
    # Half of all wrinkles are faint, a few are deep, and at the limit in the strongest patches.
    assert np.median(found.graph.edge_weight) < 0.35
    assert found.graph.edge_weight.max() > 0.6
    assert (found.graph.edge_weight == 1.0).mean() < 0.01
