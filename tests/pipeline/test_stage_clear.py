"""Vectors of a tile that have nothing in them, over which a frame passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.binned import TILE, BinnedScene, stored_maps
from pipeline.scenes import DEPTH, random_graph, settings_of, sheet
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.bins import ShareRange
from rhytid.pipeline.blend import TILES_A_LAUNCH, Blend, CushionBlend
from rhytid.pipeline.cushion import SAMPLES
from rhytid.pipeline.vectors import VECTOR, VectorTriangles

CLEAR = 1 << VECTOR
# Of the map, from its corner on, that skin covers; the tile lies across its edges.
COVERED, AT = 0.36, (128, 64)
GRAPH = random_graph(31, 150, (0.002, 0.004), (0.01, 0.04), span=COVERED)
MERGES = ["soft", *(pytest.param(m, marks=pytest.mark.slow) for m in ("min", "signed", "mellow"))]


def scene(device, merge="soft", cushion=0.7, graph=GRAPH, cells=10):
    whole = sheet(cells)
    mesh = Mesh(whole.positions, whole.faces, np.float32(COVERED) * whole.uv, whole.face_uv)
    bins = {"count": 4, "samples": 3, "merge": merge, "depth_factored": True, "tilt": True}
    settings = settings_of(bins=bins, shape={"cushion": cushion}, padding=2)
    return BinnedScene(device, mesh, graph, settings, AT)


def members(made):
    """Where those of each vector begin, and all of them."""
    triangles, count = made.tile.triangles, TILE * TILE // VECTOR
    firsts = made.device.read(triangles.firsts, (count + 1,), np.int32)
    return firsts, made.device.read(triangles.members, (firsts[-1], 2), np.int32)


def marked(made):
    """Which vectors are marked as clear."""
    firsts, found = members(made)
    return found[firsts[:-1], 1] & CLEAR != 0


def owners(made):
    """Those of the broad layer as they are stored, by vector."""
    cushion = made.tile.cushion
    return made.device.read(cushion.owners, (cushion.side**2 // VECTOR, VECTOR), np.int32)


def cushion_codes(made):
    """Those of the broad layer as they are stored, places included."""
    codes = made.tile.cushion.codes
    return made.device.read(codes, (codes.nbytes,), np.int8)


def clear_samples(made):
    """Which vectors of samples have a height of 0 in all maps."""
    cushion, bits = made.tile.cushion, made.settings.bins.bits
    heights = [cushion.read(made.device, index, bits) for index in range(SAMPLES)]
    return ~np.any(heights, axis=0).reshape(-1, VECTOR).any(axis=1)


def without_code(made):
    """Which vectors have a code of 0 in all maps."""
    codes = stored_maps(made.device, made.tile, made.settings.bins)
    return ~codes.any(axis=0).reshape(-1, VECTOR).any(axis=1)


def bare(made):
    """Which vectors lie in no triangle and have no code."""
    firsts, found = members(made)
    alone = (np.diff(firsts) == 1) & (found[firsts[:-1], 0] == len(made.mesh.faces))
    return alone & without_code(made)


def under_clear(made):
    """Whether all samples that spline.clh reads for a vector are in clear vectors of them."""
    cushion, factor = made.tile.cushion, made.elements().cushion.factor
    clear = np.repeat(clear_samples(made), VECTOR).reshape(cushion.side, cushion.side)
    at = [divmod(VECTOR * i, TILE) for i in range(TILE * TILE // VECTOR)]
    corners = [((row + factor // 2) // factor, x // factor) for row, x in at]
    across = VECTOR // factor + 4
    return np.array([clear[row : row + 4, x : x + across].all() for row, x in corners])


def unmarked(made):
    """The tile with no vector marked."""
    device, (firsts, found), cushion = made.device, members(made), made.tile.cushion
    found[:, 1] &= CLEAR - 1
    triangles = VectorTriangles(device.upload(firsts), device.upload(found))
    if cushion is not None:
        cushion = replace(cushion, owners=device.upload(cushion.read_owners(device)))
    return replace(made.tile, triangles=triangles, cushion=cushion)


def test_vectors_without_triangle_code_and_cushion_are_marked(device):
    made = scene(device)
    wanted = bare(made) & under_clear(made)
    assert 0.2 < wanted.mean() < 0.8
    assert (bare(made) & ~wanted).any()
    np.testing.assert_array_equal(marked(made), wanted)


def test_without_cushions_code_and_triangle_alone_count(device):
    made = scene(device, cushion=0.0)
    assert made.tile.cushion is None
    assert 0.2 < bare(made).mean() < 0.8
    np.testing.assert_array_equal(marked(made), bare(made))


def test_skin_without_a_line_may_have_grain_and_is_not_marked(device):
    few = random_graph(31, 5, (0.002, 0.004), span=COVERED)
    made = scene(device, cushion=0.0, graph=few, cells=2)
    alone = np.diff(members(made)[0]) == 1
    assert (alone & without_code(made) & ~bare(made)).any()
    np.testing.assert_array_equal(marked(made), bare(made))


def test_clear_samples_are_marked_and_keep_their_owners(device):
    made = scene(device)
    stored, clear = owners(made), clear_samples(made)
    assert 0.2 < clear.mean() < 0.8
    np.testing.assert_array_equal(stored[:, 0] < 0, clear)
    assert (stored[:, 1:] >= 0).all()
    found = made.tile.cushion.read_owners(made.device).reshape(-1, VECTOR)
    np.testing.assert_array_equal(found[:, 1:], stored[:, 1:])
    np.testing.assert_array_equal(found[:, 0], np.where(clear, ~stored[:, 0], stored[:, 0]))


@pytest.mark.parametrize("merge", MERGES)
@pytest.mark.parametrize("cushion", [0.0, 0.7])
def test_what_is_marked_has_the_bits_that_it_had(device, merge, cushion):
    made = scene(device, merge, cushion)
    positions = deform(made.mesh.positions, 5, 0.15)
    stretch = made.stretch(positions)
    blend, lines = Blend(device, made.settings, len(made.mesh.faces)), made.lines(stretch)
    held = blend.coefficients(stretch)
    found, wanted = (
        device.read(blend.tile(tile, held, lines=lines), (TILE * TILE,), np.float32)
        for tile in (made.tile, unmarked(made))
    )
    assert marked(made).any()
    assert np.abs(found).max() > 0.3 * DEPTH
    np.testing.assert_array_equal(found.view(np.int32), wanted.view(np.int32))


def test_a_frame_passes_over_marked_vectors(device):
    made = scene(device)
    firsts, found = members(made)
    drawn = stored_maps(device, made.tile, made.settings.bins).any(axis=0)
    vector = int(np.flatnonzero(drawn)[0]) // VECTOR
    found[firsts[vector], 1] |= CLEAR
    triangles = VectorTriangles(device.upload(firsts), device.upload(found))
    stretch = made.stretch(deform(made.mesh.positions, 5, 0.15))
    blend, lines = Blend(device, made.settings, len(made.mesh.faces)), made.lines(stretch)
    held = blend.coefficients(stretch)
    before, after = (
        device.read(blend.tile(tile, held, lines=lines), (TILE * TILE,), np.float32)
        for tile in (made.tile, replace(made.tile, triangles=triangles))
    )
    own = slice(vector * VECTOR, (vector + 1) * VECTOR)
    assert before[own].any()
    before[own] = 0.0
    np.testing.assert_array_equal(after, before)


def test_heights_of_several_tiles_are_those_of_each_alone(device):
    made = scene(device)
    stretch = made.stretch(deform(made.mesh.positions, 5, 0.15))
    shape = replace(made.settings.shape, grain=0.1)
    grainy = replace(made.settings, shape=shape)
    blend, lines = Blend(device, grainy, len(made.mesh.faces)), made.lines(stretch)
    held, one = blend.coefficients(stretch), made.tile
    firsts, found = members(made)
    alone_in = np.arange(len(firsts), dtype=np.int32)  # each vector in its first triangle
    codes = device.read(one.codes, (one.codes.nbytes,), np.int8)
    other = replace(
        one,
        triangles=VectorTriangles(device.upload(alone_in), device.upload(found[firsts[:-1]])),
        codes=device.upload(codes[::-1]),
        cushion=replace(one.cushion, codes=device.upload(np.zeros_like(cushion_codes(made)))),
    )
    grains = [device.upload(np.full(TILE * TILE, code, np.int8)) for code in (-50, 90)]

    def heights(tiles):
        given = [grains[int(tile is other)] for tile in tiles]
        made_of = blend.tiles(tiles, held, given, lines)
        return [device.read(buffer, (TILE * TILE,), np.float32) for buffer in made_of]

    alone = {id(tile): heights([tile])[0] for tile in (one, other)}
    assert (alone[id(one)] != alone[id(other)]).any()
    for at in range(TILES_A_LAUNCH):
        tiles = [one] * TILES_A_LAUNCH + [other]
        tiles[at] = other
        for tile, got in zip(tiles, heights(tiles), strict=True):
            np.testing.assert_array_equal(got, alone[id(tile)])


def test_samples_of_several_tiles_are_those_of_each_alone(device):
    made, stored = scene(device), owners(scene(device))
    vector = int(np.flatnonzero(~clear_samples(made))[0])
    stored[vector, 0] = ~stored[vector, 0]
    one = made.tile.cushion
    marked = replace(one, owners=device.upload(stored))
    lines = made.lines(made.stretch(deform(made.mesh.positions, 5, 0.15)))
    blend, samples = CushionBlend(device, made.settings, ShareRange.of(made.graph)), one.side**2
    alone = [
        device.read(blend.tiles([tile], lines), (samples,), np.float32) for tile in (one, marked)
    ]
    assert (alone[0] != alone[1]).any()
    for several in ([one, marked, one, marked, marked], [one, *[marked] * (TILES_A_LAUNCH - 1)]):
        got = device.read(blend.tiles(several, lines), (len(several), one.values), np.float32)
        for tile, values in zip(several, got, strict=True):
            np.testing.assert_array_equal(values[:samples], alone[int(tile is marked)])


def test_a_frame_passes_over_marked_samples(device):
    made, stored = scene(device), owners(scene(device))
    vector = int(np.flatnonzero(~clear_samples(made))[0])
    stored[vector, 0] = ~stored[vector, 0]
    marked = replace(made.tile.cushion, owners=device.upload(stored))
    lines = made.lines(made.stretch(deform(made.mesh.positions, 5, 0.15)))
    blend = CushionBlend(device, made.settings, ShareRange.of(made.graph))
    before, after = (
        device.read(blend.tiles([tile], lines), (tile.side**2,), np.float32)
        for tile in (made.tile.cushion, marked)
    )
    own = slice(vector * VECTOR, (vector + 1) * VECTOR)
    assert before[own].any()
    before[own] = 0.0
    np.testing.assert_array_equal(after, before)
