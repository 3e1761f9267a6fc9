"""Precomputed maps and their blend (section 2.4, Alg. 3) against the reference."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.binned import BinnedScene, stored_maps
from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from reference import bins as reference
from rhytid.device.launches import PIECE_SECONDS, DrawingPace
from rhytid.pipeline.bin_maker import BinMaker
from rhytid.pipeline.bins import (
    ShareRange,
    directions,
    quantisation_steps,
    sample_stretches,
)
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.work import timed

TILE = 64
GRAPH = random_graph(21, 300)
CHOICES = [
    {"count": 4, "samples": 3, "bits": 8},
    {"count": 1, "samples": 5, "bits": 16},
    {"count": 2, "samples": 7, "bits": 8},
    {"count": 16, "samples": 3, "bits": 16, "r_max": 0.4},
    {"count": 2, "samples": 3, "bits": 8, "merge": "mellow"},
    {"count": 8, "samples": 5, "bits": 8, "depth_factored": True},
    {"count": 4, "samples": 3, "bits": 16, "merge": "mellow", "depth_factored": True},
]

# On the device, where each has programs of its own.
DRAWN = [
    pytest.param(choice, marks=pytest.mark.slow if number in (2, 3, 5) else ())
    for number, choice in enumerate(CHOICES)
]


def scene(device, choice, **more):
    return BinnedScene(device, sheet(), GRAPH, settings_of(bins=choice, **more))


@pytest.mark.parametrize("choice", DRAWN)
def test_codes_are_the_drawing_rounded_to_the_step(device, choice):
    made = scene(device, choice)
    steps = quantisation_steps(made.settings).astype(np.float64)
    most = np.abs(made.codes()).max(axis=(1, 3)) / 2 ** (choice["bits"] - 1)
    assert (most[:, 0] > 0.05).all()
    assert (most[:-1] > 0.05).all()  # bulges too, but pores have none
    for layer, codes in enumerate(made.codes()):
        fine = reference.steps(replace(made.settings.bins, bits=31), DEPTH, exponent(made, layer))
        exact = made.reference_codes(layer, 31) * fine[:, None, None]
        step = steps[layer][:, None, None]
        assert (np.abs(codes * step - exact) <= 0.5 * step * (1 + 1e-5) + 1e-4 * DEPTH).all()
        same = codes == made.reference_codes(layer)
        assert same.mean() > (0.995 if choice["bits"] == 8 else 0.9)


def exponent(made, layer):
    response = made.settings.response
    return response.beta_d if layer == made.settings.bins.count else response.alpha_d


@pytest.mark.parametrize("choice", DRAWN)
def test_blending_the_codes_is_that_of_the_reference(device, choice):
    made = scene(device, choice)
    positions = deform(made.mesh.positions, 5, 0.15)
    wanted, sure = made.reference_blend(made.codes(), positions)
    assert sure.mean() > 0.98
    found = made.blended(positions)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    # r is exact to 1e-5, and so is its share of the difference of two samples.
    assert np.abs(found - wanted)[sure].max() <= 1e-4 * DEPTH


@pytest.mark.parametrize("merge", ["min", "soft", "signed", "mellow"])
def test_the_whole_fast_method_is_that_of_the_reference(device, merge):
    made = scene(device, {**CHOICES[0], "merge": merge})
    positions = deform(made.mesh.positions, 6, 0.15)
    found = made.blended(positions)
    codes = [made.reference_codes(layer) for layer in range(5)]
    wanted, sure = made.reference_blend(codes, positions)
    step = quantisation_steps(made.settings).max()
    assert np.abs(found - wanted)[sure].max() <= step * 1.01  # where a code rounds the other way
    assert np.sqrt(np.square(found - wanted)[sure].mean()) <= 0.05 * step


@pytest.mark.parametrize("udim", [1001, 1002, 1011])
def test_maps_of_every_udim(device, udim):
    settings = settings_of(bins=CHOICES[0])
    graph = random_graph(22, 300, span=2.0)
    made = BinnedScene(device, sheet(udims=2), graph, settings, (128, 64), udim)
    positions = deform(made.mesh.positions, 7, 0.15)
    for layer, codes in enumerate(made.codes()):
        assert (np.abs(codes - made.reference_codes(layer)) <= 1).all()
    wanted, sure = made.reference_blend(made.codes(), positions)
    assert np.abs(made.blended(positions) - wanted)[sure].max() <= 1e-4 * DEPTH


def test_without_stretch_the_middle_sample_comes_out(device):
    made = scene(device, CHOICES[2])
    middle = made.codes()[:, 3, 0] * quantisation_steps(made.settings)[:, 3:4]
    np.testing.assert_allclose(made.blended(None), middle.min(axis=0), atol=1e-7 * DEPTH, rtol=0)


@pytest.mark.parametrize("choice", CHOICES)
def test_steps_samples_and_directions_are_those_of_the_reference(choice):
    settings = settings_of(bins=choice)
    bins, response = settings.bins, settings.response
    found = quantisation_steps(settings)
    for layer in range(bins.count + 1):
        factor = response.beta_d if layer == bins.count else response.alpha_d
        np.testing.assert_allclose(found[layer], reference.steps(bins, DEPTH, factor), rtol=1e-6)
    np.testing.assert_allclose(sample_stretches(settings), reference.samples(bins), atol=1e-15)
    assert sample_stretches(settings)[bins.samples // 2] == 0.0
    np.testing.assert_allclose(directions(bins.count), reference.directions(bins.count), atol=1e-15)


def test_no_code_saturates_where_one_furrow_is_alone(device):
    made = scene(device, {"count": 1, "samples": 3, "bits": 8, "r_max": 0.45})
    assert np.abs(made.codes()).max() <= 127
    deepest = math.exp(0.45 * made.settings.response.alpha_d)
    assert quantisation_steps(made.settings)[0, 0] * 127 >= min(deepest, 4.0) * DEPTH


def test_small_maps_share_a_step_and_large_ones_have_their_own(device, monkeypatch):
    steps = []

    def spy(device, pace, work, draw):
        steps.append(work)
        timed(device, pace, work, draw)

    monkeypatch.setattr("rhytid.pipeline.bin_maker.timed", spy)
    monkeypatch.setattr(DrawingPace, "took", lambda *_: None)
    scene = BinnedScene(device, sheet(), GRAPH, settings_of())
    elements = scene.elements(1001)
    maker = BinMaker(device, elements, scene.located, scene.settings)
    work, found = elements.work.of(64, 128, TILE), []
    samples = scene.settings.bins.samples  # which are drawn at once
    for share in (1000, 16 * 2 * samples, 16):
        steps.clear()
        elements.bins_pace.per_second = share * work / PIECE_SECONDS
        made = stored_maps(device, maker.tile(64, 128, TILE), scene.settings.bins)
        found.append((made, [round(step / work) for step in steps]))
    count, shared = len(found[0][0]), [shared for _, shared in found]
    pairs, single = divmod(count, 2 * samples)
    assert shared == [[count], [2 * samples] * pairs + [single], [samples] * (count // samples)]
    assert all(np.array_equal(made, found[0][0]) for made, _ in found)


@pytest.mark.parametrize("count", [1, 2, 4, 5, 9])
def test_tiles_of_one_launch_are_those_of_many(device, count):
    scene = BinnedScene(device, sheet(), random_graph(6, 300), settings_of())
    elements, settings = scene.elements(1001), scene.settings
    maker = BinMaker(device, elements, scene.located, settings)
    tiles = [maker.tile(64 * (i // 4), 64 * (i % 4), 64) for i in range(count)]
    blend = Blend(device, settings, len(sheet().faces))
    held = blend.coefficients(scene.stretch(deform(sheet().positions, 2, 0.15)))
    alone = [device.read(blend.tile(tile, held), (64, 64), np.float32) for tile in tiles]
    found = [device.read(out, (64, 64), np.float32) for out in blend.tiles(tiles, held)]
    assert np.abs(alone).max() > 0
    np.testing.assert_array_equal(found, alone)


def test_tiles_of_one_launch_have_their_own_broad_layer(device):
    """Of the seventeen the last begins another launch."""
    scene = BinnedScene(device, sheet(), random_graph(6, 300), settings_of(shape={"cushion": 0.7}))
    elements, settings = scene.elements(1001), scene.settings
    maker = BinMaker(device, elements, scene.located, settings)
    tiles = [maker.tile(64 * (i // 4), 64 * (i % 4), 64) for i in [*range(16), 5]]
    blend = Blend(device, settings, len(sheet().faces), ShareRange.of(scene.graph))
    stretch = scene.stretch(deform(sheet().positions, 2, 0.15))
    held, lines = blend.coefficients(stretch), scene.lines(stretch)
    alone = [device.read(blend.tile(t, held, lines=lines), (64, 64), np.float32) for t in tiles]
    found = [
        device.read(out, (64, 64), np.float32) for out in blend.tiles(tiles, held, None, lines)
    ]
    assert len({one.tobytes() for one in alone}) == 16
    np.testing.assert_array_equal(found, alone)
