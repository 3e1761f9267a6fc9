"""Wavy wrinkles through the stages: redrawn and binned maps, and the halves of one at a seam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.binned import BinnedScene
from pipeline.scenes import DEPTH, Scene, random_graph, settings_of, sheet
from reference import drawing, redraw
from reference import waves as reference
from rhytid.device.runtime import Device
from rhytid.domain.graph_geometry import seam_halves
from rhytid.domain.mesh import Mesh
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.waves import wrinkle_waves
from rhytid.synthesis.generate import synthesize
from synthesis import sheets
from synthesis.halves import in_halves

# The sheet is 2 wide; its wrinkles are up to 0.05 in half width and 0.4 long in UV.
WAVES = {"wave_amplitude": 0.06, "wave_frequency": 4.0}
GRAPH = random_graph(31, 120)


def scene(device, graph=GRAPH, kind=Scene, **changes):
    return kind(device, sheet(), graph, settings_of(shape=WAVES, **changes))


@pytest.mark.parametrize("seed", [1, 2])
def test_redrawn_waves_are_those_of_the_reference(device, seed):
    made = scene(device)
    positions = deform(made.mesh.positions, seed, 0.15)
    found = made.redrawn(positions, at=(64, 64), side=128)
    points = drawing.crop(64, 64, 128, 128, 256)
    wanted = made.expected(points, positions).reshape(128, 128)
    assert np.abs(found - wanted).max() <= 1e-4 * DEPTH
    straight = Scene(device, made.mesh, GRAPH, settings_of())
    assert np.abs(found - straight.redrawn(positions, at=(64, 64), side=128)).max() > 0.3 * DEPTH


def test_amplitude_0_is_straight_bit_for_bit_whatever_the_frequency(device):
    plain, still = (
        Scene(device, sheet(), GRAPH, settings_of(shape=shape))
        for shape in ({}, {"wave_amplitude": 0.0, "wave_frequency": 50.0})
    )
    assert still.elements().waves is None
    positions = deform(plain.mesh.positions, 3, 0.15)
    np.testing.assert_array_equal(still.redrawn(positions), plain.redrawn(positions))


@pytest.mark.slow
@pytest.mark.parametrize("merge", ["min", "mellow"])
def test_bins_draw_the_same_waves(device, merge):
    made = scene(device, kind=BinnedScene, bins={"merge": merge})
    for layer, codes in enumerate(made.codes()):
        assert (np.abs(codes - made.reference_codes(layer)) <= 1).all()
        assert (codes == made.reference_codes(layer)).mean() > 0.995


@pytest.mark.parametrize("udim", [1001, 1002, 1011, 1012])
def test_nothing_is_cut_off_at_borders_of_blocks_and_udims(device, udim):
    graph = random_graph(32, 150, (0.003, 0.006), (0.2, 0.5), span=2.0)
    graph = replace(graph, node_weight=0 * graph.node_weight)
    made = Scene(device, sheet(udims=2), graph, settings_of(shape={**WAVES, "wave_amplitude": 0.1}))
    found = made.redrawn(None, udim)
    points = drawing.crop(0, 0, 256, 256, 256)
    lines = redraw.wrinkles(made.graph, origin=udim_origin(udim), waves=made.reference_waves())
    wanted = drawing.draw(points, lines, None, made.settings.shape, DEPTH).reshape(256, 256)
    assert np.abs(found - wanted).max() <= 1e-4 * DEPTH
    assert np.abs(wanted).max() > 0.3 * DEPTH


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_mesh_units_are_those_of_the_mesh(scale):
    mesh = sheet()
    larger = Mesh(mesh.positions * np.float32(scale), mesh.faces, mesh.uv, mesh.face_uv)
    triangle = np.arange(GRAPH.wrinkles, dtype=np.int32)
    shape = settings_of(shape=WAVES).shape
    scaled = replace(shape, wave_amplitude=0.06 * scale, wave_frequency=4.0 / scale)
    found = wrinkle_waves(larger, GRAPH, triangle, scaled)
    np.testing.assert_allclose(found, wrinkle_waves(mesh, GRAPH, triangle, shape), rtol=1e-4)


def test_wrinkles_on_no_triangle_are_straight():
    mesh, shape = sheet(), settings_of(shape=WAVES).shape
    triangle = np.arange(GRAPH.wrinkles, dtype=np.int32)
    triangle[::2] = len(mesh.faces)
    found = wrinkle_waves(mesh, GRAPH, triangle, shape)
    np.testing.assert_array_equal(found[::2, 0], 0.0)
    np.testing.assert_array_equal(found[1::2, 0] != 0, True)
    assert np.isfinite(found).all()


def test_halves_on_no_triangle_are_straight(device: Device) -> None:
    mesh = sheets.tube()
    graph = in_halves(synthesize(mesh, sheets.wanted(500), device).graph)
    shape = settings_of(shape=WAVES).shape
    nowhere = np.full(graph.wrinkles, len(mesh.faces), np.int32)
    found = wrinkle_waves(mesh, graph, nowhere, shape)
    assert len(seam_halves(mesh, graph)) > 0
    np.testing.assert_array_equal(found[:, 0], 0.0)
    assert np.isfinite(found).all()


def test_phases_do_not_depend_on_their_neighbours_and_spread_evenly():
    mesh, shape = sheet(), settings_of(shape=WAVES).shape
    graph = random_graph(33, 4000)
    phase = wrinkle_waves(mesh, graph, np.zeros(4000, np.int32), shape)[:, 2]
    np.testing.assert_array_equal(phase, reference.phases(range(4000)).astype(np.float32))
    counts, _ = np.histogram(phase, 10, (0, 1))
    assert np.abs(counts - 400).max() < 100
    assert np.abs(np.corrcoef(phase[1:], phase[:-1])[0, 1]) < 0.05


def mirrored(mesh, graph):
    """Both with u the other way round."""
    other = Mesh(mesh.positions, mesh.faces, mesh.uv * [-1, 1] + [1, 0], mesh.face_uv)
    return other, replace(graph, node_uv=graph.node_uv * np.float32([-1, 1]) + np.float32([1, 0]))


def test_the_halves_of_a_wrinkle_at_a_seam_are_one_wave(device):
    mesh = sheets.tube()
    graph = in_halves(synthesize(mesh, sheets.wanted(2000), device).graph)
    shape = settings_of(shape=WAVES).shape
    found = wrinkle_waves(mesh, graph, graph.edge_triangle, shape).astype(float)
    pairs = seam_halves(mesh, graph)
    assert len(pairs) > 20
    np.testing.assert_array_equal(np.delete(found[:, 3], pairs.ravel()), 1.0)
    there, back = found[pairs[:, 0]], found[pairs[:, 1]]
    np.testing.assert_allclose(there[:, 1:3], back[:, 1:3], rtol=1e-5)
    np.testing.assert_array_equal(np.sign([there[:, 3], -back[:, 3]]), 1.0)
    assert (there[:, 3] - back[:, 3] > 0.99).all()  # the ends overlap beyond the seam
    # The UV of the tube is flat and even: where the two run beside each other, they are one curve.
    for (first, last), one, other in zip(pairs, there, back, strict=True):
        x = (one[3] + 1 + other[3]) / 2
        shift = one[0] * reference.wave(x, *one[1:3])
        assert shift == pytest.approx(-other[0] * reference.wave(x, *other[1:3]), abs=2e-4)
        assert first + 1 == last
    other = wrinkle_waves(*mirrored(mesh, graph), graph.edge_triangle, shape)
    np.testing.assert_allclose(other[pairs, 0], -found[pairs, 0], rtol=1e-3)


def test_a_copy_is_the_wave_of_its_original(device):
    mesh = sheets.tube()
    graph = synthesize(mesh, sheets.wanted(2000), device).graph
    shape = settings_of(shape=WAVES).shape
    found = wrinkle_waves(mesh, graph, graph.edge_triangle, shape)
    copies = np.flatnonzero(~graph.own_edges)
    first = graph.edge_copy_of[copies]
    assert len(copies) > 20
    np.testing.assert_array_equal(found[copies, 1:], found[first, 1:])
    np.testing.assert_array_equal(found[:, 3], 1.0)
    of_width = found[:, 0] / graph.edge_half_width
    np.testing.assert_allclose(of_width[copies], of_width[first], rtol=1e-5)
    other = wrinkle_waves(*mirrored(mesh, graph), graph.edge_triangle, shape)
    np.testing.assert_allclose(other[:, 0], found[:, 0], rtol=1e-3)
    # Where one chart is the mirror of the other, so is the wave: left is right there.
    folded, middle = mesh.uv.copy(), graph.node_uv[graph.edge_nodes][:, 0, 0] > 0.5
    folded[folded[:, 0] > 0.5, 0] = 1.7 - folded[folded[:, 0] > 0.5, 0]
    apart = Mesh(mesh.positions, mesh.faces, folded, mesh.face_uv)
    across = middle[copies] != middle[first]
    assert across.sum() > 20
    turned = wrinkle_waves(apart, graph, graph.edge_triangle, shape)[:, 0] / graph.edge_half_width
    np.testing.assert_array_equal(np.sign(turned[copies] * turned[first])[across], -1.0)
