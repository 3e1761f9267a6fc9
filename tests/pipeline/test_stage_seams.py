"""The two sides of a UV seam show the same skin: a folded sheet in two charts that are turned,
stretched and scaled against each other, drawn in float64 and by the product."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from pipeline.scenes import DEPTH, reference_stretch, settings_of
from reference import bends, redraw, stretch
from reference.response import on_surface, pore_stretch, scales, wrinkle_stretch
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.engine.device_assets.asset import DeviceAsset
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.engine.messages import MapQuery
from rhytid.pipeline.element_arrays import pore_arrays, wrinkle_arrays
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.redraw import respond
from rhytid.pipeline.stretch import StretchStage
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.surface import Surface
from synthesis import sheets
from synthesis.seam_places import seam_places

pytestmark = pytest.mark.release

N = 8
BAND = 0.02  # of the rms of the heights
BENT = {"curvature": 1.0, "taper": 1.0}
SWOLLEN = {**BENT, "cushion": 0.7, "grain": 0.02, "grain_size": 0.02}
SWOLLEN = {**BENT, "cushion": 0.7}


def folded(
    angle: float = 35.0,
    mirrored: bool = False,
    across: float = 0.7,
    steps: Sequence[float] = (1.0,) * N,
    strips: Sequence[float] = (1.0,) * N,
) -> Mesh:
    """Two unit squares that meet at right angles, each a chart: the second is turned, 1.3 times as
    dense along the seam and `across` times across. Vertices are split along the seam.

    steps, strips: shares of the second chart that quads have along the seam and across."""
    x, y = np.meshgrid(np.linspace(0, 1, N + 1), np.linspace(0, 1, N + 1))
    x, y = x.ravel(), y.ravel()
    flat, up = np.stack([x - 1, y, np.zeros_like(x)], 1), np.stack([np.zeros_like(x), y, x], 1)
    corner = (np.arange(N)[:, None] * (N + 1) + np.arange(N)).reshape(-1, 1)
    quads = np.stack(
        [corner + np.array([0, 1, N + 2]), corner + np.array([0, N + 2, N + 1])], 1
    ).reshape(-1, 3)
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    over, along = (_shared(*given) for given in ((x, strips), (y, steps)))
    local = np.stack([across * (over - 0.5), 1.3 * (along - 0.5)], 1) * (0.25, 0.25)
    if mirrored:
        local = local * (-1, 1)
    second = np.array([0.72, 0.6]) + local @ [[cos, sin], [-sin, cos]]
    uv = np.concatenate([0.05 + 0.35 * np.stack([x, y], 1), second])
    faces = np.concatenate([quads, quads + len(x)])
    return Mesh(np.concatenate([flat, up]).astype(np.float32), faces, uv, faces)


def _shared(x: np.ndarray, shares: Sequence[float]) -> np.ndarray:
    """x in N even steps, taken to steps of these shares."""
    return np.interp(x * N, np.arange(N + 1), np.cumsum([0.0, *shares]) / np.sum(shares))


# What differs at a seam is of a few wrinkles at corners, others in each skin: these are known.
EVEN = replace(sheets.wanted(3000), patches=0.0)


def smiling(mesh: Mesh) -> np.ndarray:
    """Positions in which the stretch differs from triangle to triangle, across the seam as well."""
    p = mesh.positions.astype(float)
    wave = 0.12 * np.sin(3 * p[:, [1]] + 1) * np.cos(2 * p[:, [0]] + 3 * p[:, [2]])
    return (p * [1.25, 0.85, 1.1] + wave * [0.6, 1.0, 0.8]).astype(np.float32)


def places(mesh: Mesh, spacing: float):
    """Those a pore spacing or more from the ends of the seam."""
    found = seam_places(mesh, Surface.of(mesh).carries, 0.2 * spacing, np.radians(20))
    far = found.corner > spacing
    return found.here[far], found.there[far]


def apart(one: np.ndarray, two: np.ndarray) -> float:
    """How much two heights differ, over their rms."""
    return float(np.sqrt(np.mean((one - two) ** 2) / np.mean(one**2)))


@pytest.fixture(scope="module", params=[False, True], ids=["turned", "mirrored"])
def made(request: pytest.FixtureRequest, device: Device):
    mesh = folded(mirrored=request.param)
    if request.param:  # the other way round in UV, so outwards as before
        assert np.linalg.det(mesh.triangle_uv()[-1][1:] - mesh.triangle_uv()[-1][0]) < 0
    found = synthesize(mesh, EVEN, device)
    return mesh, found.graph, found.spacing


def test_neutral_heights_are_equal_on_both_sides(made) -> None:
    mesh, graph, spacing = made
    settings = settings_of()
    here, there = places(mesh, spacing)
    heights = [redraw.neutral(uv, graph, settings.shape, 1.0) for uv in (here, there)]
    assert np.sqrt(np.mean(heights[0] ** 2)) > 0.1
    assert apart(*heights) < BAND
    alone = replace(
        graph,
        node_weight=graph.node_weight * graph.own_nodes,
        edge_weight=graph.edge_weight * graph.own_edges,
    )
    assert apart(*(redraw.neutral(uv, alone, settings.shape, 1.0) for uv in (here, there))) > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("straight", [True, False], ids=["straight", "bent"])
@pytest.mark.parametrize(
    "layout",
    [{"across": 0.05}, {"strips": (0.03, *(1.0,) * (N - 1))}],
    ids=["narrow chart", "narrow triangles at the seam"],
)
def test_ends_that_are_round_in_uv_are_not_seen_beyond_a_seam(
    device: Device, layout: dict[str, Any], straight: bool
) -> None:
    """Where UV are squeezed twentyfold a round end would reach twenty times as far on the surface:
    over a seam that the wrinkle does not touch, where nothing of it is."""
    assert off_at_seam(device, folded(**layout), straight) < BAND


# What is left comes from wrinkles at the corners of triangles: an affine copy is there as far from
# the seam on one side as on the other only where triangles are as dense along it.
@pytest.mark.slow
@pytest.mark.parametrize("straight", [True, False], ids=["straight", "bent"])
@pytest.mark.parametrize(
    "steps",
    [(1, 3) * (N // 2), (0.35, 0.63, 1.64, 1.25, 0.37, 0.98, 1.06, 0.49)],
    ids=["to and fro", "unlike"],
)
def test_what_is_copied_twice_at_a_corner_is_not_seen_twice(
    device: Device, steps: Sequence[float], straight: bool
) -> None:
    """One side of the seam is as dense all along, the other changes at every corner."""
    assert off_at_seam(device, folded(steps=steps), straight) < 3 * BAND


def off_at_seam(device: Device, mesh: Mesh, straight: bool) -> float:
    """How much both sides differ in the usual look, without cushions, or with straight lines."""
    found = synthesize(mesh, EVEN, device)
    graph, shape = found.graph, settings_of(shape={} if straight else BENT).shape
    lines = redraw.wrinkles(graph)
    if not straight:
        none = np.zeros(graph.wrinkles)
        lines = bends.lines(graph, none, settings_of().response, shape, 0.0, (0.0, 0.0))
    discs = redraw.pores(graph)
    sides = places(mesh, found.spacing)
    return apart(*(redraw.draw(uv, lines, discs, shape, 1.0) for uv in sides))


def test_what_swells_is_copied_as_far_as_it_swells(device: Device) -> None:
    """3.3 times its half width, times exp(0.5) where the usual response makes it widest."""
    mesh = folded()
    graph = synthesize(mesh, sheets.wanted(3000), device).graph
    own = np.flatnonzero(graph.own_edges & (graph.edge_triangle < N * N * 2))
    uv = redraw.segments(graph)[own]
    # The first chart is even: 0.35 of UV to a unit of the sheet, and ends at u = 0.4.
    away = (0.4 - uv[..., 0]).min(axis=1) / graph.edge_half_width[own]
    weights = np.maximum(graph.edge_weight, graph.edge_end_weights.max(axis=1))[own]
    copied = np.isin(own, graph.edge_copy_of)
    inner = (np.abs(uv[..., 1] - 0.225) < 0.15).all(axis=1) & (away > 0)
    swells, reach = weights > 0.08, 3.3 * np.exp(0.5)
    assert copied[inner & swells & (away < reach)].all()
    assert (inner & swells & (away > 4.3) & (away < reach)).sum() > 5
    assert not copied[inner & ~swells & (away > 4.5)].any()
    assert not copied[inner & (away > reach + 0.5)].any()


@pytest.mark.parametrize("angles", ["uv", "surface"])
def test_stretched_heights_are_equal_on_both_sides(device: Device, made, angles: str) -> None:
    mesh, graph, spacing = made
    settings = settings_of(angles=angles)
    scales = reference_scales(mesh, graph, settings, smiling(mesh))
    assert scales[0].min() < 0.8 < 1.2 < scales[0].max()
    here, there = places(mesh, spacing)
    lines, discs = redraw.wrinkles(graph, *scales[:2]), redraw.pores(graph, *scales[2:])
    drawn = [redraw.draw(uv, lines, discs, settings.shape, 1.0) for uv in (here, there)]
    assert apart(*drawn) < BAND


@pytest.mark.slow
@pytest.mark.parametrize("changed", [False, True], ids=["as they are", "curved alike"])
def test_arcs_that_taper_are_equal_on_both_sides(made, changed: bool) -> None:
    """Of what comes over a mirrored seam slopes have the other sign."""
    mesh, graph, spacing = made
    settings = settings_of(shape=BENT, response={"ends": 1.0})
    here, there = places(mesh, spacing)
    r = reference_stretches(mesh, graph, settings, smiling(mesh))
    assert np.abs(graph.edge_slopes[~graph.own_edges]).max() > 0.3
    if changed:
        graph = replace(graph, edge_slopes=np.abs(graph.edge_slopes) * [1, -1])
    lines = bends.lines(graph, r, settings.response, settings.shape, 0.0, (0.0, 0.0))
    drawn = [redraw.draw(uv, lines, None, settings.shape, 1.0) for uv in (here, there)]
    mirrored = graph.edge_slopes[~graph.own_edges] @ [1, -1] < 0
    if changed and (np.linalg.det(mesh.triangle_uv()[-1][1:] - mesh.triangle_uv()[-1][0]) < 0):
        assert not mirrored.any()
        assert apart(*drawn) > 0.1
    else:
        assert apart(*drawn) < BAND


def test_copies_answer_at_their_ends_as_their_originals(device: Device, made) -> None:
    mesh, graph, _ = made
    settings = settings_of(shape=BENT, response={"ends": 1.0})
    copies = np.flatnonzero(~graph.own_edges)
    assert (graph.edge_partners[copies] >= 0).any(axis=1).mean() > 0.5
    elements = elements_of(device, graph, settings)
    limit = settings.response.log_stretch_limit
    measured = StretchStage(device, mesh).run(smiling(mesh), limit, "tensor", "uv")
    scales = respond(device, elements, settings, measured)
    found = device.read(scales.wrinkles, (elements.wrinkles, 4), np.float32)
    r = reference_stretches(mesh, graph, settings, smiling(mesh))
    lines = bends.lines(graph, r, settings.response, settings.shape, 0.0, (0.0, 0.0))
    even = graph.edge_half_width, graph.edge_end_half_widths
    wanted = lines.half_width / bends.tapering(*even, settings.shape.taper)
    # Elements are sorted: as sets their scales are those of the reference.
    for end in (0, 1):
        np.testing.assert_allclose(np.sort(found[:, end]), np.sort(wanted[:, end]), rtol=2e-3)


@pytest.mark.parametrize("angles", ["uv", "surface"])
def test_copies_answer_to_stretch_as_their_originals(device: Device, made, angles: str) -> None:
    mesh, graph, _ = made
    settings = settings_of(angles=angles)
    elements = elements_of(device, graph, settings)
    measured = StretchStage(device, mesh).run(
        smiling(mesh), settings.response.log_stretch_limit, "tensor", angles
    )
    scales = respond(device, elements, settings, measured)
    wanted = reference_scales(mesh, graph, settings, smiling(mesh))
    # Elements are sorted: as sets their scales are those of the reference.
    drawn = graph.node_weight > 0
    for buffer, (width, depth) in (
        (scales.wrinkles, wanted[:2]),
        (scales.pores, (wanted[2][drawn], wanted[3][drawn])),
    ):
        found = device.read(buffer, (len(width), 2), np.float32)
        np.testing.assert_allclose(np.sort(found[:, 0]), np.sort(width), rtol=2e-3)
        np.testing.assert_allclose(np.sort(found[:, 1]), np.sort(depth), rtol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sampling", "waves", "bent"),
    [
        pytest.param("nearest", 0.0, {}, id="straight-nearest"),
        pytest.param("smooth", 0.01, {}, id="wavy-smooth"),
        pytest.param("nearest", 0.01, BENT, id="bent-nearest"),
        pytest.param("smooth", 0.01, BENT, id="bent-smooth"),
        pytest.param("nearest", 0.0, SWOLLEN, id="swollen-nearest"),
        pytest.param("smooth", 0.0, SWOLLEN, id="swollen-smooth"),
    ],
)
def test_maps_are_equal_on_both_sides(
    device: Device, made, sampling: str, waves: float, bent: dict[str, float]
) -> None:
    """Heights between texels by cubic interpolation: what that misses is below the band."""
    mesh, graph, spacing = made
    shape = {"wave_amplitude": waves, "wave_frequency": 20.0, **bent}
    response = {"ends": 1.0 if bent else 0.0}
    settings = settings_of(resolution=4096, shape=shape, response=response)
    here, there = places(mesh, spacing)
    with device.task():
        asset = DeviceAsset(device, mesh, settings)
        asset.mesh.locate(graph)
        asset.mesh.install(asset.mesh.prepare(graph, settings), settings)
        for frame in (NEUTRAL_FRAME, Frame.of(smiling(mesh))):
            found = asset.drawing.to_host(
                frame, MapQuery("redraw", sampling=sampling), 1001, 0, 0, 0, 4096
            )
            off = apart(*(between(found, uv) for uv in (here, there)))
            # The grid of the cushions carries lines of the second chart less well: 2.7 %.
            assert off < (1.5 * BAND if "cushion" in bent else BAND)
        asset.release()


@pytest.mark.slow
@pytest.mark.parametrize("bent", [{}, {"least_half_width": 1.5}, {**BENT, "least_half_width": 0.7}])
def test_skewed_wrinkles_are_those_of_the_reference(
    device: Device, made, bent: dict[str, float]
) -> None:
    mesh, graph, _ = made
    if "taper" in bent:  # of other arcs some are wider and steeper than the bound is for
        skewed = graph.edge_metric.any(axis=1)
        graph = replace(graph, edge_weight=graph.edge_weight * skewed)
    settings = settings_of(resolution=512, shape=bent)
    with device.task():
        asset = DeviceAsset(device, mesh, settings)
        asset.mesh.locate(graph)
        asset.mesh.install(asset.mesh.prepare(graph, settings), settings)
        found = asset.drawing.to_host(NEUTRAL_FRAME, MapQuery("neutral"), 1001, 0, 0, 0, 512)
        asset.release()
    # Every other texel: the reference takes its time.
    rows, columns = np.meshgrid(*2 * [np.arange(0, 512, 2)], indexing="ij")
    uv = np.stack([(columns + 0.5) / 512, 1 - (rows + 0.5) / 512], -1).reshape(-1, 2)
    given = np.zeros(graph.wrinkles), settings.response, settings.shape, 1 / 512, (0.0, 0.0)
    lines = bends.lines(graph, *given)
    discs = bends.discs(graph, np.zeros(graph.pores), *given[1:])
    wanted = redraw.draw(uv, lines, discs, settings.shape, DEPTH).reshape(256, 256)
    assert np.abs(found[::2, ::2] - wanted).max() <= (1e-3 if "taper" in bent else 1e-4) * DEPTH


def elements_of(device: Device, graph: WrinkleGraph, settings: AssetSettings) -> UdimElements:
    return UdimElements(
        device,
        wrinkle_arrays(graph, graph.edge_triangle, settings, 1001),
        pore_arrays(graph, graph.node_triangle, settings, 1001),
        settings.bins.count,
    )


def reference_scales(mesh, graph, settings, positions):
    """(M,), (M,), (N,), (N,) scales of width and depth: copies take those of their originals."""
    r, response = reference_stretches(mesh, graph, settings, positions), settings.response
    wide, deep = scales(r, response.alpha_w, response.alpha_d)
    ratios, _ = reference_stretch(mesh, positions, "tensor")
    logs = stretch.log_stretch(ratios, settings.response.log_stretch_limit)
    pores = scales(pore_stretch(logs[graph.node_triangle]), response.beta_w, response.beta_d)
    nodes = np.where(graph.node_copy_of < 0, np.arange(graph.pores), graph.node_copy_of)
    return wide, deep, pores[0][nodes], pores[1][nodes]


def reference_stretches(mesh, graph, settings, positions):
    """(M,) log stretch across wrinkles: copies take that of their originals."""
    ratios, axes = reference_stretch(mesh, positions, "tensor")
    logs = stretch.log_stretch(ratios, settings.response.log_stretch_limit)
    at, theta = graph.edge_triangle, redraw.directions(graph)
    sampled, ways = axes[at], theta
    if settings.angles == "surface":
        _, r = np.linalg.qr(Surface.of(mesh).jacobian[at])
        sampled, ways = on_surface(r[:, None], sampled), on_surface(r, theta)
    edges = np.where(graph.edge_copy_of < 0, np.arange(graph.wrinkles), graph.edge_copy_of)
    return wrinkle_stretch(logs[at], sampled, ways)[edges]


def between(heights: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(P,) heights at places (P, 2) of a map, by cubic interpolation."""
    side = len(heights)
    rows, columns = (1 - uv[:, 1]) * side - 0.5, uv[:, 0] * side - 0.5
    return map_coordinates(heights.astype(float), [rows, columns], order=3)
