"""Redrawn maps against the reference, within 1e-4 of the depth."""

from __future__ import annotations

import numpy as np
import pytest

from meshes import deform
from pipeline.scenes import DEPTH, Scene, random_graph, settings_of, sheet
from reference import drawing, redraw
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.levels import render_to_host
from rhytid.pipeline.redraw import redrawing, respond

# What draw.clh claims; the response to stretch stays well below.
BOUND = 1e-4 * DEPTH
SIDE = 128

GRAPHS = {
    "plain": random_graph(1),
    "metrics": random_graph(2, metric=True),
    "long and narrow": random_graph(3, 60, (0.003, 0.006), (0.5, 1.2)),
    "short": random_graph(4, 200, (0.02, 0.05), (1e-5, 1e-3)),
    "wide": random_graph(5, 30, (0.1, 0.3), (0.05, 0.5)),
    "finer than a texel": random_graph(6, 400, (0.0003, 0.002)),
}
SHAPES = {
    "bulges on both": {"wrinkle_bulge": 7.0, "pore_bulge": 4.0},
    "no bulge": {"wrinkle_bulge": 0.0},
    "bulges of pores alone": {"wrinkle_bulge": 1.0, "pore_bulge": 4.0},
    "sixteen slots": {"slots": 16},
    "soft": {"sharpness": 2.0, "slots": 3},
    "largest bulges": {"wrinkle_bulge": 9.0, "pore_bulge": 9.0},
}


def check(device, scene, seed=11, at=(64, 64), side=SIDE, udim=1001):
    positions = deform(scene.mesh.positions, seed, 0.15)
    found = scene.redrawn(positions, udim, at=at, side=side)
    points = drawing.crop(*at, side, side, scene.settings.resolution)
    wanted = scene.expected(points, positions, udim).reshape(side, side)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted).max() <= BOUND
    return found


@pytest.mark.parametrize("name", GRAPHS)
def test_graphs_of_all_kinds(device, name):
    check(device, Scene(device, sheet(), GRAPHS[name], settings_of()))


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_of_all_kinds(device, name):
    found = check(device, Scene(device, sheet(), GRAPHS["plain"], settings_of(shape=SHAPES[name])))
    assert (found.max() > 0) == (name != "no bulge")


@pytest.mark.parametrize(
    "response",
    [
        {"alpha_w": 0.0, "alpha_d": 0.0, "beta_w": 0.0, "beta_d": 0.0},
        {"alpha_w": 3.0, "alpha_d": 8.0, "log_stretch_limit": 0.3},
        {"beta_w": 1.0, "beta_d": 20.0},
    ],
)
def test_responses_of_all_kinds(device, response):
    settings = settings_of(response=response)
    check(device, Scene(device, sheet(), GRAPHS["plain"], settings))


@pytest.mark.parametrize("udim", [1001, 1002, 1011, 1012])
def test_elements_cross_the_borders_of_udims(device, udim):
    graph = random_graph(7, 150, span=2.0)
    scene = Scene(device, sheet(udims=2), graph, settings_of())
    u, v = udim_origin(udim)
    check(device, scene, at=(128 * v, 128 * (1 - u)), udim=udim)  # the corner that all four share


def test_a_crop_of_a_large_map(device):
    graph = random_graph(8, 3000, (0.0005, 0.002), (0.002, 0.01))
    scene = Scene(device, sheet(), graph, settings_of(resolution=4096))
    check(device, scene, at=(1536, 1024), side=256)


def test_pores_and_wrinkles_alone(device):
    graph = GRAPHS["plain"]
    for silent in ("edge_weight", "node_weight"):
        one = {**graph.arrays(), silent: 0 * getattr(graph, silent)}
        check(device, Scene(device, sheet(), type(graph)(**one), settings_of()))


def test_the_neutral_frame_draws_the_graph_as_it_is(device):
    scene = Scene(device, sheet(), GRAPHS["plain"], settings_of())
    found = scene.redrawn(None)
    points = drawing.crop(0, 0, 256, 256, 256)
    settings = scene.settings
    wanted = redraw.neutral(points, scene.graph, settings.shape, DEPTH).reshape(256, 256)
    assert np.abs(found - wanted).max() <= BOUND


def test_signs_of_axes_change_no_bit(device):
    scene = Scene(device, sheet(), GRAPHS["plain"], settings_of())
    stretch = scene.stretch(deform(scene.mesh.positions, 11, 0.15))
    axes = device.read(stretch.axes, (len(scene.mesh.faces) + 1, 4), np.float32)
    maps = []
    for signs in ([1, 1, 1, 1], [-1, -1, 1, 1], [1, 1, -1, -1], [-1, -1, -1, -1]):
        turned = type(stretch)(
            stretch.count,
            stretch.ratios,
            device.upload(axes * np.array(signs, np.float32)),
            stretch.logs,
        )
        elements = scene.elements()
        scales = respond(device, elements, scene.settings, turned)
        draw = redrawing(device, elements, scene.settings, scales)
        maps.append(render_to_host(device, draw, 0, 0, 0, 256))
    for other in maps[1:]:
        np.testing.assert_array_equal(other, maps[0])
