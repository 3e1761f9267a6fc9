"""Below the resolution of a scan: the grain that goes on where its spectrum ends, and what is taken
off the residual for it.

A scan of n texels a side says what the mean over each of these is, and nothing of shorter waves. To
an asset of more texels grain is added, which every method draws and which follows stretch. What of
it the texels of the scan would see is taken away at rest, so that each of their means stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.graph import ORIGINAL, WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import bilinear
from rhytid.domain.residual import ScanRelief
from rhytid.domain.scan import resampled
from rhytid.domain.spectra import band_squares
from rhytid.domain.tiles import mesh_udims, udim_origin, udims_at
from rhytid.domain.uv_layout import mean_uv_length
from rhytid.pipeline.grain import GrainPlanes, grain_amplitude, grain_codes, relief_shares
from rhytid.pipeline.locate import UdimTriangles
from rhytid.support import cancellation
from rhytid.tracing.trace import Relief, Trace, traced_settings

FloatArray = NDArray[np.float64]
Inside = NDArray[np.bool_]
# The longest wave of the grain, in texels of the scan, which see what of its noise is longer.
_LONGEST = 2.0
# The most times as high as in the settings that grain is: its codes end at three deviations.
_MOST = 2.6
# How much lower waves are than those twice as long, at least and at most: of grown skin 0.3 to 1.3,
# of a scan 0.7. What falls more ends there; white noise grows twice as high.
_LEAST_FALL, _MOST_FALL = 0.35, 0.75
# A place where grain is lower than this share of the usual has too coarse texels for it.
_CARRIED = 0.3
# Texels to one of the scan at which grain is measured at most.
_FINEST = 4
# The share of a texel that lies inside of charts where all of it does, but for rounding.
_WHOLE = 0.9999
# Texels of a side that grain is drawn of at once; how far texels reach that are made larger, and
# columns by which that is found.
_PIECE, _NEAR, _COLUMNS = 1024, 5, 12
# The radius in UV of a node that is not drawn.
_POINT = 1e-6


def with_detail(
    device: Device,
    mesh: Mesh,
    scan: ScanRelief,
    found: Trace,
    settings: AssetSettings,
    size: float | None,
) -> Trace:
    """What was traced, with detail: its graph says how high grain is around each of its nodes, and
    the residual is less by what the texels of the scan see of it at rest; of UDIMs that have no
    detail, into which it reaches over a border, by all of it.

    settings: resolved, with which the scan was traced; the graph is drawn with those of
    `traced_settings` for detail.  size: the longest wave of the grain, mesh units; None for
    _LONGEST texels of the scan.
    """
    texel = np.mean([mean_uv_length(mesh, udim) / side for udim, side in scan.ends.items()])
    size = _LONGEST * float(texel) if size is None else size
    drawn = traced_settings(settings, detailed=True)
    drawn = replace(drawn, shape=replace(drawn.shape, grain_size=size))
    assert found.graph.origin is not None  # a traced graph says what it was made for
    origin, factors = replace(found.graph.origin, grain_size=size), {}
    for udim in scan.ends:
        lines = scan.maps[udim] - found.residual[udim]
        even = grain_at_rest(device, mesh, found.graph, lines, drawn, udim)
        wanted = scan.detail * _factors(scan, udim, even, found.charts[udim])
        factors[udim] = wanted.astype(np.float32)
    height = np.clip(at_places(factors, found.graph.node_uv), 0.0, _MOST)
    graph = replace(found.graph, origin=origin, node_grain=height)
    graph = _bare_beyond(mesh, graph, scan)
    residual, none = dict(found.residual), np.zeros((drawn.resolution,) * 2, np.float32)
    for udim in _with_grain(mesh, graph):
        rest = residual.get(udim, none)
        lines = scan.maps.get(udim, none) - rest
        grain = grain_at_rest(device, mesh, graph, lines, drawn, udim)
        own = scan.ends.get(udim)
        residual[udim] = rest - (grain if own is None else seen(grain, own))
    return replace(found, graph=graph, residual=residual)


def seen(grain: Relief, side: int) -> Relief:
    """(R, R) what a scan of `side` texels a side sees of grain (R, R): the texels that have its
    means, made larger as a scan is."""
    return resampled(texels_with_means(grain, side), len(grain), len(grain))


def texels_with_means(map: Relief, side: int) -> Relief:
    """(side, side) the texels which, made larger by cubics as those of a scan are, have the means
    of a map (R, R) over each of them; of a scan that was made larger, its own."""
    size = len(map)
    means = resampled(map, side, side).astype(np.float64)
    # Means of what is made larger, of one in so many texels at a time: a narrow matrix.
    at = np.arange(side)
    combs = (at[:, None] % _COLUMNS == np.arange(_COLUMNS)).astype(np.float32)
    back = resampled(resampled(combs, size, _COLUMNS), side, _COLUMNS)
    row, offset = (one.ravel() for one in np.mgrid[:side, -_NEAR : _NEAR + 1])
    column = row + offset
    there = (column >= 0) & (column < side)
    row, column = row[there], column[there]
    values = back[row, column % _COLUMNS].astype(np.float64)
    solved = scipy.sparse.linalg.splu(
        scipy.sparse.csc_matrix((values, (row, column)), (side, side))
    )
    for _ in range(2):
        means = solved.solve(means).T
    return means.astype(np.float32)


def bare_in(mesh: Mesh, graph: WrinkleGraph, bare: Inside) -> WrinkleGraph:
    """The graph with a node that is not drawn in each triangle of some, bare (F,), which says that
    there is neither grain nor undulation: else these are carried on to where nothing was traced."""
    triangles = np.flatnonzero(bare)
    uv, count, square = mesh.triangle_uv().mean(axis=1), len(triangles), _POINT**-2.0
    more: dict[str, NDArray[Any]] = {
        "node_uv": uv[triangles],
        "node_radius": np.full(count, _POINT),
        "node_triangle": triangles,
        "node_copy_of": np.full(count, ORIGINAL),
        "node_metric": np.tile([square, 0.0, square], (count, 1)),
    }
    none, arrays = np.zeros(count), graph.arrays()
    nodes: dict[str, Any] = {
        name: np.concatenate([given, more.get(name, none).astype(given.dtype)])
        for name, given in arrays.items()
        if name.startswith("node")
    }
    return replace(graph, **nodes)


def grain_at_rest(
    device: Device,
    mesh: Mesh,
    graph: WrinkleGraph,
    lines: Relief,
    settings: AssetSettings,
    udim: int,
) -> Relief:
    """(R, R) grain and undulation that are drawn at rest, mesh units: as high as the graph says,
    less in furrows (grain.clh).

    lines (R, R): what it draws without them.  settings: resolved, with some of them.
    """
    assert settings.depth is not None
    codes = _codes(device, mesh, graph, settings, udim)
    left = lines * np.float32(1.0 / settings.depth) + np.float32(1.0)
    grain = codes * np.float32(grain_amplitude(settings))
    shown: Relief = grain * np.clip(left, 0.25, 1.0, out=left)
    return shown


def _codes(
    device: Device, mesh: Mesh, graph: WrinkleGraph, settings: AssetSettings, udim: int
) -> NDArray[np.int8]:
    """(R, R) the codes of the grain."""
    side = settings.resolution
    assert graph.node_triangle is not None  # as of all that is grown or traced
    piece, codes = min(side, _PIECE), np.empty((side, side), np.int8)
    with device.task_or_steps():
        shares = relief_shares(mesh, graph, graph.node_triangle)
        wave = None if graph.origin is None else graph.origin.patch_size_in(settings.length_unit)
        planes = GrainPlanes(device, mesh, settings, shares, wave)
        located = UdimTriangles(device, mesh, udim, side, settings.padding)
        for row, column in product(range(0, side, piece), repeat=2):
            cancellation.check()
            made = grain_codes(device, planes, located, settings, (row, column, piece))
            codes[row : row + piece, column : column + piece] = device.read(
                made, (piece, piece), np.int8
            )
            made.release()
        planes.release()
        located.release()
    return codes


def _factors(scan: ScanRelief, udim: int, even: Relief, inside: Inside) -> FloatArray:
    """(B, B) how many times as high as `even` grain must be for the spectrum to go on, by place.

    even (R, R): grain of one height.  inside (R, R): texels of charts.
    """
    side = scan.ends[udim]
    wanted, known = _wanted(scan, udim, inside)
    if not known.any():
        return np.zeros((1, 1))
    finer, maps = len(even) / side, [even - seen(even, side), scan.maps[udim]]
    if finer > _FINEST:  # blocks hold few of its longest waves
        finer, maps = _FINEST, [resampled(map, _FINEST * side, _FINEST * side) for map in maps]
    given, there = (_octave(map, inside, finer, known) for map in maps)
    wanted = np.maximum(wanted * min(np.log2(finer), 1.0) - there, 0.0)
    least = _CARRIED**2 * given[known].mean()
    factors: FloatArray = np.sqrt(wanted / np.maximum(given, max(least, 1e-300)))
    return np.minimum(factors, _MOST)


def _octave(map: Relief, inside: Inside, finer: float, known: NDArray[np.bool_]) -> FloatArray:
    """(B, B) the mean square of the octave below the shortest waves of a scan, at most, in a map
    that has `finer` texels to one of it.  known (B, B): where it is looked for."""
    band = max(2.0, finer), 2.0 * finer
    squares, there = band_squares(map, _within(inside, len(map)), [band])
    amount = resampled(there.astype(np.float32), *known.shape)
    found = resampled(squares[0] * there, *known.shape) / np.maximum(amount, 1e-6)
    return _smooth(found.astype(np.float64), known & (amount > 0.0))


def _wanted(scan: ScanRelief, udim: int, inside: Inside) -> tuple[FloatArray, NDArray[np.bool_]]:
    """(B, B) the mean square of the octave below the shortest waves of a scan, by place, as its
    last three octaves fall, and where that was measured."""
    side = scan.ends[udim]
    own = texels_with_means(scan.maps[udim], side)
    octaves = [(2.0, 4.0), (4.0, 8.0), (8.0, 16.0)]
    squares, known = band_squares(own, _within(inside, side), octaves)
    if not known.any():
        return squares[0], known
    # White noise, by the share of each octave in all pairs of frequencies.
    share = np.pi * np.array([(longest / shortest) ** 2 - 1.0 for shortest, longest in octaves])
    share /= np.array([longest for _, longest in octaves]) ** 2
    squares = np.maximum(squares - scan.noise**2 * share[:, None, None], 0.0)
    finest, next, broadest = squares[:, known].mean(axis=1)
    falls = [one / two for one, two in ((finest, next), (next, broadest)) if two > 0.0]
    fall = np.clip(min(falls, default=0.0), _LEAST_FALL**2, _MOST_FALL**2)
    return fall * _smooth(squares[0], known), known


def _within(inside: Inside, side: int) -> Inside:
    """(side, side) whether all texels under one are inside."""
    return resampled(inside.astype(np.float32), side, side) > _WHOLE


def _smooth(values: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """The mean of those around that are known, and of the nearest where none is."""
    count = scipy.ndimage.uniform_filter(known.astype(np.float64), 3, mode="constant")
    total = scipy.ndimage.uniform_filter(np.where(known, values, 0.0), 3, mode="constant")
    found = total / np.maximum(count, 1e-9)
    near = scipy.ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: FloatArray = found[tuple(near)]
    return filled


def at_places(maps: Mapping[int, Relief], uv: NDArray[np.floating]) -> NDArray[np.float32]:
    """(N,) values of maps of UDIMs at places (N, 2), between their texels; 0 in other UDIMs."""
    found, of = np.zeros(len(uv), np.float32), udims_at(uv.astype(np.float64))
    for udim, map in maps.items():
        here = of == udim
        found[here] = bilinear(map, uv[here].astype(np.float64) - udim_origin(udim))
    return found


def _bare_beyond(mesh: Mesh, graph: WrinkleGraph, scan: ScanRelief) -> WrinkleGraph:
    """The graph, bare in UDIMs without detail."""
    others = [udim for udim in mesh_udims(mesh) if udim not in scan.ends]
    return bare_in(mesh, graph, np.isin(udims_at(mesh.triangle_uv().mean(axis=1)), others))


def _with_grain(mesh: Mesh, graph: WrinkleGraph) -> list[int]:
    """The UDIMs with triangles that have grain."""
    assert graph.node_triangle is not None
    shares = relief_shares(mesh, graph, graph.node_triangle)
    assert shares is not None  # the graph says how high it is
    uv = mesh.triangle_uv()[shares[:, :3].any(axis=1)].mean(axis=1)
    return [udim for udim in mesh_udims(mesh) if udim in udims_at(uv)]
