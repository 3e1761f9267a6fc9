"""Grain in what is drawn: against the reference, across seams, under stretch, in every method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.scenes import DEPTH, EDGE_BAND, random_graph, reference_stretch, settings_of, sheet
from reference import drawing, locate
from reference import grain as reference
from reference import patches as patches_reference
from reference.stretch import log_stretch
from rhytid.domain.graph import GraphOrigin
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Stiffness
from rhytid.domain.patch_noise import (
    DEVIATION,
    GRAIN_SALT,
    LEAST,
    MOST_DEVIATION,
    STRENGTH_SALT,
    cell_size,
    placement,
    table,
)
from rhytid.domain.tiles import TileAddress
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.grain import MOST_UNDULATION, relief_shares

SIZE, SHARE = 0.08, 0.03
SIDE = 256
GRAPH = random_graph(1, 40)
BARE = replace(
    GRAPH,
    node_weight=np.zeros_like(GRAPH.node_weight),
    edge_weight=np.zeros_like(GRAPH.edge_weight),
)
# Of even skin: factor of the grain and patchiness, at the corners of a triangle.
EVEN = np.array([1, 1, 1, 1, 1, 1, 0, 0, 0], np.float32)
GRAINY = {"grain": SHARE, "grain_size": SIZE}
METHODS = ["neutral", "redraw", "convolved"]


def asset_of(device, mesh=None, lines=GRAPH, shape=GRAINY, stiffness=None, **changes):
    settings = settings_of(shape=shape, **changes).resolved(0.1)
    asset = DeviceAsset(device, mesh or sheet(), settings, stiffness)
    asset.mesh.locate(lines)
    asset.mesh.install(asset.mesh.prepare(lines, settings), settings)
    return asset


def drawn(asset, frame=NEUTRAL_FRAME, method="redraw", sampling="nearest", at=(0, 0), side=SIDE):
    query = MapQuery(method, sampling=sampling)
    return asset.drawing.to_host(frame, query, asset.mesh.udims[0], 0, *at, side)


def noise_of(asset):
    """(R, R) of a map without lines: the noise, in root mean squares."""
    return drawn(asset) / (SHARE * DEPTH)


def expected(mesh, side=SIDE, size=SIZE, seed=1, octaves=reference.GRAIN, step=1):
    """The reference's noise at every texel, or every so many, and whether its triangle is sure."""
    points = drawing.crop(0, 0, side, side, side)
    points = points.reshape(side, side, 2)[::step, ::step].reshape(-1, 2)
    index, margin = locate.locate(points, mesh.triangle_uv(), 16 / side)
    corners = mesh.positions[mesh.faces].astype(np.float64)
    found = reference.grain(
        points, mesh.triangle_uv(), corners, np.maximum(index, 0),
        mesh.positions.astype(np.float64), size, side, seed, octaves,
    )  # fmt: skip
    noise = np.where(index < 0, 0, found).reshape(side // step, side // step)
    return noise, (margin > EDGE_BAND), index


@pytest.mark.parametrize(
    ("seed", "graph", "step"),
    [
        (1, {}, reference.STEP),
        (7, {}, reference.STEP),
        (1, {"patches": 1.0}, reference.UNEVEN_STEP),
        (1, {"anatomy": "fine"}, reference.UNEVEN_STEP),
    ],
)
def test_noise_is_that_of_the_reference(device, seed, graph, step):
    mesh = sheet()
    found = noise_of(asset_of(device, mesh, BARE, graph={"seed": seed, **graph}))
    wanted, sure, _ = expected(mesh, seed=seed)
    sure = sure.reshape(SIDE, SIDE)
    assert np.abs(found - wanted)[sure].max() <= 0.51 * step
    assert wanted.std() > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["node_grain", "node_undulation"])
def test_each_relief_is_as_rough_as_its_own_factor_of_pores_says(device, name):
    mesh, lines = sheet(n=6), random_graph(5, 400)
    rough = np.random.default_rng(2).uniform(0.2, 1.5, len(lines.node_uv)).astype(np.float32)
    lines = replace(lines, **{name: rough}, edge_weight=0 * lines.edge_weight)
    lines = replace(lines, node_weight=0 * lines.node_weight)
    broad = {"undulation": SHARE, "undulation_size": 0.5}
    shapes, octaves, size = [GRAINY, broad], [reference.GRAIN, reference.UNDULATION], [SIZE, 0.5]
    own = ["node_grain", "node_undulation"].index(name)
    shape = {"grain": 0.0, "undulation": 0.0} | shapes[own]
    noise, sure, index = expected(mesh, size=size[own], octaves=octaves[own])
    sure = (sure & (index >= 0)).reshape(SIDE, SIDE)
    points = drawing.crop(0, 0, SIDE, SIDE, SIDE)
    asset = asset_of(device, mesh, lines, shape)
    held = np.flatnonzero(asset.mesh.pore_triangle < len(mesh.faces))
    factor = reference.rough(
        mesh.triangle_uv().astype(float), mesh.faces, points, np.maximum(index, 0),
        asset.mesh.pore_triangle[held], rough[held].astype(float),
    ).reshape(SIDE, SIDE)  # fmt: skip
    assert np.abs(noise_of(asset) - factor * noise)[sure].max() <= 0.51 * reference.STEP
    assert factor[sure].std() > 0.05
    even, beside = replace(lines, **{name: None}), {"grain": 0.0, "undulation": 0.0}
    beside |= shapes[1 - own]
    one, other = (drawn(asset_of(device, mesh, graph, beside)) for graph in (lines, even))
    np.testing.assert_array_equal(one, other)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("salt", "octaves", "shape", "step"),
    [
        (GRAIN_SALT, reference.GRAIN, GRAINY, 1),
        (
            STRENGTH_SALT,
            reference.UNDULATION,
            {"grain": 0.0, "grain_size": SIZE, "undulation": SHARE, "undulation_size": SIZE},
            2,
        ),
    ],
)
@pytest.mark.parametrize(("unit", "wave"), [("cm", None), ("ell", 0.7)])
def test_grain_and_undulation_are_as_patchy_as_pores_say(
    device, salt, octaves, shape, step, unit, wave
):
    """In waves of the lines, which the graph says where the unit has no known length."""
    mesh, lines = sheet(n=6), random_graph(5, 400)
    amount = np.random.default_rng(2).uniform(0.0, 5.0, len(lines.node_uv)).astype(np.float32)
    none = {"edge_weight": 0 * lines.edge_weight, "node_weight": 0 * lines.node_weight}
    origin = GraphOrigin(unit, patch_size=wave)
    lines = replace(lines, node_patchiness=amount, origin=origin, **none)
    noise, sure, index = expected(mesh, octaves=octaves, step=step)
    inside = np.maximum(index, 0)
    points = drawing.crop(0, 0, SIDE, SIDE, SIDE).reshape(SIDE, SIDE, 2)[::step, ::step]
    points = points.reshape(-1, 2)
    asset = asset_of(device, mesh, lines, shape, unit=unit, graph={"patches": 1.0})
    held = np.flatnonzero(asset.mesh.pore_triangle < len(mesh.faces))
    share = reference.rough(
        mesh.triangle_uv().astype(float), mesh.faces, points, inside,
        asset.mesh.pore_triangle[held], amount[held].astype(float),
    )  # fmt: skip
    settings = asset.mesh.settings
    corners, uv = mesh.positions[mesh.faces].astype(float)[inside], mesh.triangle_uv()[inside]
    jacobian = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) @ np.linalg.inv(
        np.swapaxes(uv[:, 1:] - uv[:, :1], 1, 2)
    )
    places = corners[:, 0] + np.einsum("pij,pj->pi", jacobian, points - uv[:, 0])
    factor = patches_reference.factor(
        places, cell_size(settings, wave), table(), placement(settings.graph.start, salt), share,
        DEVIATION, MOST_DEVIATION, LEAST,
    ).reshape(noise.shape)  # fmt: skip
    assert factor.max() > MOST_UNDULATION
    if salt == STRENGTH_SALT:
        factor = np.minimum(factor, MOST_UNDULATION)
    wanted = np.clip(factor * noise, -127 * reference.UNEVEN_STEP, 127 * reference.UNEVEN_STEP)
    there = (sure & (index >= 0)).reshape(noise.shape)
    error = np.abs(noise_of(asset)[::step, ::step] - wanted)[there]
    assert error.max() <= 0.51 * reference.UNEVEN_STEP
    assert factor[there].std() > 0.2


@pytest.mark.parametrize(
    ("name", "value"), [("node_grain", 1.0), ("node_undulation", 1.0), ("node_patchiness", 0.0)]
)
def test_factors_of_even_skin_change_no_bit(device, name, value):
    even = replace(GRAPH, **{name: np.full(len(GRAPH.node_uv), value, np.float32)})
    both = GRAINY | {"undulation": SHARE, "undulation_size": 0.5}
    one, other = (drawn(asset_of(device, None, graph, both)) for graph in (even, GRAPH))
    np.testing.assert_array_equal(one, other)


def test_what_no_pore_says_goes_on_from_where_one_does():
    mesh = sheet()
    lines = replace(GRAPH, node_grain=np.full(len(GRAPH.node_uv), 0.5, np.float32))
    triangle = np.full(len(GRAPH.node_uv), len(mesh.faces), np.int32)
    even = np.tile(EVEN, (len(mesh.faces), 1))
    np.testing.assert_array_equal(relief_shares(mesh, lines, triangle), even)
    triangle[0] = 0
    found = relief_shares(mesh, lines, triangle)
    np.testing.assert_array_equal(found[:, :3], 0.5)
    np.testing.assert_array_equal(found[:, 3:], even[:, 3:])
    patchy = replace(lines, node_grain=None, node_patchiness=lines.node_grain)
    found = relief_shares(mesh, patchy, triangle)
    np.testing.assert_array_equal(found, even + 0.5 * (even == 0))
    triangle[1], lines.node_grain.flags.writeable = len(mesh.faces) - 1, True
    lines.node_grain[1] = 1.5
    found = relief_shares(mesh, lines, triangle)[:, :3]
    assert (found[0] == 0.5).all()
    assert (found[-1] == 1.5).all()
    assert len(np.unique(found)) > 2  # between them a mean
    assert relief_shares(mesh, GRAPH, triangle) is None


@pytest.mark.parametrize(("seed", "grain"), [(0, 0.03), (1, 0.0), (2**31 - 1, 0.03)])
def test_undulation_is_broad_noise_beside_the_grain(device, seed, grain):
    mesh, share, size = sheet(), 0.16, 0.5
    shape = {"grain": grain, "grain_size": SIZE, "undulation": share, "undulation_size": size}
    found = drawn(asset_of(device, mesh, BARE, shape, graph={"seed": seed})) / DEPTH
    broad, sure, _ = expected(mesh, size=size, seed=seed, octaves=reference.UNDULATION, step=2)
    wanted = share * broad + grain * expected(mesh, seed=seed, step=2)[0]
    step = np.hypot(share, grain) * reference.STEP
    wanted = np.clip(wanted, -127 * step, 127 * step)  # where codes end
    error = np.abs(found[::2, ::2] - wanted)
    assert error[sure.reshape(error.shape)].max() <= 0.51 * step
    assert broad.std() > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("texels", [3.0, 4.0, 8.0])
def test_octaves_are_as_high_as_means_over_texels(texels):
    """Square texels that lie anyhow in the noise, two cells per wave."""
    random = np.random.default_rng(0)
    across = np.linalg.qr(random.normal(size=(3, 3)))[0][:2] * 2 / texels
    places = random.uniform(0, 1000, (20000, 1, 3))
    inside = np.stack(np.meshgrid(*2 * [(np.arange(6) + 0.5) / 6 - 0.5]), axis=-1).reshape(-1, 2)
    points = (places + inside @ across).reshape(-1, 3)
    means = reference.noise(points, 5).reshape(len(places), -1).mean(axis=1)
    assert means.std() == pytest.approx(reference.carried(np.array(texels)), abs=0.015)


@pytest.mark.parametrize("octaves", [reference.GRAIN, reference.UNDULATION])
def test_octaves_have_the_power_of_one(octaves):
    assert np.linalg.norm(octaves.shares) == pytest.approx(1.0, abs=1e-3)


def test_heights_of_a_frame_are_those_of_the_reference(device):
    mesh = sheet()
    positions = deform(mesh.positions, 3, 0.15)
    plain, grainy = (asset_of(device, mesh, shape=shape) for shape in ({}, GRAINY))
    heights = drawn(plain, Frame.of(positions)).astype(np.float64)
    found = drawn(grainy, Frame.of(positions))
    noise, sure, index = expected(mesh)
    ratios, axes = reference_stretch(mesh, positions)
    logs, _ = locate.sample(index, log_stretch(ratios, 0.5), axes)
    gain = reference.gain(logs, 2.0).reshape(SIDE, SIDE)
    wanted = reference.shown(heights, noise, gain, SHARE * DEPTH, DEPTH)
    assert np.abs(found - wanted)[sure.reshape(SIDE, SIDE)].max() <= 1e-3 * DEPTH
    assert gain.max() > 1.2 > 0.9 > gain.min()


def charts(turned):
    """A flat square of 2 x 2 as a chart of 96 x 96 texels of 256, and beside it another: the same
    square, turned by 90 degrees in UV, or the square that goes on where the first ends."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    uv = 0.375 * corners
    other = 0.375 * np.stack([1 - corners[:, 1], corners[:, 0]], axis=1) if turned else uv
    square = 2.0 * np.pad(corners, ((0, 0), (0, 1)))
    beside = square + np.array([0.0 if turned else 2.0, 0, 0])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    charted = np.concatenate([uv, other + np.array([0.5, 0])])
    return Mesh(np.concatenate([square, beside]), faces, charted, faces)


def test_noise_knows_nothing_of_uv(device):
    found = noise_of(asset_of(device, charts(True), BARE))[::-1]  # v up
    one, other = found[:96, :96], found[:96, 128:224]
    assert one.std() > 0.5
    assert np.abs(one.T - other[:, ::-1]).max() <= 1.01 * reference.STEP


def test_noise_goes_on_across_a_seam_and_into_the_padding(device):
    found = noise_of(asset_of(device, charts(False), BARE))[::-1]
    beyond, inside = found[:96, 96:112], found[:96, 128:144]
    assert inside.std() > 0.5
    assert np.abs(beyond - inside).max() <= 1.01 * reference.STEP
    assert np.all(found[:, 241:] == 0)  # in no triangle, nor near one


def test_noise_has_its_root_mean_square_and_its_band(device):
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    flat = Mesh(2.0 * np.pad(corners, ((0, 0), (0, 1))), faces, corners, faces)
    asset = asset_of(device, flat, BARE, resolution=512)
    noise = drawn(asset, side=512) / (SHARE * DEPTH)
    carried = reference.carried(SIZE * 256 * 5.0 ** -np.array([0, 0.5, 1]))
    wanted = np.linalg.norm(reference.GRAIN.shares * carried)
    assert noise.std() == pytest.approx(wanted, rel=0.05)
    power = np.abs(np.fft.fft2(noise * np.outer(*2 * [np.hanning(512)]))) ** 2
    f = np.fft.fftfreq(512, 2 / 512)
    wave = 1 / np.maximum(np.hypot(f[:, None], f), 1e-9)
    inside = (wave < 3 * SIZE) & (wave > SIZE / 10)
    assert power[inside].sum() > 0.95 * power.sum()


@pytest.mark.parametrize("size", [0.001, 0.041])
def test_what_texels_do_not_carry_is_left_out(device, size):
    asset = asset_of(device, charts(True), BARE, {"grain": SHARE, "grain_size": size})
    np.testing.assert_array_equal(drawn(asset), 0.0)  # a texel is 0.0208


@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
@pytest.mark.parametrize("growth", [0.8, 1.25, 3.0])
def test_grain_fades_where_skin_is_stretched(device, growth, sampling):
    mesh = charts(True)
    asset = asset_of(device, mesh, BARE)
    still = drawn(asset, sampling=sampling)
    found = drawn(asset, Frame.of(mesh.positions * np.float32(growth)), sampling=sampling)
    gain = reference.gain(np.full(2, np.clip(np.log(growth), -0.5, 0.5)), 2.0)
    np.testing.assert_allclose(found, gain * still, atol=1e-3 * SHARE * DEPTH)
    assert (gain > 1) == (growth < 1)


@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
def test_rigid_skin_keeps_its_grain(device, sampling):
    mesh = charts(True)
    half = np.where(np.arange(256) < 128, 0.0, 0.5)[None].repeat(256, axis=0)
    asset = asset_of(device, mesh, BARE, stiffness=Stiffness({1001: half}))
    still = drawn(asset, sampling=sampling)
    found = drawn(asset, Frame.of(mesh.positions * np.float32(1.25)), sampling=sampling)
    gain = reference.gain(np.full((256, 256, 2), np.log(1.25)), 2.0, half)
    np.testing.assert_allclose(found, gain * still, atol=1e-3 * SHARE * DEPTH)
    assert np.abs(gain - 1)[:, 160:].max() > 0.1


def test_smooth_sampling_shows_no_edges_of_triangles(device):
    mesh = sheet()
    frame = Frame.of(deform(mesh.positions, 3, 0.15))
    asset = asset_of(device, mesh, BARE)
    steps = {}
    for sampling in ("nearest", "smooth"):
        still, found = drawn(asset, sampling=sampling), drawn(asset, frame, sampling=sampling)
        sure = np.abs(still) > 0.5 * SHARE * DEPTH
        gain = np.divide(found, still, out=np.ones_like(found), where=sure)
        both = (sure & np.roll(sure, 1, 1))[:, 1:]
        steps[sampling] = np.abs(np.diff(gain, axis=1))[both].max()
        assert gain.max() > 1.2
    assert steps["smooth"] < 0.25 * steps["nearest"]


def tile_of(asset, frame, method, row=0, column=0, sampling="nearest"):
    address = TileAddress(1001, 0, row, column)
    return asset.finest.tiles(frame, MapQuery(method, sampling=sampling), [address])[0]


@pytest.mark.parametrize("method", METHODS)
def test_relief_of_0_is_as_before_bit_for_bit(device, method):
    frame = Frame.of(deform(sheet().positions, 3, 0.15))
    off = {"grain": 0.0, "grain_size": 0.5, "undulation": 0.0, "undulation_size": 0.5}
    shapes = ({}, off)
    maps = [tile_of(asset_of(device, shape=shape), frame, method) for shape in shapes]
    np.testing.assert_array_equal(*maps)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sampling", ["nearest", "smooth"])
def test_tiles_equal_crops_bit_for_bit(device, method, sampling):
    shape = {**GRAINY, "cushion": 0.7}
    frame = Frame.of(deform(sheet().positions, 3, 0.15))
    small, large = (asset_of(device, shape=shape, tile_size=side) for side in (64, 256))
    whole = tile_of(large, frame, method, sampling=sampling)
    for row, column in ((0, 0), (1, 2), (3, 3)):
        tile = tile_of(small, frame, method, row, column, sampling)
        y, x = 64 * row, 64 * column
        np.testing.assert_array_equal(tile, whole[y : y + 64, x : x + 64])
    assert np.abs(whole).max() > 0.3 * DEPTH


def test_redraw_of_the_neutral_is_neutral_bit_for_bit(device):
    asset = asset_of(device, shape={**GRAINY, "cushion": 0.7})
    np.testing.assert_array_equal(drawn(asset, method="neutral"), drawn(asset, method="redraw"))


def test_convolving_leaves_grain_as_sharp_as_it_is(device):
    mesh = charts(True)
    asset = asset_of(device, mesh, BARE)
    still = tile_of(asset, NEUTRAL_FRAME, "neutral", 3)
    found = tile_of(asset, Frame.of(mesh.positions * np.float32(1.25)), "convolved", 3)
    gain = reference.gain(np.full(2, np.log(1.25)), 2.0)
    np.testing.assert_allclose(found, gain * still, atol=1e-3 * SHARE * DEPTH)
    assert still.std() > 0.3 * SHARE * DEPTH


def test_settings_change_without_synthesis(device):
    """What PATCH does: other settings of the grain and of the cushion, the same graph."""
    asset = asset_of(device)
    first = drawn(asset)
    still = asset.mesh.settings.changed({"shape": {"grain": 0.0}})
    assert not asset.mesh.prepares(still)
    asset.mesh.use(still)
    assert np.abs(drawn(asset) - first).max() > 0.01 * DEPTH
    swollen = still.changed({"shape": {"cushion": 0.5}})
    assert asset.mesh.prepares(swollen)
    asset.mesh.install(asset.mesh.prepare(GRAPH, swollen), swollen)
    assert np.abs(drawn(asset) - first).max() > 0.1 * DEPTH
    back = swollen.changed({"shape": {"cushion": 0.0, "grain": SHARE}})
    asset.mesh.install(asset.mesh.prepare(GRAPH, back), back)
    np.testing.assert_array_equal(drawn(asset), first)


@pytest.mark.parametrize(("unit", "size"), [("mm", 0.2), ("cm", 0.02), ("m", 2e-4), ("ell", 0.036)])
def test_the_usual_size_is_a_fifth_of_a_millimetre(unit, size):
    assert settings_of(unit=unit).resolved(0.1).shape.grain_size == pytest.approx(size)
    assert settings_of(unit=unit).resolved(0.1).shape.undulation_size == pytest.approx(30 * size)
    given = settings_of(unit=unit, shape={"grain_size": 3.0, "undulation_size": 7.0})
    assert given.resolved(0.1).shape.grain_size == 3.0
    assert given.resolved(0.1).shape.undulation_size == 7.0
