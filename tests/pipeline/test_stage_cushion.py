"""The broad layer of the wrinkles: against the reference, over any tiling, and at share 0."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from meshes import deform
from pipeline.binned import TILE, BinnedScene
from pipeline.scenes import DEPTH, Scene, random_graph, reference_stretch, settings_of, sheet
from pipeline.test_stage_bends import bent, shared
from reference import bends, drawing, locate, redraw
from reference import cushion as reference
from reference.response import wrinkle_stretch
from rhytid.device.launches import PIECE_SECONDS, DrawingPace
from rhytid.device.runtime import Device
from rhytid.domain.tiles import udim_origin
from rhytid.errors import LimitError
from rhytid.pipeline.bins import ShareRange
from rhytid.pipeline.blend import CushionBlend
from rhytid.pipeline.cushion import SAMPLES, CushionMaker
from rhytid.pipeline.cushion_layer import THRESHOLD, broad_weight, coarse_factor, narrow_weight
from rhytid.pipeline.element_arrays import check_cover, wrinkle_arrays
from rhytid.pipeline.work import BLOCK

# What cushion.cl claims, of the coarse map, and draw.clh of the fine one.
BOUND = 2e-4 * DEPTH
SWOLLEN = {"cushion": 0.7, "wrinkle_bulge": 1.0}
# Median half widths that so many texels to a coarse one carry at 1024 texels per side.
WIDTHS = {2: (0.0008, 0.0012), 4: (0.0018, 0.0022), 8: (0.004, 0.006), 16: (0.009, 0.015)}


def scene(device, graph=None, **changes):
    shape = {**SWOLLEN, **changes.pop("shape", {})}
    return Scene(device, sheet(), graph or random_graph(1), settings_of(shape=shape, **changes))


def check(made, at=(64, 64), side=128, udim=1001, seed=11):
    positions = deform(made.mesh.positions, seed, 0.15)
    found = made.redrawn(positions, udim, at=at, side=side)
    points = drawing.crop(*at, side, side, made.settings.resolution)
    wanted = made.expected(points, positions, udim).reshape(side, side)
    assert np.abs(wanted).max() > 0.3 * DEPTH
    assert np.abs(found - wanted).max() <= BOUND
    return found


@pytest.mark.parametrize(
    "factor", [pytest.param(f, marks=() if f == 4 else pytest.mark.slow) for f in WIDTHS]
)
def test_every_factor_is_that_of_the_reference(device, factor):
    graph = random_graph(3, 900, WIDTHS[factor], (0.01, 0.05))
    made = scene(device, graph, resolution=1024)
    assert made.elements().cushion.factor == factor
    assert made.reference_cushion().texels == 1024 // factor
    check(made, at=(320, 448), side=192)


@pytest.mark.parametrize(
    "shape",
    [
        {"cushion": 1.0},
        *(
            pytest.param(shape, marks=pytest.mark.slow)
            for shape in (
                {"cushion": 0.3, "cushion_width": 6.0, "cushion_sharpness": 1.0},
                {"cushion_width": 1.0, "cushion_sharpness": 12.0, "slots": 16},
            )
        ),
        {"wave_amplitude": 0.06, "wave_frequency": 4.0},
    ],
)
def test_shapes_of_all_kinds(device, shape):
    check(scene(device, shape=shape))


@pytest.mark.slow
@pytest.mark.parametrize("graph", [random_graph(3, 60, (0.003, 0.006), (0.5, 1.2)),
                                   random_graph(4, 200, (0.02, 0.05), (1e-5, 1e-3)),
                                   random_graph(6, 400, (0.0003, 0.002))],
                         ids=["long", "short", "finer than a coarse texel"])  # fmt: skip
def test_graphs_of_all_kinds(device, graph):
    check(scene(device, graph))


@pytest.mark.parametrize("udim", [1001, 1002, 1011, 1012])
def test_swelling_goes_on_across_the_borders_of_udims(device, udim):
    graph = random_graph(7, 150, span=2.0)
    made = Scene(device, sheet(udims=2), graph, settings_of(shape=SWOLLEN))
    u, v = udim_origin(udim)
    check(made, at=(128 * v, 128 * (1 - u)), udim=udim)  # the corner that all four share


@pytest.mark.parametrize(("side", "wave"), [(64, 0.06), (128, 0.0), (256, 0.06)])
def test_tiles_equal_crops_bit_for_bit(device, side, wave):
    graph = random_graph(8, 300, (0.001, 0.004), (0.1, 1.0))  # drawn in 4 x 4 blocks
    shape = {"wave_amplitude": wave, "wave_frequency": 4.0}
    made = scene(device, graph, shape=shape, resolution=512)
    positions = deform(made.mesh.positions, 3, 0.15)
    whole = made.redrawn(positions)
    for row in range(0, 512, side):
        for column in range(0, 512, side):
            tile = made.redrawn(positions, at=(row, column), side=side)
            np.testing.assert_array_equal(tile, whole[row : row + side, column : column + side])


@pytest.mark.slow
def test_any_launch_shape_gives_the_same_bits(device):
    positions, maps = deform(sheet().positions, 3, 0.15), []
    for shape in device.shapes:
        other = Device(device.info, device.budget.limit)
        other.shape = shape
        maps.append(scene(other, random_graph(31, 300)).redrawn(positions))
    for lanes in (16, 32):
        other = Device(device.info, device.budget.limit)
        other.shape = replace(device.shape, rows=32, lanes=lanes)
        maps.append(scene(other, random_graph(31, 300)).redrawn(positions))
    for found in maps[1:]:
        np.testing.assert_array_equal(found, maps[0])


def test_share_0_draws_as_before_bit_for_bit(device):
    graph = random_graph(9, 200)
    plain = Scene(device, sheet(), graph, settings_of())
    other = scene(device, graph, shape={"cushion": 0.0, "cushion_width": 8.0, "wrinkle_bulge": 2.5})
    assert plain.elements().cushion is None
    positions = deform(plain.mesh.positions, 4, 0.15)
    np.testing.assert_array_equal(other.redrawn(positions), plain.redrawn(positions))


def test_a_lone_line_keeps_its_depth(device):
    for angle in np.linspace(0, np.pi, 7):
        middle, along = np.array([0.503, 0.497]), 0.2 * np.array([np.cos(angle), np.sin(angle)])
        ends = np.stack([middle - along, middle + along]).astype(np.float32)
        graph = random_graph(1, 1)
        graph = replace(
            graph, node_uv=ends, node_weight=np.zeros(2, np.float32),
            edge_weight=np.ones(1, np.float32), edge_half_width=np.full(1, 0.02, np.float32),
        )  # fmt: skip
        depth = (
            -scene(device, graph, shape={"cushion": 0.9, "cushion_width": 1.0}).redrawn(None).min()
        )
        assert depth == pytest.approx(DEPTH, rel=0.03)


@pytest.mark.parametrize("half_width", [0.9, 1.3, 1.8, 2.6, 5.0])
def test_a_lone_line_keeps_its_mean(device, half_width):
    """Coarse texels: of what samples do not carry, too."""
    graph = replace(
        random_graph(1, 1), node_uv=np.float32([[0.303, 0.31], [0.697, 0.55]]),
        node_weight=np.zeros(2, np.float32), edge_weight=np.ones(1, np.float32),
        edge_half_width=np.full(1, half_width / 128, np.float32),
    )  # fmt: skip
    lone = {"cushion": 1.0, "cushion_width": 1.0, "wrinkle_bulge": 0.0}
    made = scene(device, graph, shape=lone)
    factor = made.elements().cushion.factor
    ends, wide = graph.node_uv.astype(float), half_width / 128
    length = np.linalg.norm(ends[1] - ends[0])
    # Of the profile (1 - t²)²: along the line 16/15 of the half width, around both ends π/3 of its
    # square; wider where it is drawn wider.
    texels = 256**2 * DEPTH
    round_ends = np.pi / 3 * wide**2
    whole = texels * (length * 16 / 15 * wide + round_ends)
    found = -made.redrawn(None).astype(float).sum()
    assert found == pytest.approx(whole, rel=0.01 + 0.1 * factor * half_width / 256)


def test_weak_lines_swell_nothing_and_none_pops():
    shape = settings_of(shape=SWOLLEN).shape
    weight = np.linspace(0, 1, 2001, dtype=np.float32)
    broad, narrow = broad_weight(weight, shape), narrow_weight(weight, shape)
    np.testing.assert_allclose([narrow, broad], reference.strengths(weight, 0.7), atol=1e-6)
    assert (broad[weight <= THRESHOLD] == 0).all()
    assert np.abs(np.diff(broad)).max() < 0.002
    full = weight >= 2 * THRESHOLD
    np.testing.assert_allclose((broad + narrow)[full], weight[full], rtol=1e-6)


def test_only_lines_that_swell_are_listed():
    graph, settings = random_graph(2, 400), settings_of(shape=SWOLLEN)
    graph = replace(graph, edge_weight=graph.edge_weight**2)  # a fair share of weak ones
    arrays = wrinkle_arrays(graph, np.zeros(400, np.int32), settings, 1001)
    listed = np.unique(arrays.cushion.lists.members)
    assert (arrays.cushion.sizes[listed, 1] > 0).all()
    assert 0 < len(listed) < 0.9 * len(arrays.sizes)


def test_no_factor_leaves_less_than_a_block():
    wide = random_graph(5, 30, (0.1, 0.3), (0.05, 0.5))
    assert coarse_factor(wide, settings_of(shape=SWOLLEN)) == 4  # of 256 texels
    faint = replace(wide, edge_weight=0.05 * wide.edge_weight)
    assert coarse_factor(faint, settings_of(shape=SWOLLEN)) == 2


@pytest.mark.parametrize(("share", "factor"), [(1.0, 8), (0.9, 8), (0.6, 4), (0.05, 4)])
def test_lines_narrower_beyond_a_seam_take_a_finer_grid_by_one_step(share, factor):
    graph, copies = random_graph(3, 900, (0.005, 0.006)), np.arange(450) + 450
    width, of = graph.edge_half_width.copy(), np.full(900, -1, np.int32)
    width[copies], of[copies] = share * width[:450], np.arange(450)
    seams = replace(graph, edge_half_width=width, edge_copy_of=of)
    without = replace(graph, edge_copy_of=np.full(900, -1, np.int32))
    settings = settings_of(shape=SWOLLEN, resolution=1024)
    given = (1024, 0.7, settings.shape.cushion_width, settings.shape.cushion_sharpness)
    assert coarse_factor(without, settings) == coarse_factor(graph, settings) == 8
    assert coarse_factor(seams, settings) == factor
    assert reference.Cushion.of(seams, *given).texels == 1024 // factor


def test_cushions_that_cover_too_much_are_refused():
    graph = random_graph(5, 200_000, (0.05, 0.051), (0.01, 0.02))
    silent = np.zeros(graph.pores, np.float32)
    graph = replace(graph, node_weight=silent, edge_weight=np.ones(200_000, np.float32))
    broad = {**SWOLLEN, "cushion_width": 8.0}
    flat, swollen = (settings_of(shape=shape, response={"alpha_w": 0.0}) for shape in ({}, broad))
    check_cover(graph, flat, 1001)
    with pytest.raises(LimitError, match=r"the cushions cover [0-9]+ times the map of UDIM 1001"):
        check_cover(graph, swollen, 1001)
    with pytest.raises(LimitError, match="the cushions cover"):
        wrinkle_arrays(graph, np.zeros(200_000, np.int32), swollen, 1001)


# Maps: those of the layer, and owners, of lines that bend, taper, share and go on.
BROAD = bent(random_graph(41, 150, (0.004, 0.01), (0.15, 0.4)), steepest=0.25)
OF_MAPS: dict[str, Any] = {
    "shape": {**SWOLLEN, "curvature": 1.0, "taper": 1.0},
    "response": {"ends": 1.0, "soft_limits": True},
    "bins": {"bits": 16},
}
CODES = 32767


class MapScene(Scene):
    """The maps of the layer around a tile, without those of bins, and those of the reference."""

    udim = 1001

    def __init__(self, device, graph, **changes):
        settings = settings_of(**{**OF_MAPS, **changes})
        super().__init__(device, sheet(), graph, settings)
        self.cushion = self.reference_cushion()
        self.maps = CushionMaker(device, self.elements(), settings).tile((64, 128, TILE))
        response = settings.response
        self.samples = reference.samples(response.log_stretch_limit, response.alpha_d)
        factor = settings.resolution // self.cushion.texels
        row, column = 64 // factor - 2, 128 // factor - 2
        self.centres = drawing.crop(
            row, column, self.maps.side, self.maps.side, self.cushion.texels
        )

    def lines(self, width_at, share_at, depth):
        """Of the broad layer.  width_at, share_at: log stretches that widths and shares have."""
        graph, response, shape = self.graph, self.settings.response, self.settings.shape
        half_width = bends.tapering(graph.edge_half_width, graph.edge_end_half_widths, shape.taper)
        weight = bends.tapering(graph.edge_weight, graph.edge_end_weights, shape.taper)
        weight *= (graph.edge_weight > 0)[:, None]
        if graph.edge_share is not None:
            shares = bends.at_ends(graph.edge_share, graph.edge_partners, response.ends)
            broad, share = reference.strengths(weight, self.cushion.share)[1], self.cushion.share
            most = bends.WIDEST / np.maximum((1.0 - share) / share * broad, 1e-9)
            most = np.minimum(most, bends.MOST_SHARED) / self.depth_scale(share_at)
            taken = bends.shared_depth(share_at, response.alpha_d, shares)
            depth = depth * np.minimum(taken, most)
        width = bends.scale(np.array(width_at), response.alpha_w, response.soft_limits)
        slopes = shape.curvature * graph.edge_slopes if graph.edge_slopes is not None else None
        strength = reference.strengths(weight, self.cushion.share)[1] * depth
        return drawing.Wrinkles(redraw.segments(graph), half_width * width, strength, slopes=slopes)

    def depth_scale(self, r):
        response = self.settings.response
        return bends.scale(np.asarray(r), -response.alpha_d, response.soft_limits)

    def codes(self, index):
        return self.maps.read(self.device, index, self.settings.bins.bits).ravel()

    def heights(self, index):
        """(P,) of a map, over the depth scale, in units of depth."""
        deepest = ShareRange.of(self.graph).deepest(self.settings.response, self.samples[index])
        scale = float(self.depth_scale(self.samples[index]))
        return self.codes(index) * reference.step(self.cushion, scale, deepest, 16)


@pytest.fixture(scope="module", params=["shared", "plain"])
def maps(device, request):
    return MapScene(device, shared(BROAD) if request.param == "shared" else BROAD)


@pytest.mark.parametrize("index", [0, 1, 3, 6])
def test_maps_are_those_of_the_reference_drawn_with_their_depth(maps, index):
    r = maps.samples[index]
    scale = maps.depth_scale(r)
    wanted = reference.heights(maps.centres, maps.lines(r, r, scale), maps.cushion) / scale
    found = maps.heights(index)
    assert np.abs(wanted).max() > 0.3
    assert np.abs(maps.codes(index)).max() < CODES
    # As far as arc.clh finds the nearest point of an arc; heights are up to 4 times as large.
    off = np.abs(found - wanted)
    assert np.quantile(off, 0.99) <= 1e-2
    assert np.sqrt(np.square(off).mean()) <= 2e-3
    # Depth that is multiplied on later is less where lines meet.
    flat = reference.heights(maps.centres, maps.lines(r, r, 1.0), maps.cushion)
    assert index == 3 or np.abs(found - flat).max() > 0.05


def test_owners_are_those_of_the_reference(maps):
    lines = maps.lines(0.0, maps.samples[1], 1.0)
    wanted = reference.owners(maps.centres, lines, maps.cushion)
    rows = maps.elements().wrinkle_rows[maps.maps.read_owners(maps.device).ravel()]
    sure = wanted.margin > 1e-2
    assert 0.7 < sure.mean() < 1
    assert len(np.unique(rows)) > 20
    np.testing.assert_array_equal(rows[sure], wanted.line[sure])
    places = maps.codes(reference.SAMPLES) / CODES
    owned = sure & (rows >= 0)
    assert places[owned].std() > 0.2
    off = np.abs(places - wanted.place)[owned]
    assert np.median(off) <= 1e-3
    assert np.quantile(off, 0.99) <= 0.02


def test_maps_and_owners_drawn_in_pieces_are_the_same_bits(device, monkeypatch):
    monkeypatch.setattr(DrawingPace, "took", lambda *_: None)
    made = Scene(device, sheet(), BROAD, settings_of(**{**OF_MAPS, "resolution": 512}))
    settings, elements = made.settings, made.elements()
    assert BLOCK * elements.cushion.factor <= 256

    def arrays(most):
        """Owners and codes, drawn in pieces of so much work."""
        elements.cushion_pace.per_second = most / PIECE_SECONDS
        tile = CushionMaker(device, elements, settings).tile((0, 0, 512))
        return [tile.read_owners(device)] + [
            tile.read(device, index, settings.bins.bits) for index in range(SAMPLES + 1)
        ]

    whole = arrays(np.inf)
    assert len(np.unique(whole[0])) > 20
    assert whole[-1][whole[0] < elements.wrinkles].std() > 0.2 * CODES
    for one, other in zip(whole, arrays(1.0), strict=True):
        np.testing.assert_array_equal(other, one)


def test_the_pace_of_the_layer_is_that_of_its_own_maps(device, monkeypatch):
    made = Scene(device, sheet(), BROAD, settings_of(**OF_MAPS))
    elements = made.elements()
    took = []
    monkeypatch.setattr(elements.cushion_pace, "took", lambda work, _: took.append(work))
    monkeypatch.setattr(elements.bins_pace, "took", lambda *_: pytest.fail("of another map"))
    CushionMaker(device, elements, made.settings).tile((0, 0, 256))
    work = elements.work.of(0, 0, 256)
    assert took == [(SAMPLES + 1) * work]  # all maps with owners


def test_a_blend_takes_the_stretch_of_owners(maps):
    """By the maps, owners and places of the product, which other tests look at."""
    positions = np.float32(0.93) * deform(maps.mesh.positions, 5, 0.15)
    stretch, response = maps.stretch(positions), maps.settings.response
    lines = BinnedScene.lines(maps, stretch)
    found = CushionBlend(maps.device, maps.settings, ShareRange.of(maps.graph))
    out = found.tiles([maps.maps], lines)
    got = maps.device.read(out, (maps.maps.side**2,), np.float32) / DEPTH
    limit = response.log_stretch_limit
    ratios, axes = reference_stretch(maps.mesh, positions)
    logs = bends.held(np.log(ratios), limit, limit)
    at = locate.sample(maps._wrinkle, logs, axes)
    r = bends.at_ends(
        wrinkle_stretch(*at, redraw.directions(maps.graph)), maps.graph.edge_partners, response.ends
    )
    rows = maps.elements().wrinkle_rows[maps.maps.read_owners(maps.device).ravel()]
    place = maps.codes(reference.SAMPLES) / CODES
    own = np.where(rows < 0, 0.0, r[rows, 0] + place * (r[rows, 1] - r[rows, 0]))
    heights = np.stack([maps.heights(index) for index in range(reference.SAMPLES)])
    wanted = reference.blended(heights, own, maps.samples, maps.depth_scale(own))
    assert own.std() > 0.05
    assert np.abs(got - wanted).max() <= 2e-4


@pytest.mark.parametrize("most", [0.3, 1.2])
def test_a_blend_finds_the_samples_around_any_stretch(maps, most):
    """most: largest r of an end, of that of the last sample. Owners of a vector differ."""
    count, last = maps.elements().wrinkles, maps.samples[-1]
    rng = np.random.default_rng(12)
    ends = rng.uniform(-most * last, most * last, (count + 1, 2)).astype(np.float32)
    blend = CushionBlend(maps.device, maps.settings, ShareRange.of(maps.graph))
    out = blend.tiles([maps.maps], maps.device.upload(ends))
    got = maps.device.read(out, (maps.maps.side**2,), np.float32) / DEPTH
    owned = ends[maps.maps.read_owners(maps.device).ravel()].astype(np.float64)
    own = owned[:, 0] + maps.codes(reference.SAMPLES) / CODES * (owned[:, 1] - owned[:, 0])
    heights = np.stack([maps.heights(index) for index in range(reference.SAMPLES)])
    wanted = reference.blended(heights, own, maps.samples, maps.depth_scale(own))
    assert (np.abs(own) > 0.7 * last).any() == (most > 1.0)
    assert np.abs(got - wanted).max() <= 2e-4


def test_owners_of_lines_without_bends_answer_alike_from_end_to_end(device):
    made = MapScene(device, random_graph(8, 200, (0.004, 0.02)), shape=SWOLLEN)
    assert made.maps.read_owners(device).max() == made.elements().wrinkles  # of none
    assert not made.codes(reference.SAMPLES).any()
